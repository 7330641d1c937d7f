"""Exact evaluation of a path: one pass along it, its costs, and bounds for its controls under a wind law."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from careful_io.texts import probability_text
from careful_io.times import hours_text
from pareto_ltl.kernels import data as kd
from pareto_ltl.planning.pack_logic import empty_letters, helpful_delta, live_rows
from pareto_ltl.planning.problem import LEAST_VARIANCE, Problem, barrier_polygons, errors_of
from pareto_ltl.planning.records import Objectives, PlannedPath
from pareto_ltl.support.arrays import FloatArray, IntArray, square_matrices
from pareto_ltl.support.errors import InfeasibleError
from plane_kernels.types import Faces, PathBound
from plane_logic.types import Ordered

if TYPE_CHECKING:
    from pareto_ltl.kernels.path import Flight
    from plane_kernels.path_collision import GaussianPath

FAULTS = (
    "",
    "needs more airspeed than robot.u_max",
    "outlasts the wind data",
    "leaves the map or enters an obstacle",
    "comes closer to an obstacle or a wall than planner.epsilon allows",
    "flies slower than robot.u_min plus the airspeed that feedback may take",
)

EXPECTED = 0.5  # probability of a fix from which on a plan names it

# --- memory of the models ---------------------------------------------------------------------


def _coherent_memory(law: kd.CoherentLaw, rows: int) -> kd.CoherentMemory:
    return kd.CoherentMemory(np.zeros((rows, 2, 2, law.modes.psi.shape[-1]), np.float32))


def _landmark_memory(law: kd.LandmarkLaw, rows: int) -> kd.LandmarkMemory:
    modes = law.modes.psi.shape[-1]
    return kd.LandmarkMemory(
        at=np.zeros((rows, 2)), chance=np.zeros(rows),
        theta=np.zeros((rows, 2, 2, modes), np.float32), known=np.empty((rows, 3)),
        gain=np.empty((rows, 2, 2, modes), np.float32), used=np.zeros(1, np.int64),
        errors=errors_along(kd.EXACT, np.empty((1, 2)), np.empty((0, 2)), 0),
        psi=np.empty((2, modes), np.float32),
    )  # fmt: skip


def errors_along(law: kd.RobotErrors, x: FloatArray, u: FloatArray, fixes: int) -> kd.FlightErrors:
    """Memory for the errors of a robot along the path ``x`` (T+1, 2), ``u`` (T, 2)."""
    pair = 2, len(law.mean)
    return kd.FlightErrors(
        law, np.empty((len(u), *pair)), np.zeros((len(x), *pair)), np.empty((fixes, *pair)), x, u,
        np.zeros(1, bool),
    )  # fmt: skip


LAW_MEMORY: dict[type, Callable[[Any, int], kd.Memory]] = {
    kd.IndependentLaw: lambda _law, _rows: None,
    kd.CoherentLaw: _coherent_memory,
    kd.LandmarkLaw: _landmark_memory,
}


def law_memory(law: kd.Law, rows: int) -> kd.Memory:
    """Arrays of a wind law for ``rows`` steps; None for the independent law."""
    return LAW_MEMORY[type(law)](law, rows)


# --- one pass ---------------------------------------------------------------------------------


def propagate(problem: Problem, x: FloatArray, law: kd.Law | None = None) -> Flight:
    """Propagate along the means ``x`` (T+1, 2) [m]: covariances, controls, airspeed left; without checks.

    ``law`` is by default the one that the problem is planned in.
    """
    from pareto_ltl.kernels import path as kernel

    flight = empty_flight(problem.world.law if law is None else law, len(x))
    flight.x[:] = x
    kernel.propagate_flight(problem.world.law if law is None else law, flight, problem.start_variance, False)
    return flight


def propagate_controls(problem: Problem, u: FloatArray, law: kd.Law) -> Flight:
    """Propagate the controls ``u`` (T, 2) [m/s] from the start of the scene, under ``law``."""
    from pareto_ltl.kernels import path as kernel

    flight = empty_flight(law, len(u) + 1)
    flight.x[0], flight.u[:] = problem.scene.start, u
    kernel.propagate_flight(law, flight, problem.start_variance, True)
    return flight


def evaluate(
    problem: Problem, *, x: FloatArray | None = None, u: FloatArray | None = None, law: str | None = None
) -> Flight:
    """One pass along the means ``x`` (T+1, 2) [m], or with the controls ``u`` (T, 2) [m/s]; one is given.

    ``law`` is the name of a wind law, by default the one of the problem. The flight has means ``x``, controls
    ``u``, covariances ``cov`` (T+1, 3) as (xx, xy, yy) [m²] and the airspeed ``speed`` (T,) left for it.
    Nothing is checked: ``extend.completing_path`` makes a checked path of it.
    """
    if (x is None) == (u is None):
        raise TypeError("evaluate takes either x, the means, or u, the controls")
    model = problem.world.law if law is None else problem.laws[law]
    if u is not None:
        return propagate_controls(problem, np.ascontiguousarray(u), model)
    assert x is not None
    return propagate(problem, x, model)


def empty_flight(law: kd.Law, n: int) -> Flight:
    """Memory of a flight of ``n`` positions under ``law``."""
    from pareto_ltl.kernels.path import Flight

    steps, modes = n - 1, 0 if isinstance(law, kd.IndependentLaw) else law.modes.psi.shape[-1]
    x, u, memory = np.empty((n, 2)), np.empty((steps, 2)), law_memory(law, n)
    errors = errors_along(errors_of(law), x, u, n)
    if isinstance(memory, kd.LandmarkMemory):
        memory = memory._replace(errors=errors)
    return Flight(
        x=x, u=u, cov=np.empty((n, 3)), free=np.empty((steps, 2)),
        shift=np.empty((steps, 2)), speed=np.empty(steps), F=np.empty((steps, 2, 2)),
        psi=np.empty((steps, 2, modes), np.float32), white=np.empty((steps, 2)),
        memory=memory, errors=errors,
    )  # fmt: skip


def fix_steps(flight: Flight) -> tuple[int, ...]:
    """Steps of a path before whose end the robot more probably than not measures its position anew."""
    if not isinstance(flight.memory, kd.LandmarkMemory):
        return ()
    return tuple(int(t) for t in np.flatnonzero(flight.memory.chance[: len(flight.u)] >= EXPECTED))


def takes_fixes(flight: Flight) -> bool:
    """Whether a fix, however unlikely, changes the covariance of a path."""
    return isinstance(flight.memory, kd.LandmarkMemory) and bool(flight.memory.used[0])


def airspeed_limits(problem: Problem, speed: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Least and largest airspeed to plan with at each step, both (T,) [m/s].

    ``speed`` (T,) [m/s] is u_max less what is reserved for feedback.
    """
    motion = problem.motion
    reserved = motion.u_max - speed
    return (motion.u_min + reserved if motion.u_min > 0.0 else np.zeros_like(speed)), speed


# --- what a path costs ------------------------------------------------------------------------


def evaluate_path(
    problem: Problem, x: FloatArray, origin: str, tolerance: float = 1e-6, *, tight: bool = True
) -> PlannedPath:
    """Fly the means ``x`` (T+1, 2) and return the path with its exact cost.

    ``tight=False`` leaves out what only the final check needs: the tighter form of R under the coherent law,
    which takes the correlation of all pairs of steps, and the limit planner.delta. With ``judge=flights``
    neither that limit nor the chance constraint of a step is checked: a path with a large R may be the best.

    Raises
    ------
    InfeasibleError
        If the path is not feasible; the message says why and at which step.
    """
    flight = propagate(problem, x)
    q, cell = _check_flown(problem, flight, 1.0 + tolerance)
    collision = collision_risk(problem, flight, problem.world.law, tight=tight)
    allowed = getattr(problem.world.collision, "delta", math.inf)
    if tight and collision > allowed and problem.fidelity.judge == "bound":
        raise InfeasibleError(
            f"the path may collide with a probability of {probability_text(collision)} in "
            f"{problem.fidelity.law} winds, above planner.delta = {allowed:g}"
        )
    steps = len(x)
    return PlannedPath(
        t=problem.motion.dt * np.arange(steps, dtype=float),
        x=x,
        cov=square_matrices(flight.cov),
        q=q,
        label=tuple(problem.decomposition.labels[c] for c in cell),
        u=flight.u,
        objectives=_objectives(problem, flight, cell, collision),
        origin=origin,
        fixes=fix_steps(flight),
        order=problem.mission_order(q, cell),
    )


def _check_flown(problem: Problem, flight: Flight, fast: float) -> tuple[IntArray, IntArray]:
    """Automaton state and cell of every step of a path without a fault."""
    q, cell, fault, where = _flown_until(problem, flight, fast)
    if fault:
        raise InfeasibleError(f"the path {FAULTS[fault]} at step {where} of {len(q) - 1}")
    return q, cell


def steps_flown(problem: Problem, x: FloatArray) -> int:
    """How many steps of the means ``x`` (T+1, 2) [m] a robot can fly before it breaks a limit."""
    _, _, fault, where = _flown_until(problem, propagate(problem, x), 1.0 + 1e-6)
    return where - 1 if fault else len(x) - 1


def _flown_until(problem: Problem, flight: Flight, fast: float) -> tuple[IntArray, IntArray, int, int]:
    """Automaton state and cell of every step, the number of the first fault, 0 for none, and its step."""
    from pareto_ltl.kernels import path as kernel

    n, world = len(flight.x), judged_world(problem)
    q, cell = np.empty(n, np.int64), np.empty(n, np.int64)
    known = min(n - 1, len(problem.wind.slot))
    fault, where = kernel.check_path(world, flight, known, fast, q, cell)
    return q, cell, int(fault), int(where)


def judged_world(problem: Problem) -> kd.World:
    """The world that paths are checked in: without chance constraints where flights judge."""
    if problem.fidelity.judge == "bound":
        return problem.world
    bound = problem.world.collision
    return problem.world._replace(collision=PathBound(bound.barriers, bound.nearby, math.inf, math.inf))


def _objectives(problem: Problem, flight: Flight, cell: IntArray, collision: float) -> Objectives:
    """Costs and all risks; ``mission_risk`` is the bound that the problem is planned with."""
    independent = problem.laws["independent"]
    alone = flight if problem.world.law is independent else propagate(problem, flight.x, independent)
    ordered = ordered_mission_risk(problem, flight)
    paper = theorem2_mission_risk(problem, alone, cell)
    if isinstance(problem.world.mission, Ordered):
        judged = ordered
    else:
        judged = paper if alone is flight else theorem2_mission_risk(problem, flight, cell)
    return Objectives(
        costs=problem.costs_of(flight.x, flight.u),
        mission_risk=judged,
        collision_risk=collision,
        mission_risk_paper=paper,
        mission_risk_ordered=ordered,
    )


def theorem2_mission_risk(problem: Problem, flight: Flight, cell: IntArray) -> float:
    """f_o of Theorem 2 for the Gaussian of ``flight``, at most 1.

    Eq. (M36) of docs/mathematics.md.
    """
    from plane_logic.mission_risk import theorem2_risks

    return min(1.0, float(theorem2_risks(problem.theorem2, flight.x, flight.cov, cell).sum()))


def ordered_mission_risk(problem: Problem, flight: Flight) -> float:
    """The ordered bound V for the Gaussian of ``flight``.

    Eq. (M37) of docs/mathematics.md.
    """
    from plane_logic.ordered_bound import ordered_risk

    rows, letters = live_rows(problem.ordered), empty_letters(problem.ordered)
    return float(ordered_risk(problem.ordered, rows, letters, flight.x, flight.cov))


def collision_risk(problem: Problem, flight: Flight, law: kd.Law, *, tight: bool = True) -> float:
    """R of a path under the law it was propagated in; ``tight`` as for :func:`evaluate_path`.

    The tighter form of the path bound has runs beside supporting lines as well as beside faces. The looser
    form is not cut at 1: smoothing must see that a path with R = 2 is worse than one with 1.5.

    Eq. (M40) of docs/mathematics.md.
    """
    from plane_kernels.path_collision import collision_bound

    bound, path = problem.world.collision, gaussian_path(law, flight, tight=tight)
    faces = (
        with_supporting_lines(problem, flight) if tight and isinstance(bound, PathBound) else bound.barriers
    )
    total = float(collision_bound(faces, bound.nearby, path))
    return min(total, 1.0) if tight else total


def with_supporting_lines(problem: Problem, flight: Flight) -> Faces:
    """The barriers with the supporting lines of all near segments of ``flight`` as further faces."""
    from plane_kernels.supporting_lines import FAR, lines_of_each

    faces, corners = problem.barriers, barrier_polygons(problem)
    line = np.empty((len(flight.u), len(corners.radius), 4))
    lines_of_each(corners, flight.x, flight.cov, LEAST_VARIANCE, line)
    normals, offsets, counts = [np.empty((0, 2))], [np.empty(0)], [0]
    for j, (first, last) in enumerate(pairwise(faces.ptr.tolist())):
        rows = line[(line[:, j, 3] > 0.0) & (line[:, j, 3] < FAR), j]
        if j >= len(problem.decomposition.obstacles):  # a wall has only one line
            rows = rows[:0]
        normals += [faces.normal[first:last], rows[:, :2]]
        offsets += [faces.offset[first:last], rows[:, 2]]
        counts.append(last - first + len(rows))
    return Faces(np.cumsum(counts), np.vstack(normals), np.concatenate(offsets))


def gaussian_path(law: kd.Law, flight: Flight, *, tight: bool = True) -> GaussianPath:
    """The input of R from a flight; the law decides where the reflection bound 2 Φ is allowed."""
    from plane_kernels import path_collision as kernel

    none = np.empty((0, 0, 2, 2))
    if isinstance(law, kd.IndependentLaw):
        walk = bool(np.array_equal(law.motion.closed, np.eye(2)))
        return kernel.GaussianPath(flight.x, flight.cov, none, kernel.REFLECT if walk else kernel.SUM_ONLY)
    if not tight or takes_fixes(flight):
        return kernel.GaussianPath(flight.x, flight.cov, none, kernel.SUM_ONLY)
    cross = cross_covariance(law, flight)
    return kernel.GaussianPath(flight.x, flight.cov, cross, kernel.REFLECT_WHERE_GROWING)


def cross_covariance(law: kd.CoherentLaw | kd.LandmarkLaw, flight: Flight) -> FloatArray:
    """Cov(e_t, e_s) along a path under the coherent law, (T+1, T+1, 2, 2), for s <= t; without fixes."""
    from pareto_ltl.kernels.path import covariance_across_time

    cross = np.zeros((len(flight.x), len(flight.x), 2, 2))
    theta = flight.memory.theta
    held, motion = np.empty(theta.shape[1:]), law.motion
    linear = flight.F, flight.psi, flight.errors
    covariance_across_time(
        linear, flight.cov, theta, law.modes.kept, motion.exposed * motion.dt, held, cross
    )  # fmt: skip
    return cross


def completes_mission(problem: Problem, path: PlannedPath) -> bool:
    """Whether the expected path completes the mission, Eq. (3)."""
    return bool(problem.automaton.distance[path.q[-1]] == 0.0)


def completing_path(problem: Problem, x: FloatArray, origin: str, *, tight: bool = True) -> PlannedPath:
    """:func:`evaluate_path`; InfeasibleError also if the path does not complete the mission."""
    path = evaluate_path(problem, x, origin, tight=tight)
    if not completes_mission(problem, path):
        raise InfeasibleError(
            f"the expected path does not complete the mission: {_unfinished(problem, path)}"
        )
    return path


def _unfinished(problem: Problem, path: PlannedPath) -> str:
    """The remaining mission at the end of ``path``, or when and where the mission failed."""
    distance = problem.automaton.distance[path.q]
    if np.isfinite(distance[-1]):
        nearer = problem.logic.distance[helpful_delta(problem.logic)[path.q[-1], :-1]] < distance[-1]
        wanted = sorted({" and ".join(sorted(problem.labels[cell])) for cell in np.flatnonzero(nearer)})
        in_time = (
            " in time" if any(np.isfinite(span.end) for span in problem.automaton.windows.values()) else ""
        )
        goals = " or ".join(filter(None, wanted)) or "the free space"
        return f"at its end {goals} is still to be visited{in_time}"
    lost = int(np.flatnonzero(np.isinf(distance))[0])
    cell = int(problem.locate(path.x[lost : lost + 1])[0])
    names = sorted(problem.labels[cell]) if cell >= 0 else []
    where = f"in {' and '.join(names)}" if names else "outside of all regions"
    return f"it is lost {hours_text(lost * problem.motion.dt)} after departure, {where}"


# --- bounds of controls -----------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Forecast:
    """The Gaussian of a flight of given controls under one wind law, and the bounds on its failure.

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

    @classmethod
    def of(cls, problem: Problem, u: FloatArray, law: str) -> Forecast:
        """V and R of the controls ``u`` (T, 2) [m/s] under ``law``, which may be another one than planned."""
        model = problem.laws[law]
        flight = propagate_controls(problem, u, model)
        return cls(
            law, flight.x, square_matrices(flight.cov), ordered_mission_risk(problem, flight),
            collision_risk(problem, flight, model),
        )  # fmt: skip
