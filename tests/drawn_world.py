"""Records of a run for figures, made without planning: a cyclone, three random trees, a route and flights."""

from __future__ import annotations

from typing import Any

import numpy as np

from pareto_ltl.planning.records import Forest, Front, Objectives, Plan, PlannedPath, Tree
from pareto_ltl.simulation.records import Deployment
from pareto_ltl.wind.records import WindField
from pareto_ltl.world.cells import Decomposition
from pareto_ltl.world.scene import Scene

KM = 1e3
UNIT = 100 * KM
CRS = "+proj=stere +lat_0=37 +lon_0=-92 +k=1 +datum=WGS84 +units=m +no_defs"
REGIONS = {
    "a": [(1.0, 7.4), (2.4, 7.0), (2.8, 8.2), (1.6, 9.0)],
    "b": [(7.6, 7.4), (9.0, 7.4), (9.0, 8.8), (7.6, 8.8)],
    "c": [(7.4, 1.2), (8.8, 1.0), (9.2, 2.2), (8.0, 2.8), (7.2, 2.2)],
}
OBSTACLES = [
    [(0.9, 2.6), (3.0, 2.2), (3.4, 3.4), (1.4, 4.0)],
    [(0.0, 5.2), (1.9, 5.0), (2.0, 5.9), (0.0, 6.1)],
    [(3.4, 5.6), (4.6, 5.2), (5.2, 6.6), (4.4, 7.6), (3.5, 7.0)],
    [(4.6, 1.4), (5.8, 1.0), (6.2, 3.4), (5.0, 3.8)],
    [(6.2, 4.6), (8.4, 4.2), (8.8, 5.4), (6.6, 6.0)],
    [(4.4, 8.4), (6.4, 8.0), (6.6, 9.2), (5.0, 9.4)],
]
ROUTE = [
    (0.8, 0.7),
    (4.0, 3.2),
    (2.6, 5.0),
    (2.6, 7.2),
    (3.5, 8.0),
    (5.8, 7.3),
    (8.1, 7.9),
    (9.3, 6.2),
    (9.3, 4.2),
    (8.2, 2.2),
]


def scene_of(crs: str | None = CRS, scale: float = UNIT) -> Scene:
    return Scene(
        bounds=np.array([[0.0, 0.0], [10.0, 10.0]]) * scale,
        start=np.array(ROUTE[0]) * scale,
        regions={name: np.array(polygon) * scale for name, polygon in REGIONS.items()},
        obstacles=tuple(np.array(polygon) * scale for polygon in OBSTACLES),
        crs=crs,
        time_zero="2018-10-09T00:00:00+00:00",
    )


def decomposition_of(scene: Scene) -> Decomposition:
    """Triangles of the free space; only their outlines matter here."""
    import shapely

    free = shapely.box(*scene.bounds.ravel()).difference(
        shapely.union_all([shapely.Polygon(o) for o in scene.obstacles])
    )
    cells = tuple(np.array(t.exterior.coords)[:3] for t in shapely.constrained_delaunay_triangles(free).geoms)
    regions = dict(scene.regions)
    return Decomposition(
        cells, (frozenset[str](),) * len(cells), np.empty((0, 2), np.int64), scene.obstacles, regions
    )


def wind_of(speed: float = 9.0, spacing: float = 25 * KM) -> WindField:
    """A cyclone that comes in from the south-east on a westerly wind."""
    axis = np.arange(-150 * KM, 1150 * KM + 1, spacing)
    times = np.arange(14) * 10_800.0
    x, y = np.meshgrid(axis, axis, indexing="ij")
    fields = []
    for t in times:
        dx, dy = x - (1250 - 5e-3 * t) * KM, y - (-200 + 4e-3 * t) * KM
        swirl = 2.2 * speed * np.exp(-np.hypot(dx, dy) / (350 * KM)) / (np.hypot(dx, dy) + 50 * KM)
        fields.append(
            np.stack(
                [
                    0.4 * speed * np.cos(y / (400 * KM)) - swirl * dy,
                    0.3 * speed * np.sin(x / (300 * KM)) + swirl * dx,
                ],
                -1,
            )
        )
    sd = 1.0 + 0.8 * np.sin(x / (90 * KM)) ** 2 * np.cos(y / (110 * KM)) ** 2
    latent = np.broadcast_to((sd**2)[None, ..., None], (14, *x.shape, 2)).copy()
    return WindField(
        np.array([axis[0]] * 2),
        spacing,
        times,
        np.array(fields),
        latent,
        np.full((14, 2), 0.8),
        source="synthetic",
    )


def tree_of(scene: Scene, vertices: int, rng: np.random.Generator) -> Tree:
    """A rapidly exploring random tree that ignores obstacles."""
    reach = 0.054 * float(np.ptp(scene.bounds[:, 0]))
    x, parent, length = np.empty((vertices, 2)), np.full(vertices, -1), np.zeros(vertices)
    x[0] = scene.start
    for n, target in enumerate(rng.uniform(*scene.bounds, size=(vertices - 1, 2)), start=1):
        near = int(np.argmin(((x[:n] - target) ** 2).sum(axis=1)))
        step = target - x[near]
        x[n] = x[near] + step * min(1.0, reach / np.hypot(*step))
        parent[n], length[n] = near, length[near] + np.hypot(*(x[n] - x[near]))
    risk = np.minimum(1.0, 10.0 ** rng.normal(-3.0, 1.0, (vertices, 3)))
    zeros = np.zeros(vertices, np.int64)
    return Tree(x, parent, zeros, zeros, zeros, length, risk, np.empty((0, 2, 5)), np.zeros(2), 0.1, {})


def forest_of(scene: Scene, trees: int = 3, vertices: int = 200, accepted: bool = True) -> Forest:
    rng = np.random.default_rng(5)
    grown = tuple(tree_of(scene, vertices, rng) for _ in range(trees))
    late = [
        (j, v)
        for j, tree in enumerate(grown)
        for v in np.flatnonzero(tree.length > np.quantile(tree.length, 0.9))
    ]
    return Forest(grown, np.array(late if accepted else [], np.int64).reshape(-1, 2), 0.1)


def path_of(
    scene: Scene, mission: float = 0.0062, collision: float = 0.011, longer: float = 1.0
) -> PlannedPath:
    """The route in steps of a half-hour's flight, with a covariance that grows along it."""
    corners = np.array(ROUTE) * np.ptp(scene.bounds[:, 0]) / 10
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(corners, axis=0).T))])
    s = np.linspace(0.0, along[-1], 46)
    x = np.column_stack([np.interp(s, along, corners[:, i]) for i in range(2)])
    steps = np.arange(46.0)[:, None, None]
    cov = steps * np.array([[1.0, 0.35], [0.35, 0.7]]) * (0.0036 * np.ptp(scene.bounds[:, 0])) ** 2
    length = float(along[-1]) * longer
    objectives = Objectives({"length": length}, mission, mission, collision, mission)
    return PlannedPath(
        np.arange(46) * 1800.0,
        x,
        cov,
        np.zeros(46, np.int64),
        (frozenset(),) * 46,
        np.diff(x, axis=0) / 1800,
        objectives,
        "",
    )


def plan_of(path: PlannedPath, formula: str = "F(a & F b & F c)") -> Plan:
    return Plan(path, formula, ("a", "b", "c"), 1800.0, 30.0, 0.05, "paper", "priority", ())


def front_of(
    scene: Scene,
    risks: tuple[float, ...] = (2e-4, 0.0062, 0.03),
    collisions: tuple[float, ...] = (3e-3, 0.011, 0.03),
) -> Front:
    paths = tuple(
        path_of(scene, m, r, 1.1 - 0.05 * i) for i, (m, r) in enumerate(zip(risks, collisions, strict=True))
    )
    raw = tuple(
        Objectives({"length": p.objectives.length * 1.08}, *(min(1.0, 2.5 * r) for r in (m, m, c, m)))
        for p in paths
        for m, c in [(p.objectives.mission_risk, p.objectives.collision_risk)]
    )
    return Front(paths, raw, 0.5, np.ones(3))


def flights_of(path: PlannedPath, runs: int = 60, law: str = "independent") -> Deployment:
    steps = np.linalg.cholesky(path.cov[1] - path.cov[0]) @ np.random.default_rng(3).normal(
        size=(runs, len(path.x) - 1, 2, 1)
    )
    x = path.x + np.concatenate([np.zeros((runs, 1, 2)), np.cumsum(steps[..., 0], axis=1)], axis=1)
    off = np.hypot(*(x[:, -1] - path.x[-1]).T)
    failed = off >= np.sort(off)[-3]
    return Deployment(law, x, ~failed, np.zeros(runs, bool), np.zeros(runs, bool))


def run_records() -> dict[str, Any]:
    """The arguments of a ``DrawnRun``."""
    scene = scene_of()
    front = front_of(scene)
    plan = plan_of(front.paths[0])
    return {
        "scene": scene,
        "decomposition": decomposition_of(scene),
        "wind": wind_of(),
        "forest": forest_of(scene),
        "front": front,
        "plan": plan,
        "deployments": {"independent": flights_of(plan.path)},
    }
