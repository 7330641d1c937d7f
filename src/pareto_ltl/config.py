"""Settings of every stage, checked when they are made.

YAML lives in ``conf/``; these dataclasses are its schema. ``app.py`` turns a composed configuration
into a :class:`Settings`; past that line nobody sees Hydra. Every check names the key as a user types it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

from pareto_ltl.errors import ConfigError

FIDELITIES = ("paper",)
WIND_SOURCES = ("sample", "csv", "grib", "calm")
KERNELS = ("matern32", "rbf")
RULES = ("priority", "weighted", "threshold")
LAWS = ("independent",)


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


def _matrix(key: str, value: list[list[float]]) -> None:
    if [len(row) for row in value] != [2, 2]:
        raise ConfigError(f"{key} must be a 2 x 2 matrix, got {value}")


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
    bounds: list[list[float]] = field(default_factory=list)  # [[west, south], [east, north]]
    start: list[float] = field(default_factory=list)
    regions: dict[str, list[list[float]]] = field(default_factory=dict)
    obstacles: list[list[list[float]]] = field(default_factory=list)
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
    a: list[list[float]] = field(default_factory=lambda: [[1.0, 0.0], [0.0, 1.0]])
    b: list[list[float]] = field(default_factory=lambda: [[1.0, 0.0], [0.0, 1.0]])
    start_sd: float = 0.0  # standard deviation of the start position [m]

    def __post_init__(self) -> None:
        _positive("robot.dt", self.dt, "s")
        _positive("robot.u_max", self.u_max, "m/s")
        _not_negative("robot.start_sd", self.start_sd, "m")
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
    cache: bool = True

    def __post_init__(self) -> None:
        _one_of("wind.source", self.source, WIND_SOURCES)
        _one_of("wind.kernel", self.kernel, KERNELS)
        _positive("wind.noise_min", self.noise_min, "m/s")
        _positive("wind.spacing", self.spacing, "m")
        _not_negative("wind.padding", self.padding, "m")
        _not_negative("wind.ball", self.ball)
        _positive("wind.max_speed", self.max_speed, "m/s")
        _probability("wind.holdout", self.holdout)
        _at_least("wind.max_points", self.max_points, 5)
        if self.source in ("csv", "grib") and not self.path:
            raise ConfigError(f"wind.path is missing: wind.source={self.source} needs a file to read")


@dataclass
class LogicConfig:
    max_states: int = 10_000

    def __post_init__(self) -> None:
        _at_least("logic.max_states", self.max_states, 2)


@dataclass
class PlannerConfig:
    trees: int = 10
    n_max: int = 2500  # vertices a tree
    epsilon: float = 0.05  # collision probability allowed at a step, shared equally by the obstacles
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
        _probability("planner.epsilon", self.epsilon)
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
    enabled: bool = True
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

    def __post_init__(self) -> None:
        _one_of("selection.rule", self.rule, RULES)
        _probability("selection.alpha", self.alpha)
        if len(self.weights) != 3 or min(self.weights) < 0 or sum(self.weights) <= 0:
            raise ConfigError(
                "selection.weights must be three numbers >= 0, not all 0 "
                f"(mission risk, collision risk, length), got {self.weights}"
            )


@dataclass
class DeploymentConfig:
    runs: int = 500
    laws: list[str] = field(default_factory=lambda: ["independent"])

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
    area: list[list[float]] = field(default_factory=list)  # outline, [longitude, latitude] [deg]
    first: str | None = None  # ISO 8601 UTC
    last: str | None = None

    def __post_init__(self) -> None:
        _at_least("ingest.points", self.points, 3)


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
    fidelity: str = "paper"
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
    sweep: SweepConfig = field(default_factory=SweepConfig)

    def __post_init__(self) -> None:
        _one_of("fidelity", self.fidelity, FIDELITIES)
        _not_negative("seed", self.seed)


def as_dict(settings: Any) -> dict[str, Any]:
    """Settings as plain containers, ready for YAML or JSON."""
    from dataclasses import asdict

    return asdict(settings)
