"""Small missions in simple made-up winds, shared by the suites of the planner.

The default robot flies 10 m/s in steps of 100 s, so a step in still air is 1 km; maps are tens of km wide.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path as FilePath

import numpy as np
import yaml

from pareto_ltl.logic.mission import automaton_of
from pareto_ltl.planning.pack import build_problem
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.records import Tree
from pareto_ltl.settings import (
    FidelityConfig,
    MissionConfig,
    PlannerConfig,
    RobotConfig,
    SceneConfig,
    WindConfig,
    preset,
)
from pareto_ltl.support.arrays import FloatArray, IntArray
from pareto_ltl.wind.records import WindField
from pareto_ltl.world import cells as workspace
from pareto_ltl.world.scene import Scene
from pareto_ltl.world.scene_settings import scene_from_settings as read_scene
from plane_kernels.types import Faces
from wind_laws.forecast_error import ForecastError
from wind_laws.records import FORECAST, SPACE, TIME, WindModes

KM = 1000.0
SCENES = FilePath(__file__).parents[1] / "conf" / "scene"
MISSIONS = {"phi1": "F(a & F b & F c)", "phi2": "F(a & F(b & F c)) | F(a & F(d & F c))"}
RARE = 1e-7  # chance at which a statistical test may fail by bad luck


def box(west: float, south: float, east: float, north: float) -> FloatArray:
    """Rectangle, counter-clockwise; kilometres in, metres out."""
    return np.array([[west, south], [east, south], [east, north], [west, north]]) * KM


def make_scene(
    regions: Mapping[str, FloatArray],
    obstacles: Sequence[FloatArray] = (),
    start: Sequence[float] = (1.0, 1.0),
    side: float = 20.0,
) -> Scene:
    """A square map from the origin; ``start`` and ``side`` in kilometres."""
    return Scene(
        bounds=np.array([[0.0, 0.0], [side, side]]) * KM,
        start=np.array(start, float) * KM,
        regions=dict(regions),
        obstacles=tuple(obstacles),
    )


def steady_wind(
    scene: Scene,
    mean: Sequence[float] = (0.0, 0.0),
    latent: Sequence[float] = (0.0, 0.0),
    gust: Sequence[float] = (1.0, 1.0),
    hours: float = 24.0,
    until: float | None = None,
) -> WindField:
    """The same wind everywhere and always: the position is exactly Gaussian."""
    width = scene.bounds[1] - scene.bounds[0]
    table = np.ones((2, 3, 3, 2))
    return WindField(
        origin=scene.bounds[0],
        spacing=float(width.max() / 2),
        times=np.array([0.0, hours * 3600.0]),
        mean=table * mean,
        latent_var=table * latent,
        gust_var=np.ones((2, 2)) * gust,
        until=until,
    )


def rough_wind(
    scene: Scene,
    speed: float = 3.0,
    variance: float = 1.0,
    slots: int = 4,
    hours: float = 2.0,
    until: float | None = None,
    nodes: int = 9,
    seed: int = 0,
) -> WindField:
    """A wind that differs in every node and slot, ``hours`` apart: a swapped index changes every value."""
    rng = np.random.default_rng(seed)
    width = float((scene.bounds[1] - scene.bounds[0]).max())
    shape = (slots, nodes, nodes + 1, 2)
    return WindField(
        origin=scene.bounds[0] - 0.1 * width,
        spacing=1.2 * width / (nodes - 1),
        times=np.arange(slots) * hours * 3600.0,
        mean=rng.uniform(-speed, speed, shape) / np.sqrt(2),
        latent_var=variance * rng.uniform(0.1, 1.0, shape),
        gust_var=variance * rng.uniform(0.1, 0.5, (slots, 2)),
        until=until,
    )


def smooth_wind(  # noqa: PLR0913, PLR0917 - every test names the few that it cares about
    scene: Scene,
    speed: float = 3.0,
    sd: float = 1.0,
    gust: float = 0.5,
    slots: int = 4,
    hours: float = 1.0,
    rho: float = 0.6,
    length: float | None = None,
    until: float | None = np.inf,
    seed: int = 0,
    error: ForecastError | None = None,
) -> WindField:
    """A gently curved expected wind, and errors of a squared-exponential covariance as exact modes.

    With ``error`` half of the variance comes from forecasts, and interpolation in time adds its variance.
    """
    rng = np.random.default_rng(seed)
    width = float((scene.bounds[1] - scene.bounds[0]).max())
    length = length or 0.5 * width
    nodes, spacing, origin = 15, 1.4 * width / 14, scene.bounds[0] - 0.2 * width
    grid = origin + spacing * np.stack(np.meshgrid(*[np.arange(nodes)] * 2, indexing="ij"), axis=-1)
    waves = rng.uniform(-1, 1, (slots, 2, 2)) * 2.0 / width
    mean = speed * np.stack(
        [np.sin(np.einsum("xyi,ki->kxy", grid, waves[:, c]) + rng.uniform(0, 6)) for c in (0, 1)], axis=-1
    )
    flat = grid.reshape(-1, 2)
    C = sd**2 * np.exp(-0.5 * (((flat[:, None] - flat[None]) / length) ** 2).sum(axis=-1))
    values, vectors = np.linalg.eigh(C)
    psi = (vectors * np.sqrt(np.maximum(values, 0.0)))[:, ::-1][:, :24].reshape(nodes, nodes, 24)
    part = np.full(24, SPACE)
    if error is not None:
        psi = np.concatenate([np.sqrt(0.5) * psi, np.sqrt(0.5) * psi, psi / sd], axis=-1)
        part = np.repeat([SPACE, FORECAST, TIME], 24)
    table = np.broadcast_to(psi[None, :, :, None], (slots, nodes, nodes, 2, len(part))).astype(np.float32)
    return WindField(
        origin=origin, spacing=spacing, times=np.arange(slots) * hours * 3600.0, mean=mean,
        latent_var=np.full((slots, nodes, nodes, 2), sd**2), gust_var=np.full((slots, 2), gust**2),
        until=until, gust_time=100.0,
        modes=WindModes(
            origin=origin, spacing=spacing, psi=np.ascontiguousarray(table), part=part, rho=rho,
            gap=hours * 3600.0, length=np.full((slots, 2), length), energy=np.ones((slots, 2)),
            rest_length=0.1 * length,
        ),
        error=error,
    )  # fmt: skip


QUICK_ERROR = ForecastError(
    name="made up", leads=np.array([0.0, 3600.0]), forecast_sd=np.array([0.2, 0.7]), forecast_length=5e3,
    persistence=0.8, persistence_time=1200.0, lags=np.array([600.0, 1800.0]),
    change_sd=np.array([0.6, 1.0]), change_length=5e3, level="10m", spread=3.0,
)  # fmt: skip


def make_problem(
    formula: str,
    scene: Scene,
    wind: WindField | None = None,
    robot: RobotConfig | None = None,
    planner: PlannerConfig | None = None,
    ball: float = 2.0,
    fidelity: str | FidelityConfig = "paper",
) -> Problem:
    """A problem of scene, wind and formula, made by the package's own decomposition and translation.

    ``fidelity`` names a preset or is a choice of models.
    """
    decomposition = workspace.decompose(scene)
    return build_problem(
        robot or RobotConfig(dt=100.0, u_max=10.0),
        planner or PlannerConfig(),
        WindConfig(ball=ball),
        scene,
        wind or steady_wind(scene),
        decomposition,
        automaton_of(
            MissionConfig(formula=formula),
            decomposition.letters,
            windows=scene.windows,
            forbidden=scene.forbidden,
        ),
        preset(fidelity) if isinstance(fidelity, str) else fidelity,
    )


def two_goals(formula: str = "F(a & F b)", **changes: object) -> Problem:
    """Two regions with two obstacles between, in a rough wind; 100 to 300 vertices are enough."""
    scene = make_scene(
        {"a": box(13, 2, 17, 6), "b": box(3, 13, 7, 17)},
        [box(7, 0.5, 9, 6), box(10, 10, 14, 13)],
        start=(2.0, 3.0),
    )
    options: dict[str, object] = {"wind": rough_wind(scene)} | changes
    return make_problem(formula, scene, **options)  # type: ignore[arg-type]


def paper_problem(name: str, planner: PlannerConfig | None = None, *, slots: int = 14) -> Problem:
    """``phi1`` or ``phi2`` at 100 km a unit, 1800 s a step, in a rough wind of up to 10 m/s."""
    settings = yaml.safe_load((SCENES / f"{name}.yaml").read_text())
    scene = replace(read_scene(SceneConfig(**settings), None), crs=None)
    wind = rough_wind(scene, speed=10.0, variance=3.0, slots=slots, hours=3.0)
    return make_problem(MISSIONS[name], scene, wind, RobotConfig(dt=1800.0), planner)


def polygon_faces(faces: Faces) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Normals (n, 2) and offsets (n,) of each polygon."""
    for first, last in zip(faces.ptr[:-1], faces.ptr[1:], strict=True):
        yield faces.normal[first:last], faces.offset[first:last]


def rows_to(tree: Tree, vertex: int) -> IntArray:
    """Vertices from the root to ``vertex``."""
    rows = [vertex]
    while tree.parent[rows[-1]] >= 0:
        rows.append(int(tree.parent[rows[-1]]))
    return np.array(rows[::-1], np.int64)


def leaves(tree: Tree) -> IntArray:
    """Vertices without children."""
    childless = np.ones(len(tree), bool)
    childless[tree.parent[1:]] = False
    return np.flatnonzero(childless)


def three_columns(cov: FloatArray) -> FloatArray:
    """Covariances (T, 2, 2) as rows (xx, xy, yy)."""
    return np.ascontiguousarray(cov.reshape(-1, 4)[:, [0, 1, 3]])


def along(*corners: Sequence[float], step: float = 0.4) -> FloatArray:
    """Positions (T+1, 2) [m], ``step`` km apart along straight legs between ``corners`` [km]."""
    legs = []
    for p, q in pairwise(np.array(corners, float)):
        n = max(1, int(np.ceil(np.linalg.norm(q - p) / step)))
        legs.append(p + np.arange(n)[:, None] / n * (q - p))
    return np.vstack([*legs, [corners[-1]]]) * KM


def random_covariances(rng: np.random.Generator, n: int, scale: float) -> FloatArray:
    """Positive definite matrices (n, 2, 2) with standard deviations about ``scale``."""
    root = scale * rng.standard_normal((n, 2, 2))
    return root @ root.transpose(0, 2, 1) + (0.05 * scale) ** 2 * np.eye(2)


def chi_square_chance(counts: FloatArray, expected: FloatArray) -> float:
    """p value of the counts of disjoint bins that contain every draw."""
    from scipy.stats import chi2

    return float(chi2.sf(((counts - expected) ** 2 / expected).sum(), len(counts) - 1))
