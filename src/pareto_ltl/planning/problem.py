"""Scene, wind, automaton and robot as one bundle of bare arrays, made once a run.

Every later stage (growth, smoothing, selection, deployment) and the reference formulas in ``risk.py``
read the same tables, so that a path costs the same wherever it is asked for.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pareto_ltl.kernels import data as kt
from pareto_ltl.logic.automaton import Automaton
from pareto_ltl.planning.records import Objectives, PlannedPath
from pareto_ltl.settings import PAPER, FidelityConfig, PlannerConfig, RobotConfig, WindConfig
from pareto_ltl.support.arrays import Float32Array, FloatArray, IntArray
from pareto_ltl.support.errors import DataError, InfeasibleError
from pareto_ltl.wind.records import WindField
from pareto_ltl.world.cells import Decomposition, half_planes, locator
from pareto_ltl.world.scene import Scene

if TYPE_CHECKING:
    from pareto_ltl.kernels.track import Track

EPSILON = {"step": 0.05, "path": 0.1}  # where planner.epsilon is left to the collision bound

LOG = logging.getLogger(__name__)

__all__ = ["FAULTS", "Forecast", "Problem", "accepted", "build", "evaluate", "forecast", "half_planes"]


@dataclass(frozen=True, slots=True)
class Problem:
    """What is to be planned.

    Attributes
    ----------
    tables : kernels.tables.Tables
        The arrays that the kernels read.
    atoms : tuple of str
        Propositions of the mission, the columns of every ``risk`` array.
    labels : tuple of frozenset of str
        Label of each cell.
    epsilon : float
        Collision probability allowed at a step (Eq. 4).
    """

    scene: Scene
    decomposition: Decomposition
    tables: kt.Tables
    automaton: Automaton
    atoms: tuple[str, ...]
    labels: tuple[frozenset[str], ...]
    start_variance: float
    epsilon: float
    max_steps: int
    parents: str

    @property
    def horizon(self) -> int:
        """Number of steps for which the wind is known, at most ``planner.max_steps``."""
        return min(len(self.tables.wind.slot), self.max_steps)

    def locate(self, points: FloatArray) -> IntArray:
        """Cell of each row of ``points`` (P, 2); -1 in an obstacle or off the map."""
        from pareto_ltl.kernels.geometry import locate_many

        cells: IntArray = locate_many(self.tables.cells, np.ascontiguousarray(points))
        return cells

    @property
    def reach(self) -> float:
        """Longest step in still air [m]."""
        return self.tables.motion.u_max * self.tables.motion.dt


def faces(polygons: Sequence[FloatArray]) -> kt.Faces:
    """Half planes of convex polygons, one after another."""
    ptr = np.concatenate([[0], np.cumsum([len(p) for p in polygons])]).astype(np.int64)
    if not polygons:
        return kt.Faces(ptr, np.empty((0, 2)), np.empty(0))
    parts = [half_planes(p) for p in polygons]
    return kt.Faces(ptr, np.vstack([n for n, _ in parts]), np.concatenate([b for _, b in parts]))


def cell_tables(bounds: FloatArray, decomposition: Decomposition, atoms: Sequence[str]) -> kt.Cells:
    """Cells behind their grid of buckets, with the propositions that hold in each."""
    (west, south), (east, north) = bounds
    grid = locator(decomposition, bounds)
    holds = np.array([[atom in label for atom in atoms] for label in decomposition.labels], bool)
    return kt.Cells(
        float(west), float(south), float(east), float(north), int(grid.shape[0]), grid.ptr, grid.index,
        faces(decomposition.cells), holds.reshape(len(decomposition.cells), len(atoms)),
    )  # fmt: skip


def wind_tables(field: WindField, dt: float, max_steps: int) -> kt.Wind:
    """The lattice, and for every step the slots between which it lies."""
    t = dt * np.arange(max_steps)
    if not field.hold_last:
        t = t[t <= field.times[-1] + 1e-6]
    if len(t) == 0 or field.times[0] > 1e-6:
        raise DataError(
            f"the wind is known from {field.times[0]:.0f} s to {field.times[-1]:.0f} s after departure, "
            "not at departure itself; give mission.start_time within the data"
        )
    slot = np.clip(np.searchsorted(field.times, t, side="right") - 1, 0, max(len(field.times) - 2, 0))
    if len(field.times) == 1:
        weight = np.zeros(len(t))
    else:
        weight = np.clip((t - field.times[slot]) / np.diff(field.times)[slot], 0.0, 1.0)
    return kt.Wind(
        float(field.origin[0]), float(field.origin[1]), 1.0 / field.spacing, slot.astype(np.int64), weight,
        np.ascontiguousarray(field.mean), np.ascontiguousarray(field.latent_var),
        np.ascontiguousarray(field.gust_var),
    )  # fmt: skip


def mode_tables(field: WindField, wind: kt.Wind, dt: float) -> kt.Modes:
    """The coherent law: every step belongs to the slot nearest in time, and θ persists from slot to slot."""
    steps, times = len(wind.slot), field.times
    slot = np.where(wind.weight > 0.5, wind.slot + 1, wind.slot)
    if field.modes is None:
        origin, spacing, psi, rho, gap = (
            np.zeros(2),
            1.0,
            np.zeros((len(times), 2, 2, 2, 0), np.float32),
            1.0,
            1.0,
        )
    else:
        m = field.modes
        origin, spacing, psi, rho, gap = m.origin, m.spacing, m.psi, m.rho, m.gap
    passed = np.diff(times[slot], prepend=times[slot[0]]) / gap
    keep = np.ones(steps + 1)
    keep[:steps] = np.where(passed > 0.0, rho ** np.maximum(passed, 0.0), 1.0)
    slope, bend = derivatives(field.mean, field.spacing)
    return kt.Modes(
        float(origin[0]), float(origin[1]), 1.0 / spacing, slot.astype(np.int64), keep,
        np.ascontiguousarray(psi, np.float32), slope, bend, field.gust_time / dt,
    )  # fmt: skip


def derivatives(mean: FloatArray, spacing: float) -> tuple[FloatArray, FloatArray]:
    """First (K, NX, NY, 4) and second (K, NX, NY, 6) central differences of the expected wind."""

    def along(table: FloatArray, axis: int) -> FloatArray:
        return np.asarray(np.gradient(table, spacing, axis=axis), float)

    x, y = along(mean, 1), along(mean, 2)
    slope = np.stack([x[..., 0], y[..., 0], x[..., 1], y[..., 1]], axis=-1)
    xx, xy, yy = along(x, 1), 0.5 * (along(x, 2) + along(y, 1)), along(y, 2)
    bend = np.stack([d[..., c] for c in (0, 1) for d in (xx, xy, yy)], axis=-1)
    return np.ascontiguousarray(slope), np.ascontiguousarray(bend)


def labelled_tables(decomposition: Decomposition) -> kt.Labelled:
    """The cells with a label, as corners in their order."""
    cell = [c for c, label in enumerate(decomposition.labels) if label]
    return corner_tables(cell, [decomposition.cells[c] for c in cell])


def corner_tables(cell: Sequence[int], corners: Sequence[FloatArray]) -> kt.Labelled:
    """Polygons as corners, with a circle around each."""
    middle = np.array([polygon.mean(axis=0) for polygon in corners]).reshape(-1, 2)
    radius = [np.linalg.norm(polygon - m, axis=1).max() for polygon, m in zip(corners, middle, strict=True)]
    return kt.Labelled(
        np.array(cell, np.int64), middle, np.array(radius, float),
        np.concatenate([[0], np.cumsum([len(polygon) for polygon in corners])]).astype(np.int64),
        np.vstack([np.empty((0, 2)), *corners]),
    )  # fmt: skip


def region_tables(decomposition: Decomposition, atoms: Sequence[str]) -> kt.Regions:
    """Convex parts of the regions that the mission speaks of."""
    parts = [(atoms.index(name), part) for name in atoms for part in decomposition.regions.get(name, ())]
    return kt.Regions(faces([part for _, part in parts]), np.array([atom for atom, _ in parts], np.int64))


def logic_tables(automaton: Automaton, labels: Sequence[frozenset[str]]) -> kt.Logic:
    """The automaton with one column a cell instead of one a letter, and one for no label at all."""
    column = [automaton.letter_index(label) for label in (*labels, frozenset())]
    delta, covers = (
        np.ascontiguousarray(automaton.delta[:, column]),
        np.ascontiguousarray(automaton.preorder, bool),
    )
    return kt.Logic(
        delta, np.asarray(automaton.distance, float), covers, np.ascontiguousarray(~covers[delta]),
        int(automaton.initial),
    )  # fmt: skip


def build(
    robot: RobotConfig, planner: PlannerConfig, wind_cfg: WindConfig, scene: Scene, wind: WindField,
    decomposition: Decomposition, automaton: Automaton, fidelity: FidelityConfig = PAPER,
) -> Problem:  # fmt: skip
    """Check what only shows when everything is together, and pack it.

    Raises
    ------
    DataError
        Where the wind is not known at departure, or the robot cannot hold its own against it anywhere.
    """
    from scipy.special import ndtri

    atoms = tuple(automaton.atoms)
    m = max(len(decomposition.obstacles), 1)
    epsilon = EPSILON[fidelity.collision_bound] if planner.epsilon is None else planner.epsilon
    a, b = np.array(robot.a, float), np.array(robot.b, float)
    marks = scene.landmarks if fidelity.law == "coherent" else ()
    if scene.landmarks and fidelity.law != "coherent":
        LOG.warning("scene.landmarks are left unused: only fidelity.law=coherent knows position fixes")
    winds = wind_tables(wind, robot.dt, planner.max_steps)
    gain, effort = robot.feedback, math.sqrt(-2.0 * math.log(robot.effort_risk))
    tables = kt.Tables(
        wind=winds,
        modes=mode_tables(wind, winds, robot.dt),
        motion=kt.Motion(
            a=a,
            closed=a - gain * np.eye(2),
            gain=gain,
            effort=effort,
            fix_gain=robot.fix_gain,
            fix_variance=robot.fix_sd**2,
            fix_risk=robot.fix_risk,
            b_inv=np.linalg.inv(b),
            dt=robot.dt,
            u_max=robot.u_max,
            ball=wind_cfg.ball,
        ),
        obstacles=faces(decomposition.obstacles),
        cells=cell_tables(scene.bounds, decomposition, atoms),
        regions=region_tables(decomposition, atoms),
        labelled=labelled_tables(decomposition),
        landmarks=faces(marks),
        spots=corner_tables(range(len(marks)), marks),
        logic=logic_tables(automaton, decomposition.labels),
        z=float(-ndtri(epsilon / m)),
        epsilon=epsilon,
        delta=planner.delta,
        full=fidelity.law == "coherent",
    )
    calmest = float(np.linalg.norm(wind.mean, axis=-1).min())
    if calmest > robot.u_max:
        raise DataError(
            f"robot.u_max = {robot.u_max:g} m/s is below the wind everywhere on the map (at least "
            f"{calmest:.1f} m/s): the robot could only drift; raise robot.u_max or change mission.start_time"
        )
    return Problem(
        scene,
        decomposition,
        tables,
        automaton,
        atoms,
        decomposition.labels,
        robot.start_sd**2,
        epsilon,
        planner.max_steps,
        fidelity.parents,
    )


FAULTS = (
    "",
    "needs more airspeed than robot.u_max",
    "outlasts the wind data",
    "leaves the map or enters an obstacle",
    "comes closer to an obstacle than planner.epsilon allows",
)


def evaluate(
    problem: Problem, x: FloatArray, origin: str, tolerance: float = 1e-6, *, tight: bool = True
) -> PlannedPath:
    """Fly the means ``x`` (T+1, 2) and return the path with its exact cost.

    ``tight=False`` leaves out what only the final verdict needs: the tighter form of R of full fidelity,
    which asks for the correlation of all pairs of steps.

    Raises
    ------
    InfeasibleError
        With what is wrong and at which step.
    """
    from pareto_ltl.kernels import path as kernel
    from pareto_ltl.kernels.mission_risk import mission_bound

    tables, steps = problem.tables, len(x)
    cov3, u = np.empty((steps, 3)), np.empty((steps - 1, 2))
    q, cell = np.empty(steps, np.int64), np.empty(steps, np.int64)
    f_o, touch = np.empty(len(problem.atoms)), np.empty((steps, len(tables.obstacles.ptr) - 1))
    course, miss = trail(problem, steps), np.empty(steps)
    fault, where = kernel.evaluate(
        tables, x, problem.start_variance, 1.0 + tolerance, cov3, u, q, cell, f_o, touch, course, miss
    )
    if fault != kernel.FLOWN:
        raise InfeasibleError(f"the path {FAULTS[fault]} at step {where} of {steps - 1}")
    cross = _cross(problem, x, cov3, course) if tables.full and tight else np.empty((0, 0, 2, 2))
    collision = float(kernel.collision_bound(tables, x, cov3, cross))
    if tables.full and collision > tables.delta and tight:
        raise InfeasibleError(
            f"the path may collide with probability {collision:.3f}, above planner.delta = {tables.delta:g}"
        )
    paper = float(f_o.sum()) if not tables.full else _paper_risk(problem, x, cell)
    return PlannedPath(
        t=tables.motion.dt * np.arange(steps, dtype=float),
        x=x,
        cov=square(cov3),
        q=q,
        label=tuple(problem.labels[c] for c in cell),
        u=u,
        objectives=Objectives(
            length=float(np.linalg.norm(np.diff(x, axis=0), axis=1).sum()),
            mission_risk_paper=min(1.0, paper),
            mission_risk=float(mission_bound(tables, x, cov3, miss)),
            collision_risk=collision,
        ),
        origin=origin,
        fixes=fixes(course, steps),
    )


def track(rows: int, modes: int, *, landmarks: bool) -> Track:
    """Room for the coherent law of ``rows`` vertices; without landmarks for Cov(e, θ) alone."""
    from pareto_ltl.kernels.track import Track

    n = rows if landmarks else 0
    return Track(
        theta=np.zeros((rows, 2, 2, modes), np.float32), known=np.empty((n, 3)), fix=np.full(n, -1, np.int64),
        faded=np.ones(n), gain=np.empty((n, 2, 2, modes), np.float32), previous=np.empty(n, np.int64),
        share=np.empty(n), used=np.zeros(1, np.int64),
    )  # fmt: skip


def trail(problem: Problem, steps: int) -> Track:
    """The track of one path of ``steps`` positions."""
    tables = problem.tables
    return track(steps, tables.modes.psi.shape[-1], landmarks=len(tables.landmarks.ptr) > 1)


def fixes(course: Track, steps: int) -> tuple[int, ...]:
    """Steps of a path at which it counts on a position fix."""
    fix = course.fix[: steps - 1]
    return tuple(int(t) for t in np.flatnonzero(np.diff(fix, prepend=-1) > 0))


def square(cov3: FloatArray) -> FloatArray:
    """Covariances (T+1, 2, 2) from rows (xx, xy, yy)."""
    return cov3[:, [0, 1, 1, 2]].reshape(-1, 2, 2)


def _paper_risk(problem: Problem, x: FloatArray, cell: IntArray) -> float:
    """Theorem 2 with the paper's own covariance, for the record of a plan of full fidelity."""
    from pareto_ltl.kernels import path as kernel

    cov3 = np.empty((len(x), 3))
    kernel.paper_covariance(problem.tables, x, problem.start_variance, cov3)
    risk = np.empty(len(problem.atoms))
    kernel.paper_risk(problem.tables, x, cov3, cell, risk)
    return float(risk.sum())


def _cross(problem: Problem, x: FloatArray, cov3: FloatArray, course: Track) -> FloatArray:
    """Cov(e_t, e_s) along a path under the coherent law, (T+1, T+1, 2, 2); empty where a fix cuts it."""
    from pareto_ltl.kernels import path as kernel

    if fixes(course, len(x)):
        return np.empty((0, 0, 2, 2))
    F, psi, _ = linear_law(problem, x)
    cross = np.zeros((len(x), len(x), 2, 2))
    kernel.across_time(problem.tables, F, psi, course.theta.astype(float), cov3, cross)
    return cross


def linear_law(problem: Problem, x: FloatArray) -> tuple[FloatArray, Float32Array, FloatArray]:
    """The coherent law about the means ``x`` (T+1, 2): F_t (T, 2, 2), ψ(x_t) (T, 2, P), white variance (T,
    2).
    """
    from pareto_ltl.kernels import path as kernel

    steps = len(x) - 1
    F, noise = np.empty((steps, 2, 2)), np.empty((steps, 2))
    psi = np.empty((steps, 2, problem.tables.modes.psi.shape[-1]), np.float32)
    kernel.linearise(problem.tables, x, F, psi, noise)
    return F, psi, noise


@dataclass(frozen=True, slots=True)
class Forecast:
    """The Gaussian of a flight of given controls under one wind law, and what it promises.

    Attributes
    ----------
    x : (T+1, 2) float, cov : (T+1, 2, 2) float
        Mean [m] and covariance [m²].
    mission_risk, collision_risk : float
        V and R under this law.
    """

    law: str
    x: FloatArray
    cov: FloatArray
    mission_risk: float
    collision_risk: float


def forecast(problem: Problem, u: FloatArray, law: str) -> Forecast:
    """What the controls ``u`` (T, 2) promise under a wind law, whatever fidelity they were planned with."""
    from pareto_ltl.kernels import path as kernel
    from pareto_ltl.kernels.mission_risk import mission_bound

    coherent = law == "coherent"
    tables = problem.tables._replace(full=coherent)
    x, cov3 = np.empty((len(u) + 1, 2)), np.empty((len(u) + 1, 3))
    x[0] = problem.scene.start
    course, miss = trail(problem, len(x)), np.empty(len(x))
    b = np.asarray(np.linalg.inv(tables.motion.b_inv), float)
    kernel.foresee(tables, b, u, problem.start_variance, coherent, x, cov3, course, miss)
    cross = _cross(problem, x, cov3, course) if coherent else np.empty((0, 0, 2, 2))
    return Forecast(
        law, x, square(cov3), float(mission_bound(tables, x, cov3, miss)),
        float(kernel.collision_bound(tables, x, cov3, cross)),
    )  # fmt: skip


def accepted(problem: Problem, path: PlannedPath) -> bool:
    """Whether the expected path completes the mission, Eq. (3)."""
    return bool(problem.automaton.distance[path.q[-1]] == 0.0)
