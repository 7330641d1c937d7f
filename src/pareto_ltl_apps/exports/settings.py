"""Settings of the files of a plan."""

from __future__ import annotations

from dataclasses import dataclass

from careful_io.messages import wrong_value
from flight_quantities.levels import DEPTH, HEIGHT, Level
from pareto_ltl.extend import CheckedSettings, setting
from pareto_ltl.support.errors import ConfigError
from pareto_ltl.support.extensions import EXPORTS
from pareto_ltl_apps.exports.kinds import FORMATS

ON_REQUEST = ("f3548", "fpl", "lua")  # formats that are written only if asked for
HIGHEST = 100_000.0  # limit of the absolute value of an exported height [m]


@dataclass
class ExportsConfig(CheckedSettings, section="exports", after="deployment"):
    """Files of the plan for autopilots, maps and navigators (docs/exports.md)."""

    files: bool = setting(True, "whether the plan is exported")
    formats: list[str] = setting(
        [name for name in FORMATS if name not in ON_REQUEST],
        "formats to write",
        choices=tuple(FORMATS),
        group=EXPORTS,
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

    def stated_height(self) -> tuple[str, Level] | None:
        """``exports.altitude`` states the height of the flight above the ground of the start."""
        if self.altitude is None:
            return None
        level = Level(DEPTH if self.altitude < 0.0 else HEIGHT, abs(self.altitude))
        return f"exports.altitude={self.altitude:g}", level
