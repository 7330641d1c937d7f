"""Settings of simulated flights, figures, wind tables, pipelines and sweeps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pareto_ltl.settings.checks import CheckedSettings, check_outline, check_time, setting
from pareto_ltl.settings.fidelity import LAWS
from pareto_ltl.support.errors import ConfigError
from pareto_ltl.support.messages import wrong_value

FIGURE_FORMATS = ("png", "svg", "pdf")
EXPORT_FILES = {
    "dead_reckoning": "dead_reckoning.csv",
    "card": "flight_card.csv",
    "geojson": "plan.geojson",
    "kml": "plan.kml",
    "gpx": "plan.gpx",
    "fpl": "plan.fpl",
    "qgc": "mission.plan",
    "mavlink": "mavlink_script.json",
    "lua": "plan.lua",
    "corridor": "corridor.geojson",
    "netcdf": "trajectory.nc",
    "f3548": "operational_intent.json",
}  # the file of each format
BRANCH_FILES = (  # of plans that branch, the second pair after a second fix
    "branch_?.csv", "branch_?_card.csv", "branch_??.csv", "branch_??_card.csv", "branch_cards.html",
)  # fmt: skip
ON_REQUEST = ("f3548", "fpl", "lua")  # formats that are written only if asked for
HIGHEST = 100_000.0  # limit of the absolute value of an exported height [m]


@dataclass
class DeploymentConfig(CheckedSettings, section="deployment"):
    """Simulated flights of the plan."""

    runs: int = setting(500, "flights simulated under each wind law", "[1, 1e8]")
    laws: list[str] = setting(list(LAWS), "wind laws that are simulated", choices=LAWS, distinct=True)


@dataclass
class ReportConfig(CheckedSettings, section="report"):
    """Figures."""

    figures: bool = setting(True, "whether figures are drawn")
    page: bool = setting(True, "whether report.html is written: one file that shows the result")
    formats: list[str] = setting(
        ["png"], "file formats of each figure", choices=FIGURE_FORMATS, distinct=True
    )
    dpi: int = setting(200, "resolution of PNG figures, in dots per inch", "[30, 1200]")
    paths: int = setting(40, "simulated flights that are drawn", "[0, 10_000]")
    trees: bool = setting(False, "whether the map of a plan shows the search trees; without a plan it does")


@dataclass
class LimitsConfig(CheckedSettings, section="limits"):
    """Limits of your own for GO or NO-GO of pareto-ltl check (docs/check.md); null: not limited."""

    failure: float | None = setting(None, "largest failure rate", "(0, 1)")
    containment: float | None = setting(
        None, "largest probability per flight hour of leaving the border, or the given volume", "(0, 1)"
    )
    energy: float | None = setting(None, "largest share of robot.power.capacity that is used", "(0, 1]")
    takeoff_wind: float | None = setting(
        None, "largest wind at the start and the time of departure", "(0, 200]", unit="m/s"
    )


@dataclass
class ExportsConfig(CheckedSettings, section="exports"):
    """Files of the plan for autopilots, maps and navigators (docs/exports.md)."""

    files: bool = setting(True, "whether the plan is exported")
    formats: list[str] = setting(
        [name for name in EXPORT_FILES if name not in ON_REQUEST],
        "formats to write",
        choices=tuple(EXPORT_FILES),
        distinct=True,
    )
    flights: int = setting(
        2000, "simulated flights for the corridors and for the failure rate with feedback", "[100, 1e6]"
    )
    altitude: float | None = setting(
        None,
        "height of the flight above the ground of the start: the same height as robot.level; null: that one, "
        "else the level of the wind",
        unit="m",
    )
    altitude_lower: float | None = setting(
        None, "lowest height above the WGS 84 ellipsoid, for f3548", unit="m"
    )
    altitude_upper: float | None = setting(
        None, "highest height above the WGS 84 ellipsoid, for f3548", unit="m"
    )

    def check_combinations(self) -> None:
        """Refuse heights that are beyond :data:`HIGHEST`, not in order, or missing for f3548."""
        lower, upper = self.altitude_lower, self.altitude_upper
        for key in ("altitude", "altitude_lower", "altitude_upper"):
            value = getattr(self, key)
            if value is not None and not abs(value) <= HIGHEST:
                limits = f"lie between -{HIGHEST:g} and {HIGHEST:g} [m]"
                raise wrong_value(f"exports.{key}", limits, value)
        if (lower is None) != (upper is None):
            raise ConfigError("give both exports.altitude_lower and exports.altitude_upper, or neither")
        if lower is not None and upper is not None and lower >= upper:
            raise ConfigError(
                f"exports.altitude_lower = {lower:g} m must be below exports.altitude_upper = {upper:g} m"
            )
        if "f3548" in self.formats and lower is None:
            raise ConfigError(
                "exports.formats: f3548 needs heights above the WGS 84 ellipsoid; set exports.altitude_lower "
                "and exports.altitude_upper (pareto-ltl export: --between LOW HIGH)"
            )


@dataclass
class IngestConfig(CheckedSettings, section="ingest"):
    """The table of readings that pipelines=ingest writes."""

    out: str = setting("wind_table.csv", "file that is written")
    points: int = setting(120, "readings at each time, by farthest-point sampling", "[3, 1e6]")
    area: list[Any] = setting([], "outline of the area, corners [longitude, latitude]", unit="deg")
    first: str | None = setting(None, "first time, ISO 8601 UTC; null: from the beginning")
    last: str | None = setting(None, "last time, ISO 8601 UTC; null: to the end")

    def check_combinations(self) -> None:
        """Refuse an output file that is not CSV, an invalid outline, and values that are not times."""
        if not self.out.lower().endswith(".csv"):
            raise wrong_value("ingest.out", "end in .csv (its origin goes to .json)", self.out)
        check_outline("ingest.area", self.area)
        check_time("ingest.first", self.first)
        check_time("ingest.last", self.last)


@dataclass
class PipelineConfig(CheckedSettings, section="pipelines"):
    """The stages of a run."""

    stages: list[str] = setting([], "stages in the order in which they run")


@dataclass
class SweepConfig(CheckedSettings, section="sweep"):
    """How a sweep resumes and what its figure shows; no result of a run depends on it."""

    resume: bool = setting(True, "keep finished jobs and run only those that failed, were killed or are new")
    x: str | None = setting(
        None, "horizontal axis of the figure: a swept setting or a metric; null: the first swept setting"
    )
    y: str | None = setting(None, "vertical axis of the figure: a metric; null: the failure rate")
    by: str | None = setting(None, "one color in the figure for each value of this swept setting")
