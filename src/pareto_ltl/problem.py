"""Scene, wind, automaton and robot as one bundle of bare arrays, made once a run.

Every later stage (growth, smoothing, selection, deployment) and the reference formulas in ``risk.py``
read the same tables, so that a path costs the same wherever it is asked for.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pareto_ltl.arrays import FloatArray, IntArray
from pareto_ltl.config import PlannerConfig, RobotConfig, WindConfig
from pareto_ltl.errors import DataError, InfeasibleError
from pareto_ltl.kernels import tables as kt
from pareto_ltl.logic.automaton import Automaton
from pareto_ltl.records import Decomposition, Objectives, Path, Scene, WindField
from pareto_ltl.workspace import half_planes, locator

__all__ = ["FAULTS", "Problem", "accepted", "build", "evaluate", "half_planes"]


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


def region_tables(decomposition: Decomposition, atoms: Sequence[str]) -> kt.Regions:
    """Convex parts of the regions that the mission speaks of."""
    parts = [(atoms.index(name), part) for name in atoms for part in decomposition.regions.get(name, ())]
    return kt.Regions(faces([part for _, part in parts]), np.array([atom for atom, _ in parts], np.int64))


def logic_tables(automaton: Automaton, labels: Sequence[frozenset[str]]) -> kt.Logic:
    """The automaton with one column a cell instead of one a letter, and one for no label at all."""
    column = [automaton.letter_index(label) for label in (*labels, frozenset())]
    return kt.Logic(
        np.ascontiguousarray(automaton.delta[:, column]), np.asarray(automaton.distance, float),
        np.ascontiguousarray(automaton.preorder, bool), int(automaton.initial),
    )  # fmt: skip


def build(
    robot: RobotConfig, planner: PlannerConfig, wind_cfg: WindConfig, scene: Scene, wind: WindField,
    decomposition: Decomposition, automaton: Automaton,
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
    a, b = np.array(robot.a, float), np.array(robot.b, float)
    tables = kt.Tables(
        wind=wind_tables(wind, robot.dt, planner.max_steps),
        motion=kt.Motion(a, np.linalg.inv(b), robot.dt, robot.u_max, wind_cfg.ball),
        obstacles=faces(decomposition.obstacles),
        cells=cell_tables(scene.bounds, decomposition, atoms),
        regions=region_tables(decomposition, atoms),
        logic=logic_tables(automaton, decomposition.labels),
        z=float(-ndtri(planner.epsilon / m)),
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
        planner.epsilon,
        planner.max_steps,
    )


FAULTS = (
    "",
    "needs more airspeed than robot.u_max",
    "outlasts the wind data",
    "leaves the map or enters an obstacle",
    "comes closer to an obstacle than planner.epsilon allows",
)


def evaluate(
    problem: Problem, x: FloatArray, origin: str, tolerance: float = 1e-6, *, ordered: bool = True
) -> Path:
    """Fly the means ``x`` (T+1, 2) and return the path with its exact cost.

    ``ordered=False`` leaves the ordered bound V out (NaN), which costs most of the time.

    Raises
    ------
    InfeasibleError
        With what is wrong and at which step.
    """
    from pareto_ltl import risk
    from pareto_ltl.kernels import path as kernel

    steps, m = len(x), len(problem.tables.obstacles.ptr) - 1
    cov3, u = np.empty((steps, 3)), np.empty((steps - 1, 2))
    q, cell = np.empty(steps, np.int64), np.empty(steps, np.int64)
    f_o, touch = np.empty(len(problem.atoms)), np.empty((steps, m))
    fault, where = kernel.evaluate(
        problem.tables, x, problem.start_variance, 1.0 + tolerance, cov3, u, q, cell, f_o, touch
    )
    if fault != kernel.FLOWN:
        raise InfeasibleError(f"the path {FAULTS[fault]} at step {where} of {steps - 1}")
    cov = cov3[:, [0, 1, 1, 2]].reshape(-1, 2, 2)
    label = tuple(problem.labels[c] for c in cell)
    objectives = Objectives(
        length=float(np.linalg.norm(np.diff(x, axis=0), axis=1).sum()),
        mission_risk_paper=min(1.0, float(f_o.sum())),
        mission_risk=risk.ordered_mission_risk(problem, x, cov) if ordered else math.nan,
        collision_risk=float(kernel.collision_bound(problem.tables, x, cov3)),
    )
    t = problem.tables.motion.dt * np.arange(steps, dtype=float)
    return Path(t, x, cov, q, label, u, objectives, origin)


def accepted(problem: Problem, path: Path) -> bool:
    """Whether the expected path completes the mission, Eq. (3)."""
    return bool(problem.automaton.distance[path.q[-1]] == 0.0)
