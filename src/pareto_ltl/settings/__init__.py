"""Settings of every stage, checked when they are made.

YAML lives in ``conf/``; these dataclasses are its schema. ``app.py`` turns a composed configuration
into a :class:`Settings`; past that line nobody sees Hydra. Every check names the key as a user types it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

from pareto_ltl.support import extensions
from pareto_ltl.support.errors import ConfigError
from pareto_ltl.support.extensions import extension_names

LAWS = ("independent", "coherent")
MISSION_BOUNDS = ("theorem2", "ordered")
COLLISION_BOUNDS = ("step", "path")
PARENT_RULES = ("dominance", "scaled", "tchebycheff", "mixed")
REFINEMENTS = ("none", "convex")
JUDGES = ("bound", "flights")
WIND_SOURCES = ("sample", "csv", "grib", "calm")
KERNELS = ("matern32", "rbf")
SELECTION_RULES = ("priority", "weighted", "threshold")


def _positive(key: str, value: float, unit: str = "") -> None:
    if not (value > 0 and math.isfinite(value)):
        raise ConfigError(f"{key} must be positive{f' [{unit}]' if unit else ''}, got {value}")


def _not_negative(key: str, value: float, unit: str = "") -> None:
    if not (value >= 0 and math.isfinite(value)):
        raise ConfigError(f"{key} must not be negative{f' [{unit}]' if unit else ''}, got {value}")


def _at_least(key: str, value: int, least: int) -> None:
    if value < least:
        raise ConfigError(f"{key} must be at least {least}, got {value}")


def _probability(key: str, value: float) -> None:
    if not 0 < value < 1:
        raise ConfigError(f"{key} must lie between 0 and 1, both excluded, got {value}")


def _one_of(key: str, value: str, choices: tuple[str, ...]) -> None:
    if value not in choices:
        raise ConfigError(f"{key} must be one of {', '.join(choices)}; got {value!r}")


def _kind_of(key: str, value: str, own: tuple[str, ...], group: str) -> None:
    """Like :func:`_one_of`, with the names that other packages add to ``group``."""
    if value not in own:
        _one_of(key, value, (*own, *extension_names(group)))


def _rows(value: Any, width: int) -> bool:
    """Whether ``value`` is a list of rows of ``width`` finite numbers. (A schema of floats would refuse [1,
    0].)
    """
    return isinstance(value, list) and all(
        isinstance(row, list)
        and len(row) == width
        and all(isinstance(n, int | float) and math.isfinite(n) for n in row)
        for row in value
    )


def _matrix(key: str, value: Any) -> None:
    if not _rows(value, 2) or len(value) != 2:
        raise ConfigError(f"{key} must be a 2 x 2 matrix of numbers, got {value}")


def _outline(key: str, value: Any) -> None:
    if not _rows(value, 2):
        raise ConfigError(f"{key} must be a list of [longitude, latitude] in degrees, got {value}")


@dataclass
class RandomSceneConfig:
    """Regions and obstacles drawn at random, beside those that the scene names."""

    seed: int = 0  # of the map; ``seed`` is that of the planner
    regions: int = 0  # named a, b, c, ...
    obstacles: int = 0
    radius: list[float] = field(default_factory=lambda: [0.05, 0.1])  # smallest, largest; of the shorter side
    gap: float = 0.02  # between any two of them, at least; of the shorter side

    def __post_init__(self) -> None:
        _at_least("scene.random.seed", self.seed, 0)
        _at_least("scene.random.regions", self.regions, 0)
        _at_least("scene.random.obstacles", self.obstacles, 0)
        if self.regions > 26:
            raise ConfigError(f"scene.random.regions must be at most 26 (a to z), got {self.regions}")
        if len(self.radius) != 2 or not 0 < self.radius[0] <= self.radius[1] < 0.5:
            raise ConfigError(
                "scene.random.radius must be [smallest, largest], between 0 and 0.5 of the map's shorter "
                f"side, got {self.radius}"
            )
        _not_negative("scene.random.gap", self.gap)


@dataclass
class SceneConfig:
    """The map, in units of ``unit`` metres; with ``centre`` the plane touches the Earth there."""

    name: str = "scene"
    file: str | None = None  # GeoJSON (degrees) or scene.json (metres) instead of the keys below
    unit: float = 1.0  # metres a coordinate unit
    centre: list[float] | None = None  # [latitude, longitude] of the middle of the bounds [deg]
    # Numbers of the map are checked in scene.py: a schema of floats would refuse a corner written [1, 2].
    bounds: list[Any] = field(default_factory=list)  # [[west, south], [east, north]]
    start: list[Any] = field(default_factory=list)
    regions: dict[str, Any] = field(default_factory=dict)
    obstacles: list[Any] = field(default_factory=list)
    landmarks: list[Any] = field(default_factory=list)  # where the robot learns its position
    random: RandomSceneConfig = field(default_factory=RandomSceneConfig)

    def __post_init__(self) -> None:
        _positive("scene.unit", self.unit, "m")
        if self.centre is not None and (
            len(self.centre) != 2 or not -89 <= self.centre[0] <= 89 or not -180 <= self.centre[1] <= 360
        ):
            raise ConfigError(f"scene.centre must be [latitude, longitude] in degrees, got {self.centre}")


@dataclass
class MissionConfig:
    formula: str = ""
    start_time: str | None = None  # departure, ISO 8601 UTC; default: the first wind time
    pattern: str | None = None  # instead of the formula: sequence, coverage, ... (logic/patterns.py)
    goals: list[str] = field(default_factory=list)  # of the pattern: regions or formulas
    avoid: list[str] = field(default_factory=list)  # regions that the pattern keeps out of
    order: list[list[str]] = field(default_factory=list)  # pairs [first, then] of the pattern
    automaton: str | None = None  # instead of the formula: a file in HOA format


@dataclass
class RobotConfig:
    """x' = A x + dt B u + dt w, ‖u‖ ≤ u_max."""

    dt: float = 1800.0  # time step [s]
    u_max: float = 30.0  # largest airspeed [m/s]
    a: list[Any] = field(default_factory=lambda: [[1.0, 0.0], [0.0, 1.0]])
    b: list[Any] = field(default_factory=lambda: [[1.0, 0.0], [0.0, 1.0]])
    start_sd: float = 0.0  # standard deviation of the start position [m]
    feedback: float = 0.0  # gain K: the share of a deviation that position feedback takes back in one step
    effort_risk: float = 0.05  # probability that a step's feedback asks for more than u_max
    fix_sd: float = 100.0  # standard deviation of a position fix at a landmark [m]
    fix_gain: float = 0.25  # share of a deviation known from a fix that is flown back in one step
    fix_risk: float = 0.02  # largest probability of missing a landmark that a plan counts on

    def __post_init__(self) -> None:
        _positive("robot.dt", self.dt, "s")
        _positive("robot.u_max", self.u_max, "m/s")
        _not_negative("robot.start_sd", self.start_sd, "m")
        if not 0.0 <= self.feedback <= 1.0:
            raise ConfigError(
                "robot.feedback must lie in [0, 1] (0: open loop, 1: back on the path in one step), got "
                f"{self.feedback}"
            )
        _probability("robot.effort_risk", self.effort_risk)
        _positive("robot.fix_sd", self.fix_sd, "m")
        if not 0.0 <= self.fix_gain <= 1.0:
            raise ConfigError(f"robot.fix_gain must lie in [0, 1], got {self.fix_gain}")
        _probability("robot.fix_risk", self.fix_risk)
        _matrix("robot.a", self.a)
        _matrix("robot.b", self.b)
        (p, q), (r, s) = self.b
        if abs(p * s - q * r) < 1e-9:
            raise ConfigError(f"robot.b must be invertible, got {self.b}")


@dataclass
class WindConfig:
    source: str = "sample"
    path: str | None = None  # file, folder or pattern for csv and grib
    kernel: str = "matern32"
    noise_min: float = 0.3  # lower bound of the white-noise standard deviation [m/s]
    spacing: float = 25_000.0  # lattice [m]
    padding: float = 150_000.0  # how far the lattice reaches past the scene [m]
    ball: float = 2.0  # radius of the maximum-trace ball in standard deviations
    hold_last: bool = False  # may the last field stand in for later times?
    max_speed: float = 75.0  # readings above are refused [m/s]
    holdout: float = 0.2  # share of the readings kept out to score the fit
    max_points: int = 150  # readings a time that the fit uses, spread evenly where a source has more
    energy: float = 0.99  # share of the posterior variance that coherent modes carry, the rest is white
    modes_max: int = 96  # modes a slot and component, at most
    modes_spacing: float = 50_000.0  # lattice of the modes [m]
    rho: float | None = None  # correlation of wind errors from slot to slot; null: fitted
    gust_time: float = 1800.0  # how long the white part lasts at the robot [s], in the coherent law
    cache: bool = True

    def __post_init__(self) -> None:
        _kind_of("wind.source", self.source, WIND_SOURCES, extensions.WIND_SOURCE_GROUP)
        _one_of("wind.kernel", self.kernel, KERNELS)
        _positive("wind.noise_min", self.noise_min, "m/s")
        _positive("wind.spacing", self.spacing, "m")
        _not_negative("wind.padding", self.padding, "m")
        _not_negative("wind.ball", self.ball)
        _positive("wind.max_speed", self.max_speed, "m/s")
        _probability("wind.holdout", self.holdout)
        _at_least("wind.max_points", self.max_points, 5)
        _probability("wind.energy", self.energy)
        _at_least("wind.modes_max", self.modes_max, 1)
        _positive("wind.modes_spacing", self.modes_spacing, "m")
        _positive("wind.gust_time", self.gust_time, "s")
        if self.rho is not None and not 0.0 <= self.rho <= 1.0:
            raise ConfigError(
                f"wind.rho must lie in [0, 1] (0: a new field at every wind time, 1: one frozen field), got "
                f"{self.rho}"
            )
        if self.source in ("csv", "grib") and not self.path:
            raise ConfigError(f"wind.path is missing: wind.source={self.source} needs a file to read")


@dataclass
class FidelityConfig:
    """The models that plans are made with. ``conf/fidelity/`` holds the presets; each can be set alone."""

    name: str = "paper"  # the preset that the others began with
    law: str = "independent"  # wind that plans are judged in: independent, coherent
    mission_bound: str = "theorem2"  # mission risk: theorem2 (the paper's f_o), ordered (V)
    collision_bound: str = "step"  # step (Eqs. 9 and 10), path (R)
    parents: str = "dominance"  # rule of re-selection: dominance (Eqs. 11, 12), scaled, tchebycheff, mixed
    refine: str = "convex"  # what is done to the trees' paths: none, convex
    judge: str = "bound"  # what ranks the front and accepts the plan: bound, flights

    def __post_init__(self) -> None:
        _one_of("fidelity", self.name, tuple(PRESETS))
        _one_of("fidelity.law", self.law, LAWS)
        _one_of("fidelity.mission_bound", self.mission_bound, MISSION_BOUNDS)
        _one_of("fidelity.collision_bound", self.collision_bound, COLLISION_BOUNDS)
        _one_of("fidelity.parents", self.parents, PARENT_RULES)
        _one_of("fidelity.refine", self.refine, REFINEMENTS)
        _one_of("fidelity.judge", self.judge, JUDGES)

    @property
    def label(self) -> str:
        """``full``, or ``full with parents=scaled`` where a choice of the preset was changed."""
        usual = PRESETS[self.name]
        changed = [f"{key}={getattr(self, key)}" for key in usual if getattr(self, key) != usual[key]]
        return f"{self.name} with {', '.join(changed)}" if changed else self.name


PRESETS: dict[str, dict[str, str]] = {
    "paper": {
        "law": "independent", "mission_bound": "theorem2", "collision_bound": "step",
        "parents": "dominance", "refine": "convex", "judge": "bound",
    },
    "full": {
        "law": "coherent", "mission_bound": "ordered", "collision_bound": "path",
        "parents": "mixed", "refine": "convex", "judge": "flights",
    },
}  # fmt: skip


def preset(name: str) -> FidelityConfig:
    """The models of ``fidelity=NAME``."""
    return FidelityConfig(name=name, **PRESETS[name])


PAPER = preset("paper")


@dataclass
class LogicConfig:
    max_states: int = 10_000

    def __post_init__(self) -> None:
        _at_least("logic.max_states", self.max_states, 2)


@dataclass
class PlannerConfig:
    trees: int = 10
    n_max: int = 2500  # vertices a tree
    # Collision probability allowed at a step; null: that of the collision bound (0.05 shared equally by the
    # obstacles with fidelity.collision_bound=step, 0.1 for all of them together with path)
    epsilon: float | None = None
    delta: float = 0.5  # collision probability allowed on a whole path (fidelity.collision_bound=path)
    max_steps: int = 200  # longest path
    near: int = 64  # parents tried for a new vertex, at most
    beta_risk: float = 0.05  # slack of Eq. (11) is drawn below this for risks
    beta_length: float = 1.0  # ... and below this many full steps for length
    explore: float = 0.1  # probability of a target beyond the next cell of the lead
    refresh: int = 16  # extensions between two leads of the high-level planner
    max_seconds: float = 600.0  # growth ends here at the latest
    threads: int = 0  # 0: one a core

    def __post_init__(self) -> None:
        _at_least("planner.trees", self.trees, 1)
        _at_least("planner.n_max", self.n_max, 2)
        if self.epsilon is not None:
            _probability("planner.epsilon", self.epsilon)
        _probability("planner.delta", self.delta)
        _at_least("planner.max_steps", self.max_steps, 1)
        _at_least("planner.near", self.near, 0)
        _not_negative("planner.beta_risk", self.beta_risk)
        _not_negative("planner.beta_length", self.beta_length)
        _at_least("planner.refresh", self.refresh, 1)
        _at_least("planner.threads", self.threads, 0)
        _positive("planner.max_seconds", self.max_seconds, "s")
        if not 0 <= self.explore <= 1:
            raise ConfigError(f"planner.explore must lie in [0, 1], got {self.explore}")


@dataclass
class SmoothingConfig:
    candidates: int = 4  # front paths smoothed, at most
    rounds: int = 3
    weights: list[float] = field(default_factory=lambda: [1.0, 10.0, 100.0])  # risk against length
    trust: float = 1.0  # trust region in full steps

    def __post_init__(self) -> None:
        _at_least("smoothing.candidates", self.candidates, 1)
        _at_least("smoothing.rounds", self.rounds, 1)
        _positive("smoothing.trust", self.trust)
        if not self.weights:
            raise ConfigError("smoothing.weights is empty: give at least one risk weight")
        for weight in self.weights:
            _not_negative("smoothing.weights", weight)


@dataclass
class SelectionConfig:
    rule: str = "priority"
    weights: list[float] = field(
        default_factory=lambda: [0.5, 0.25, 0.25]
    )  # mission risk, collision risk, length
    alpha: float = 0.05  # largest risk for rule=threshold
    draws: int = 2000  # linear flights that rank a path of the front (fidelity=full)
    runs: int = 2000  # nonlinear flights that examine the path chosen (fidelity=full)
    examined: int = 5  # paths examined, at most, until one keeps its promise

    def __post_init__(self) -> None:
        _kind_of("selection.rule", self.rule, SELECTION_RULES, extensions.SELECTION_RULE_GROUP)
        _probability("selection.alpha", self.alpha)
        for key in ("draws", "runs", "examined"):
            _at_least(f"selection.{key}", getattr(self, key), 1)
        if len(self.weights) != 3 or min(self.weights) < 0 or sum(self.weights) <= 0:
            raise ConfigError(
                "selection.weights must be three numbers >= 0, not all 0 "
                f"(mission risk, collision risk, length), got {self.weights}"
            )


@dataclass
class DeploymentConfig:
    runs: int = 500
    laws: list[str] = field(default_factory=lambda: ["independent", "coherent"])

    def __post_init__(self) -> None:
        _at_least("deployment.runs", self.runs, 1)
        for law in self.laws:
            _one_of("deployment.laws", law, LAWS)


@dataclass
class ReportConfig:
    figures: bool = True
    dpi: int = 200
    paths: int = 40  # deployed paths drawn

    def __post_init__(self) -> None:
        _at_least("report.dpi", self.dpi, 30)
        _at_least("report.paths", self.paths, 0)


@dataclass
class IngestConfig:
    """The table of figures that ``pipelines=ingest`` writes."""

    out: str = "wind_table.csv"
    points: int = 120  # a time, by farthest-point sampling
    area: list[Any] = field(default_factory=list)  # outline, [longitude, latitude] [deg]
    first: str | None = None  # ISO 8601 UTC
    last: str | None = None

    def __post_init__(self) -> None:
        _at_least("ingest.points", self.points, 3)
        _outline("ingest.area", self.area)


def _distinct(key: str, values: list[Any]) -> None:
    """A list that a study goes through: not empty, nothing twice."""
    if not values:
        raise ConfigError(f"{key} is empty: list at least one value, e.g. {key}=[1,2,3]")
    if len({str(value) for value in values}) < len(values):
        raise ConfigError(f"{key} lists a value twice, got {values}")


@dataclass
class EvaluationConfig:
    """What the studies (pipelines compare, convergence, ablation, hindcast) share."""

    seeds: list[int] = field(default_factory=lambda: list(range(20)))  # one plan each
    laws: list[str] = field(default_factory=lambda: list(LAWS))  # wind laws that plans are flown under
    jobs: int = 0  # processes; 0: one a core
    resume: str | None = None  # results directory of a run to go on with

    def __post_init__(self) -> None:
        for key, values in (("evaluation.seeds", self.seeds), ("evaluation.laws", self.laws)):
            if not values:
                raise ConfigError(f"{key} is empty: list at least one")
            _distinct(key, values)
        for seed in self.seeds:
            _not_negative("evaluation.seeds", seed)
        for law in self.laws:
            _one_of("evaluation.laws", law, LAWS)
        _at_least("evaluation.jobs", self.jobs, 0)


METHODS = ("paper", "smoothed", "full", "cc_rrt", "ml_rrt", "calm_shortest")


@dataclass
class CompareConfig:
    """Which planners ``pipelines=compare`` sets side by side; the first is the one the others differ from."""

    methods: list[str] = field(default_factory=lambda: list(METHODS))

    def __post_init__(self) -> None:
        if not self.methods:
            raise ConfigError(f"compare.methods is empty: list at least one of {', '.join(METHODS)}")
        for method in self.methods:
            _one_of("compare.methods", method, METHODS)
        _distinct("compare.methods", self.methods)


@dataclass
class ConvergenceConfig:
    """Vertices a tree at which ``pipelines=convergence`` looks at the growing forests."""

    sizes: list[int] = field(default_factory=lambda: [100, 200, 500, 1000, 2500, 5000, 10_000, 20_000])

    def __post_init__(self) -> None:
        _distinct("convergence.sizes", self.sizes)
        for size in self.sizes:
            _at_least("convergence.sizes", size, 2)


FACTORS = ("trees", "beta", "epsilon", "n_max", "dt", "kernel", "ball")


@dataclass
class AblationConfig:
    """What ``pipelines=ablation`` changes, one thing at a time, and the values it takes."""

    factors: list[str] = field(default_factory=lambda: list(FACTORS))
    trees: list[int] = field(default_factory=lambda: [1, 2, 5, 10, 20])
    beta: list[float] = field(default_factory=lambda: [0.0, 1.0, 10.0])  # times the planner's two betas
    epsilon: list[float] = field(default_factory=lambda: [0.01, 0.02, 0.05, 0.1, 0.2])
    n_max: list[int] = field(default_factory=lambda: [500, 1000, 2500, 5000, 10_000])
    dt: list[int] = field(default_factory=lambda: [1, 2, 4, 8, 16])  # pieces that a step is cut into
    kernel: list[str] = field(default_factory=lambda: list(KERNELS))
    ball: list[float] = field(default_factory=lambda: [0.0, 1.0, 2.0, 3.0])  # standard deviations

    def __post_init__(self) -> None:
        if not self.factors:
            raise ConfigError(f"ablation.factors is empty: list at least one of {', '.join(FACTORS)}")
        for factor in self.factors:
            _one_of("ablation.factors", factor, FACTORS)
        for factor in FACTORS:
            _distinct(f"ablation.{factor}", getattr(self, factor))
        for key in ("trees", "n_max", "dt"):
            for value in getattr(self, key):
                _at_least(f"ablation.{key}", value, 1)
        for value in (*self.beta, *self.ball):
            _not_negative("ablation.beta and ablation.ball", value)
        for epsilon in self.epsilon:
            _probability("ablation.epsilon", epsilon)
        for kernel in self.kernel:
            _one_of("ablation.kernel", kernel, KERNELS)


INLAND = (  # the contiguous United States without their rim [longitude, latitude] [deg]
    (-120.0, 46.5), (-118.5, 37.0), (-111.0, 33.5), (-103.0, 31.5), (-98.5, 29.0), (-91.0, 31.5),
    (-84.0, 32.5), (-80.5, 35.0), (-76.5, 40.5), (-84.0, 43.0), (-90.0, 45.5), (-97.0, 47.0), (-111.0, 47.0),
)  # fmt: skip


@dataclass
class HindcastConfig:
    """Random missions that ``pipelines=hindcast`` plans from few readings and flies through full fields."""

    truth: str | None = None  # folder of GRIB2 files; default: the NOAA files beside the checkout
    missions: int = 100
    plans: int = 3  # of each mission's front: safest, shortest and between
    points: int = 120  # readings a time that planning sees, spread over ``area``
    area: list[Any] = field(default_factory=lambda: [list(p) for p in INLAND])  # centres of scenes
    side: list[float] = field(default_factory=lambda: [400_000.0, 800_000.0])  # of a scene [m]
    obstacles: list[int] = field(default_factory=lambda: [2, 7])  # in a scene, at least and at most
    formulas: list[str] = field(
        default_factory=lambda: ["F(a & F b)", "F(a & F b & F c)", "F(a & F(b & F c))", "!b U a & F c"]
    )
    hours: float = 18.0  # wind that must be left after departure [h]
    max_gap: float = 6.0  # fields farther apart belong to different spells [h]
    gusts: float = 1.0  # share of the fitted white standard deviation added to the real fields
    spacing: float = 20_000.0  # lattice of the real fields [m]
    bins: int = 8  # of the reliability diagram

    def __post_init__(self) -> None:
        _at_least("hindcast.missions", self.missions, 1)
        _at_least("hindcast.plans", self.plans, 1)
        _at_least("hindcast.points", self.points, 5)
        _at_least("hindcast.bins", self.bins, 2)
        for key, pair in (("side", self.side), ("obstacles", self.obstacles)):
            if len(pair) != 2 or not 0 <= pair[0] <= pair[1]:
                raise ConfigError(f"hindcast.{key} must be [least, most], got {pair}")
        _positive("hindcast.side", self.side[0], "m")
        _outline("hindcast.area", self.area)
        if len(self.area) < 3:
            raise ConfigError("hindcast.area must be at least three corners [longitude, latitude]")
        if not self.formulas:
            raise ConfigError("hindcast.formulas is empty: list at least one, over the regions a, b and c")
        _positive("hindcast.hours", self.hours, "h")
        _positive("hindcast.max_gap", self.max_gap, "h")
        _not_negative("hindcast.gusts", self.gusts)
        _positive("hindcast.spacing", self.spacing, "m")


@dataclass
class PipelineConfig:
    stages: list[str] = field(default_factory=list)


@dataclass
class SweepConfig:
    """How many runs are carried out and shown together; no result depends on it."""

    resume: bool = True  # keep the answers that are there, and run only what failed, was killed or is new
    x: str | None = None  # the figure: a swept setting, or a metric; default: the first setting swept
    y: str | None = None  # the figure: a metric; default: the failure rate
    by: str | None = None  # the figure: one colour for each value of this swept setting


@dataclass
class Settings:
    """Everything a run needs."""

    name: str = "plan"
    seed: int = 0
    fidelity: FidelityConfig = field(default_factory=FidelityConfig)
    scene: SceneConfig = field(default_factory=SceneConfig)
    mission: MissionConfig = field(default_factory=MissionConfig)
    robot: RobotConfig = field(default_factory=RobotConfig)
    wind: WindConfig = field(default_factory=WindConfig)
    logic: LogicConfig = field(default_factory=LogicConfig)
    planner: PlannerConfig = field(default_factory=PlannerConfig)
    smoothing: SmoothingConfig = field(default_factory=SmoothingConfig)
    selection: SelectionConfig = field(default_factory=SelectionConfig)
    deployment: DeploymentConfig = field(default_factory=DeploymentConfig)
    report: ReportConfig = field(default_factory=ReportConfig)
    ingest: IngestConfig = field(default_factory=IngestConfig)
    pipelines: PipelineConfig = field(default_factory=PipelineConfig)
    evaluation: EvaluationConfig = field(default_factory=EvaluationConfig)
    compare: CompareConfig = field(default_factory=CompareConfig)
    convergence: ConvergenceConfig = field(default_factory=ConvergenceConfig)
    ablation: AblationConfig = field(default_factory=AblationConfig)
    hindcast: HindcastConfig = field(default_factory=HindcastConfig)
    sweep: SweepConfig = field(default_factory=SweepConfig)

    def __post_init__(self) -> None:
        _not_negative("seed", self.seed)


def as_dict(settings: Any) -> dict[str, Any]:
    """Settings as plain containers, ready for YAML or JSON."""
    from dataclasses import asdict

    return asdict(settings)
