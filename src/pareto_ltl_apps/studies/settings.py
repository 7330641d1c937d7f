"""Settings of the studies, each a pipeline, and of sweeps."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any, ClassVar

from careful_io.messages import shown_value, wrong_value
from declared_settings import SEEDS
from pareto_ltl.extend import CheckedSettings, FidelityConfig, WindConfig, check_time, setting
from pareto_ltl.support.errors import ConfigError
from pareto_ltl.support.levels import wind_level
from pareto_ltl_apps.formats.settings import check_outline

if TYPE_CHECKING:
    from pareto_ltl import Settings

LAWS, PRESETS = (FidelityConfig.declared(name).choices for name in ("law", "name"))
KEEP = ("all", "recommended")  # starts of a departure study whose directories are written
METHODS = ("paper", "smoothed", "full", "cc_rrt", "ml_rrt", "calm_shortest")
FACTOR_SECTIONS = {  # sections of the factors of an ablation
    **dict.fromkeys(("trees", "beta", "epsilon", "n_max"), "planner"),
    "dt": "robot",
    **dict.fromkeys(("kernel", "ball"), "wind"),
    **dict.fromkeys(("law", "mission_bound", "collision_bound", "refine"), "fidelity"),
}
MODEL_FACTORS = tuple(name for name, section in FACTOR_SECTIONS.items() if section == "fidelity")
SETTING_FACTORS = tuple(name for name in FACTOR_SECTIONS if name not in MODEL_FACTORS)
INLAND_OUTLINE = (  # the interior of the contiguous United States, corners [longitude, latitude] [deg]
    (-120.0, 46.5), (-118.5, 37.0), (-111.0, 33.5), (-103.0, 31.5), (-98.5, 29.0), (-91.0, 31.5),
    (-84.0, 32.5), (-80.5, 35.0), (-76.5, 40.5), (-84.0, 43.0), (-90.0, 45.5), (-97.0, 47.0), (-111.0, 47.0),
)  # fmt: skip


def all_of(section: type[CheckedSettings], name: str) -> Any:
    """A list of values of the setting ``name`` of ``section``; by default all its choices."""
    choices = section.declared(name).choices
    return setting(list(choices), f"values of {section.section}.{name}", choices=choices, distinct=True)


def other_default(section: type[CheckedSettings], name: str, default: Any) -> Any:
    """The setting ``name`` of ``section`` with another default, for a section that is a preset of it."""
    declared = section.declared(name)
    return setting(default, **{item.name: getattr(declared, item.name) for item in fields(declared)})


@dataclass
class EvaluationConfig(CheckedSettings, section="evaluation", after="pipelines"):
    """Settings that all studies share (pipelines compare, convergence, ablation, hindcast, forecast_test)."""

    acts: ClassVar = {"cluster": "send code to the cluster {}", "resume": "continue the run in {}"}

    seeds: list[int] = setting(
        list(range(20)), "seeds of the planner, one plan for each", SEEDS, distinct=True
    )
    laws: list[str] = setting(
        list(LAWS), "wind laws under which plans are flown", choices=LAWS, distinct=True
    )
    jobs: int = setting(0, "processes; 0: one for each core", "[0, 1024]")
    cluster: str | None = setting(
        None, "address of a Dask scheduler whose workers share the work (docs/sweeps.md); null: this machine"
    )
    resume: str | None = setting(None, "results directory of an unfinished run to continue")


@dataclass
class CompareConfig(CheckedSettings, section="compare"):
    """The planners that pipelines=compare compares."""

    methods: list[str] = setting(
        list(METHODS), "planners; differences are relative to the first one", choices=METHODS, distinct=True
    )


@dataclass
class ConvergenceConfig(CheckedSettings, section="convergence"):
    """The tree sizes at which pipelines=convergence evaluates the growing trees."""

    sizes: list[int] = setting(
        [100, 200, 500, 1000, 2500, 5000, 10_000, 20_000], "vertices of a tree", "[2, 1e8]", distinct=True
    )


@dataclass
class AblationConfig(CheckedSettings, section="ablation"):
    """The factors that pipelines=ablation varies, one at a time, and their values.

    Factors of ``SETTING_FACTORS`` are varied by default, ``MODEL_FACTORS`` only if they are listed.
    """

    gone: ClassVar = FidelityConfig.gone  # of the parents, too

    factors: list[str] = setting(
        list(SETTING_FACTORS), "factors to vary", choices=tuple(FACTOR_SECTIONS), distinct=True
    )
    trees: list[int] = setting([1, 2, 5, 10, 20], "values of planner.trees", "[1, 10_000]", distinct=True)
    beta: list[float] = setting(
        [0.0, 1.0, 10.0],
        "factors that multiply planner.beta_risk and planner.beta_length",
        "[0, 1e6]",
        distinct=True,
    )
    epsilon: list[float] = setting(
        [0.01, 0.02, 0.05, 0.1, 0.2], "values of planner.epsilon", "(0, 1)", distinct=True
    )
    n_max: list[int] = setting(
        [500, 1000, 2500, 5000, 10_000], "values of planner.n_max", "[2, 1e8]", distinct=True
    )
    dt: list[int] = setting(
        [1, 2, 4, 8, 16], "number of parts into which a time step is divided", "[1, 10_000]", distinct=True
    )
    kernel: list[str] = all_of(WindConfig, "kernel")
    ball: list[float] = setting([0.0, 1.0, 2.0, 3.0], "values of wind.ball", "[0, 100]", distinct=True)
    law: list[str] = all_of(FidelityConfig, "law")
    mission_bound: list[str] = all_of(FidelityConfig, "mission_bound")
    collision_bound: list[str] = all_of(FidelityConfig, "collision_bound")
    refine: list[str] = all_of(FidelityConfig, "refine")


@dataclass
class ForecastTestConfig(CheckedSettings, section="forecast_test"):
    """Random missions that pipelines=forecast_test plans in forecasts and simulates in later analyses."""

    known: str = setting(
        "departure",
        "winds that the planner knows: forecasts at departure, or readings of all times of the flight",
        choices=("departure", "all"),
    )
    truth: str | None = setting(
        None,
        "folder of GRIB2 files with the full fields, a table of fields (.npz with uv by time, lat, lon), or "
        "a table of forecasts by run, place and lead (.npz, .nc, .csv); null: the NOAA files beside the "
        "checkout",
    )
    missions: int = setting(100, "number of random missions", "[1, 1e6]")
    area: list[Any] = setting(
        [list(corner) for corner in INLAND_OUTLINE],
        "outline that holds the centres of scenes, corners [longitude, latitude]",
        unit="deg",
    )
    side: list[float] = setting(
        [400_000.0, 800_000.0], "smallest and largest side length of a scene", "[0, 1e7]", unit="m"
    )
    obstacles: list[int] = setting([2, 7], "smallest and largest number of obstacles of a scene", "[0, 1000]")
    formulas: list[str] = setting(
        ["F(a & F b)", "F(a & F b & F c)", "F(a & F(b & F c))", "!b U a & F c"],
        "missions, over the regions a, b and c",
    )
    hours: float = setting(12.0, "hours of wind required after departure", "(0, 1e5]", unit="h")
    max_gap: float = setting(6.0, "longest gap between two fields of one period", "(0, 1e5]", unit="h")
    gusts: float = setting(
        1.0, "share of the fitted white standard deviation added to the real fields", "[0, 100]"
    )
    spacing: float = setting(20_000.0, "spacing of the lattice of the real fields", "[1, 1e7]", unit="m")
    bins: int = setting(5, "bins of the reliability diagram", "[2, 1000]")
    delay: float = setting(
        4.0, "age at departure of the newest forecast that the planner may use", "[0, 1e5]", unit="h"
    )
    delay_most: float | None = setting(
        None,
        "largest age of that forecast: each mission draws it between delay and this; null: delay",
        "[0, 1e5]",
        unit="h",
    )
    same_map: bool = setting(
        False, "one map and formula for all missions, moved over the area (the same kilometres)"
    )
    situations: str = setting(
        "auto",
        "what shares its weather: a period of fields, a span of two days, or a box of 12 x 24 degrees in "
        "such a span; auto: days for a table of forecasts at places, else period",
        choices=("auto", "period", "days", "boxes"),
    )
    points: int | None = setting(
        120,
        "readings at each time that the planner gets, spread over the area; null: every grid node",
        "[5, 10_000]",
    )
    fidelities: list[str] = setting(
        ["full"], "presets of fidelity to plan with", choices=PRESETS, distinct=True
    )
    plans: int = setting(
        0,
        "plans taken from each front beside the chosen one: the safest, the shortest, others between them",
        "[0, 1000]",
    )

    @property
    def wait(self) -> float:
        """Hours from the first field of a period to the earliest departure whose winds can be known."""
        return max(self.delay, self.delay_most or 0.0) if self.known == "departure" else 0.0

    def check_combinations(self) -> None:
        """Refuse ranges out of order, an area with fewer than three corners and an empty list of formulas."""
        for key, pair in (("side", self.side), ("obstacles", self.obstacles)):
            if len(pair) != 2 or pair[0] > pair[1]:
                raise wrong_value(f"{self.section}.{key}", "be [least, most]", pair)
        if self.side[0] == 0:
            raise wrong_value(f"{self.section}.side", "be positive [m]", self.side[0])
        if self.delay_most is not None and self.delay_most < self.delay:
            raise wrong_value(
                f"{self.section}.delay_most", f"be at least delay = {self.delay:g}", self.delay_most
            )
        check_outline(f"{self.section}.area", self.area)
        if len(self.area) < 3:
            raise ConfigError(f"{self.section}.area must be at least three corners [longitude, latitude]")
        if not self.formulas:
            raise ConfigError(
                f"{self.section}.formulas is empty: list at least one, over the regions a, b and c"
            )


@dataclass
class HindcastConfig(ForecastTestConfig, section="hindcast"):
    """The settings of forecast_test with which pipelines=hindcast tests interpolation: known=all."""

    known: str = other_default(ForecastTestConfig, "known", "all")
    hours: float = other_default(ForecastTestConfig, "hours", 18.0)
    bins: int = other_default(ForecastTestConfig, "bins", 8)
    fidelities: list[str] = other_default(ForecastTestConfig, "fidelities", list(PRESETS))
    plans: int = other_default(ForecastTestConfig, "plans", 3)


@dataclass
class DepartureConfig(CheckedSettings, section="departure"):
    """Starts that pipelines=departure plans and compares (docs/departure.md)."""

    starts: list[Any] = setting([], "departure times, ISO 8601 UTC; empty: set by first, last and every")
    first: str | None = setting(None, "earliest start; null: mission.start_time, else the first wind time")
    last: str | None = setting(None, "latest start; null: the last wind time")
    every: float | None = setting(
        None, "time between two starts; null: every wind time", "(0, 1e5]", unit="h"
    )
    arrive_by: str | None = setting(
        None, "latest arrival; if set, the latest starts that arrive by this time are planned"
    )
    most: int = setting(8, "with arrive_by: number of starts to find that arrive in time", "[1, 10_000]")
    flights: int = setting(
        10_000,
        "fresh flights of each path of the front of each start, used to compare the starts",
        "[100, 1e8]",
    )
    seeds: int = setting(
        3,
        "seeds with which a start is planned if it may be the best; 1: the spread between seeds is not known",
        "[1, 10]",
    )
    quick: bool = setting(
        True,
        "whether starts are compared with a coarser refinement; the recommended start is then planned "
        "in full",
    )
    keep: str = setting("all", "starts whose results directories are written to starts/", choices=KEEP)

    def check_combinations(self) -> None:
        """Refuse values that are not times, and starts that are given both as a list and as a range."""
        for key in ("first", "last", "arrive_by"):
            check_time(f"departure.{key}", getattr(self, key))
        for time in self.starts:
            if not isinstance(time, str):
                raise ConfigError(
                    f"departure.starts must be a list of ISO 8601 times, got {shown_value(time)} in it"
                )
            check_time("departure.starts", time)
        if self.starts and (self.first or self.last or self.every):
            raise ConfigError(
                "departure.starts lists the starts itself: leave out departure.first, last and every"
            )


@dataclass
class LevelsConfig(CheckedSettings, section="levels"):
    """Levels that pipelines=levels plans and compares (docs/departure.md)."""

    levels: list[str] = setting([], "levels of the wind files, each the height of a flight: [10m, 925hPa]")
    starts: list[Any] = setting(
        [], "departure times, ISO 8601 UTC: each level at each of them; empty: mission.start_time"
    )
    flights: int = setting(
        10_000, "fresh flights of each path of the front of each level, used to compare the levels",
        "[100, 1e8]",
    )  # fmt: skip
    seeds: int = setting(
        2, "seeds with which a level is planned if it may be the best; 1: the spread between seeds is not "
        "known", "[1, 10]",
    )  # fmt: skip
    quick: bool = setting(True, "whether levels are planned with a coarser refinement")
    mass: float | None = setting(
        None, "mass of the robot, for the energy of the climb", "(0, 1e6]", unit="kg"
    )
    climb_efficiency: float = setting(
        0.6, "height energy gained per energy that the climb takes beyond level flight", "(0, 1]"
    )

    def check_combinations(self) -> None:
        """Refuse what is no level or no time, and a level that is listed twice."""
        texts = [wind_level(str(level), "levels.levels").text for level in self.levels]
        if len(set(texts)) < len(texts):
            raise ConfigError(f"levels.levels lists a level twice: {', '.join(texts)}")
        for time in self.starts:
            if not isinstance(time, str):
                raise ConfigError(f"levels.starts must be ISO 8601 times, got {shown_value(time)} in it")
            check_time("levels.starts", time)

    def complete(self, settings: Settings) -> None:
        """Take the first level for ``wind.level=auto``: the map of the study is made with it."""
        if settings.wind.level == "auto" and self.levels:
            settings.wind = replace(settings.wind, level=self.levels[0])


@dataclass
class ReplanningConfig(CheckedSettings, section="replanning"):
    """Flights of pipelines=replanning, with and without new plans on the way (docs/replanning.md)."""

    flights: int = setting(100, "number of true winds in which the plan is flown", "[1, 1e6]")
    fixes: list[int] = setting(
        [1, 2, 4], "numbers of fixes, evenly spaced over the plan: a row for each", "[1, 1000]",
        distinct=True
    )  # fmt: skip
    every: float | None = setting(
        None, "time between two fixes, for one row instead of replanning.fixes; null: the rows of "
        "replanning.fixes, and one with fixes at the landmarks that the plan relies on", "(0, 1e4]", unit="h"
    )  # fmt: skip
    fix_sd: float = setting(500.0, "standard deviation of a fix in each direction", "(0, 1e6]", unit="m")
    forecasts: float | None = setting(
        None, "time between two newer forecasts, for two further rows, with them alone and with the last "
        "fixes; null: no such rows", "(0, 1e4]", unit="h"
    )  # fmt: skip


@dataclass
class SitlConfig(CheckedSettings, section="sitl"):
    """Flights of the exported command table by the aircraft model of JSBSim, with pipelines=sitl."""

    flights: int = setting(
        200, "flights in JSBSim, and as many of the planner's simulation in the same winds", "[1, 1e5]"
    )
    rate: float = setting(60.0, "integration rate of the aircraft model", "[30, 1000]", unit="1/s")
    airspeed: str = setting(
        "cas",
        "airspeeds of the table that the autopilot gets: cas or tas; it holds them as calibrated airspeeds, "
        "so that tas shows what happens if true airspeeds are taken for calibrated ones",
        choices=("cas", "tas"),
    )
    drawn: int = setting(40, "flights of each simulation that the map shows", "[0, 1e4]")


@dataclass
class SweepConfig(CheckedSettings, section="sweep"):
    """How a sweep resumes and what its figure shows; no result of a run depends on it."""

    result = False

    resume: bool = setting(True, "keep finished jobs and run only those that failed, were killed or are new")
    x: str | None = setting(
        None, "horizontal axis of the figure: a swept setting or a metric; null: the first swept setting"
    )
    y: str | None = setting(None, "vertical axis of the figure: a metric; null: the failure rate")
    by: str | None = setting(None, "one color in the figure for each value of this swept setting")
