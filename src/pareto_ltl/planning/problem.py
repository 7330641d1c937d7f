"""The planning problem: the arrays that kernels read, its barriers as polygons, and the same in longer steps.

In longer steps a run of steps has the wind of its middle, and the mean of the gusts of its steps.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

import numpy as np

from pareto_ltl.kernels import data as kd
from pareto_ltl.logic.automaton import Automaton
from pareto_ltl.planning.cost import Cost
from pareto_ltl.planning.pack_logic import Reading, pack_corners
from pareto_ltl.planning.power import EnergyModel
from pareto_ltl.planning.turns import Turns, TurnsOnTheSpot
from pareto_ltl.planning.wind_lookup import interpolate, interpolate_time
from pareto_ltl.settings import FidelityConfig, RobotConfig
from pareto_ltl.support.arrays import BoolArray, FloatArray, IntArray
from pareto_ltl.support.display import Displayed
from pareto_ltl.world.cells import Decomposition
from pareto_ltl.world.scene import Scene
from plane_kernels.types import Cells, Corners, Faces, StepBound
from plane_logic.types import Logic, Ordered, Theorem2
from wind_laws.tails import ErrorTail

if TYPE_CHECKING:
    from pareto_ltl.kernels.path import Flight
    from pareto_ltl.planning.limits import WorstSegment
    from pareto_ltl.planning.records import Forest, PlannedPath
    from plane_kernels.supporting_lines import SegmentLines

LEAST_VARIANCE = (
    0.1  # [m²] added to every variance: a position that is known exactly has a deviation of 0.3 m
)
BEYOND = 3.0  # depth of a wall as a polygon, in sizes of the map

_POLYGONS: WeakKeyDictionary[Problem, Corners] = WeakKeyDictionary()


@dataclass(frozen=True, slots=True, eq=False, repr=False, weakref_slot=True)
class Problem(Displayed):
    """The planning problem; every later stage reads the same arrays, so that a path costs the same anywhere.

    Attributes
    ----------
    world : kernels.data.World
        The models that planning uses, their types picked by ``fidelity``.
    laws : mapping of name to law
        Every wind law, for forecasts and simulation.
    theorem2, ordered : mission bounds
        Both, since every path reports both.
    labels : tuple of frozenset of str
        The propositions that hold in each cell at any time.
    obstacles : Faces
        Convex parts of the obstacles; the collision bound also has the walls (:attr:`barriers`).
    start_variance : float
        Variance of the start position in each direction [m²], without what the robot's own errors explain.
    epsilon : float
        Collision probability allowed at a step (Eq. 4).
    max_steps : int
        Longest path.
    energy : EnergyModel or None
        Power curve and capacity of a robot that has them.
    costs : tuple of Cost
        The costs that paths are compared by.
    turns : Turns
        How the robot turns between two legs; the leg sheets for pilots allow for it.
    wind_ends : str
        Why the wind is not known for longer, for messages.
    tail : ErrorTail or None
        Tails of the errors of forecasts in simulated flights; None: they are Gaussian.
    """

    scene: Scene
    decomposition: Decomposition
    world: kd.World
    laws: Mapping[str, kd.Law]
    theorem2: Theorem2
    ordered: Ordered
    automaton: Automaton
    labels: tuple[frozenset[str], ...]
    fidelity: FidelityConfig
    obstacles: Faces
    start_variance: float
    epsilon: float
    max_steps: int
    wind_ends: str = ""
    energy: EnergyModel | None = None
    costs: tuple[Cost, ...] = ()
    turns: Turns = field(default_factory=TurnsOnTheSpot)
    tail: ErrorTail | None = None

    def facts(self) -> Mapping[str, str]:
        """Formula, size of the automaton and of the map, step, and the end of the known wind."""
        return {
            "formula": self.automaton.formula,
            "automaton": f"{self.automaton.n_states} states",
            "cells": f"{len(self.decomposition.cells):,}",
            "step": f"{self.motion.dt:,.8g} s",
            "wind law": self.fidelity.law,
            "wind known for": f"{self.horizon} steps",
        }

    @property
    def atoms(self) -> tuple[str, ...]:
        """Propositions of the mission, in the order of the risks of Theorem 2."""
        return tuple(self.automaton.atoms)

    @property
    def cells(self) -> Cells:
        """Convex cells of the map."""
        return self.world.mission.cells

    @property
    def logic(self) -> Logic:
        """The automaton on the letters that cells show."""
        return self.world.mission.logic

    @property
    def is_published(self) -> bool:
        """Whether the plan has the models of the paper, so that a tree vertex costs what its path costs."""
        kinds = kd.IndependentLaw, Theorem2, StepBound
        return all(isinstance(model, kind) for model, kind in zip(self.world, kinds, strict=True))

    @property
    def motion(self) -> kd.Motion:
        """Motion of the robot."""
        return self.world.law.motion

    @property
    def wind(self) -> kd.Wind:
        """Expected wind and its variance on the lattice."""
        return self.world.law.wind

    @property
    def barriers(self) -> Faces:
        """Convex parts of the obstacles and, where the border is a wall, its four sides."""
        return self.world.collision.barriers

    @property
    def modes(self) -> kd.Modes:
        """Modes of the coherent law, in which plans of every fidelity are simulated."""
        return self.coherent.modes

    @property
    def coherent(self) -> kd.CoherentLaw | kd.LandmarkLaw:
        """The coherent law, in which plans of every fidelity are simulated."""
        law = self.laws["coherent"]
        assert not isinstance(law, kd.IndependentLaw)
        return law

    @property
    def landmarks(self) -> tuple[FloatArray, ...]:
        """Landmarks at which the robot measures its position; none if its laws do not use them."""
        return self.scene.landmarks if isinstance(self.laws["coherent"], kd.LandmarkLaw) else ()

    @property
    def horizon(self) -> int:
        """Number of steps for which the wind is known, at most ``planner.max_steps``."""
        return min(len(self.wind.slot), self.max_steps)

    @property
    def reach(self) -> float:
        """Longest step in still air [m]."""
        return self.motion.u_max * self.motion.dt

    @property
    def start_cov(self) -> FloatArray:
        """Covariance (xx, xy, yy) of the start [m²]."""
        lean = errors_of(self.world.law).start
        both = lean @ lean.T + self.start_variance * np.eye(2)
        return both[[0, 0, 1], [0, 1, 1]]

    def with_feedback(self, time: float | None) -> Problem:
        """The problem with ``robot.feedback_time=time`` [s]; such a robot takes no fixes at landmarks."""
        laws: dict[str, kd.Law] = {}
        for name, law in self.laws.items():
            plain = unaided(law)
            laws[name] = plain._replace(motion=motion_with_feedback(plain.motion, time))
        world = self.world._replace(law=laws[self.fidelity.law])
        return replace(self, laws=laws, world=world)

    def with_beacons(self, robot: RobotConfig, middles: FloatArray, radius: float) -> Problem:
        """The problem with further landmarks: discs of ``radius`` [m] about ``middles`` (N, 2) [m].

        ConfigError if ``robot`` takes no position fixes.
        """
        from pareto_ltl.planning.pack import disc, with_landmarks

        return with_landmarks(self, robot, [disc(middle, radius) for middle in middles])

    def own_errors(self, law: str) -> kd.RobotErrors:
        """The law of the robot's own errors under the wind law ``law``; none under the independent law."""
        return errors_of(self.laws[law])

    def without_fixes(self) -> Problem:
        """The problem of a robot that takes no position fixes at landmarks."""
        laws: dict[str, kd.Law] = {name: unaided(law) for name, law in self.laws.items()}
        return replace(self, laws=laws, world=self.world._replace(law=laws[self.fidelity.law]))

    def with_start(
        self, cov: FloatArray, errors: FloatArray, errors_cov: FloatArray, shared: FloatArray
    ) -> Problem:
        """The problem with another law of the position at the start and of the robot's own errors.

        ``cov`` (2, 2) [m²] is the covariance of the position, ``errors`` (Q,) and ``errors_cov`` (Q, Q) are
        mean and covariance of the own errors, ``shared`` (2, Q) is the one of both. What of ``cov`` the own
        errors do not explain is taken in every direction as in its largest.
        """
        own = errors_with(errors, errors_cov, shared)
        laws: dict[str, kd.Law] = {
            name: law if isinstance(law, kd.IndependentLaw) else law._replace(errors=own)
            for name, law in self.laws.items()
        }
        spread = float(np.linalg.eigvalsh(cov - own.start @ own.start.T)[-1])
        world = self.world._replace(law=laws[self.fidelity.law])
        return replace(self, laws=laws, world=world, start_variance=max(spread, 0.0))

    def from_known_place(self) -> Problem:
        """The problem of a robot that starts where the map says, exactly, and takes no fixes."""
        law = unaided(self.world.law)
        if not isinstance(law, kd.IndependentLaw):
            law = law._replace(errors=law.errors._replace(start=np.zeros_like(law.errors.start)))
        return replace(self, start_variance=0.0, world=self.world._replace(law=law))

    def costs_of(self, x: FloatArray, u: FloatArray) -> dict[str, float]:
        """The costs of the path ``x`` (T+1, 2) [m], ``u`` (T, 2) [m/s] that the robot has, by name."""
        values = ((cost.name, cost.of(self, x, u)) for cost in self.costs)
        return {name: value for name, value in values if value is not None}

    def wind_at(self, step: int, point: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Expected wind (2,) [m/s] at ``step`` and ``point`` (2,) [m], and the variance of its error.

        The variance has the smooth part of the error, and the white one.
        """
        wind = self.wind
        gust = interpolate_time(wind, wind.gust, step)
        variance = interpolate(wind, wind.latent, step, point) + gust + wind.between[step]
        return interpolate(wind, wind.mean, step, point), variance

    def reading(self, step: int) -> Reading:
        """The automaton as it reads the letters of ``step``, and those on the way to it."""
        logic = self.logic
        e = int(logic.epoch[min(step, len(logic.epoch) - 1)])
        return Reading(
            logic.delta[e], logic.way[e], logic.harm[e], logic.loses[e], logic.ahead[e],
            logic.covers, logic.initial, logic.hazards,
        )  # fmt: skip

    def locate(self, points: FloatArray) -> IntArray:
        """Cell of each row of ``points`` (P, 2); -1 in an obstacle or off the map."""
        from plane_kernels.geometry import locate_cells

        cells: IntArray = locate_cells(self.cells, np.ascontiguousarray(points))
        return cells

    def keeps_epsilon(self, path: PlannedPath) -> bool:
        """Whether no segment of ``path`` is more likely to collide than ``planner.epsilon`` allows."""
        from pareto_ltl.planning.separation import keeps_epsilon

        return keeps_epsilon(self, path)

    @property
    def allowed_risk(self) -> float:
        """``planner.epsilon``, the largest risk of a collision in a segment; inf without a limit."""
        from pareto_ltl.planning.separation import allowed_risk

        return allowed_risk(self)

    def segment_risks(self, flight: Flight) -> FloatArray:
        """The probability of a collision in each segment (T,) of ``flight``."""
        from pareto_ltl.planning.separation import segment_risks

        return segment_risks(self, flight)

    def worst_segment(self, path: PlannedPath) -> WorstSegment:
        """The segment of ``path`` that is most likely to collide, and its closest barrier."""
        from pareto_ltl.planning.separation import worst_segment

        return worst_segment(self, path)

    def mission_order(self, q: IntArray, cell: IntArray, begun: int | None = None) -> str:
        """The letters at which the automaton state changes, in order: ``a>b>c``.

        Propositions that hold together are joined by ``+``; ``-`` is the empty letter. ``q``, ``cell``
        (T+1,) are states and cells; ``begun`` is the state before them, by default the initial one.
        """
        before = np.concatenate([[self.automaton.initial if begun is None else begun], q[:-1]])
        atoms = frozenset(self.atoms)
        letters = (self.labels[cell[t]] & atoms for t in np.flatnonzero(q != before))
        return ">".join("+".join(sorted(letter)) or "-" for letter in letters)

    def grown_paths(self, forest: Forest) -> tuple[PlannedPath, ...]:
        """Accepted paths of the trees, no two of the same mission order and similar length."""
        from pareto_ltl.planning.selection import unlike_paths

        return unlike_paths(self, forest)

    def states(self, x: FloatArray) -> IntArray:
        """Automaton state after each step of the positions ``x`` (T+1, 2), flyable or not, (T+1,)."""
        from plane_logic.letters import states_along

        states: IntArray = states_along(self.cells, self.logic, np.ascontiguousarray(x))
        return states


def motion_with_feedback(motion: kd.Motion, time: float | None) -> kd.Motion:
    """``motion`` with position feedback of the time constant ``time`` [s]; None: open loop."""
    gain, exposed = feedback_shares(time, motion.dt)
    return motion._replace(closed=motion.a - gain * np.eye(2), gain=gain, exposed=exposed)


def feedback_shares(time: float | None, dt: float) -> tuple[float, float]:
    """K and φ of a robot that corrects a known deviation with a time constant ``time`` [s], None for never.

    K = 1 - exp(-dt / T) is the share of a deviation that is corrected in a step of ``dt`` [s], φ = K T / dt
    the share of a step's wind error that is left at its end: the solution of ė = -e / T + w, w constant.

    Eq. (M2) of docs/mathematics.md.
    """
    if time is None:
        return 0.0, 1.0
    gain = -math.expm1(-dt / time)
    return gain, gain * time / dt


def errors_of(law: kd.Law) -> kd.RobotErrors:
    """The law of the robot's own errors; none under the independent law."""
    return kd.EXACT if isinstance(law, kd.IndependentLaw) else law.errors


def errors_with(mean: FloatArray, cov: FloatArray, shared: FloatArray) -> kd.RobotErrors:
    """The law of own errors with ``mean`` (Q,), ``cov`` (Q, Q), and ``shared`` (2, Q) with the start."""
    if not len(mean):
        return kd.EXACT
    value, vector = np.linalg.eigh(cov)
    root = vector * np.sqrt(np.maximum(value, 1e-12 * max(float(value.max()), 1e-30)))
    _, upper = np.linalg.qr(root.T)  # a lower triangular root: root root' = R' R
    lower = upper.T * np.where(np.diag(upper) < 0.0, -1.0, 1.0)
    start = np.linalg.solve(lower, shared.T).T
    return kd.RobotErrors(mean, np.ascontiguousarray(lower), np.ascontiguousarray(start))


def unaided(law: kd.Law) -> kd.IndependentLaw | kd.CoherentLaw:
    """``law`` for a robot that takes no position fixes."""
    if not isinstance(law, kd.LandmarkLaw):
        return law
    return kd.CoherentLaw(law.wind, law.modes, law.motion, law.errors)


# --- longer steps -----------------------------------------------------------------------------------


def with_merged_steps(problem: Problem, times: int) -> Problem:
    """``problem`` in steps that are ``times`` as long; a rest of the known wind is left out."""
    laws = {name: _merged_law(law, times) for name, law in problem.laws.items()}
    world = problem.world._replace(law=laws[problem.fidelity.law])
    return replace(problem, laws=laws, world=world, max_steps=problem.max_steps // times)


def _merged_law(law: kd.Law, times: int) -> kd.Law:
    wind, motion = merged_wind(law.wind, times), merged_motion(law.motion, times)
    if isinstance(law, kd.IndependentLaw):
        return law._replace(wind=wind, motion=motion)
    modes = merged_modes(law.modes, times)
    if isinstance(law, kd.CoherentLaw):
        return law._replace(wind=wind, modes=modes, motion=motion)
    marks = law.landmarks._replace(gain=_merged_gain(law.landmarks.gain, times))
    return law._replace(wind=wind, modes=modes, motion=motion, landmarks=marks)


def merged_wind(wind: kd.Wind, times: int) -> kd.Wind:
    """The wind in the middle of each run of ``times`` steps."""
    middle = _middles(len(wind.slot), times)
    return wind._replace(
        slot=wind.slot[middle], weight=wind.weight[middle], between=np.ascontiguousarray(wind.between[middle])
    )


def merged_modes(modes: kd.Modes, times: int) -> kd.Modes:
    """The modes in the middle of each run; epochs keep their numbers."""
    middle = _middles(len(modes.slot), times)
    keep = _kept_between(modes.keep, middle)
    return modes._replace(
        slot=modes.slot[middle], epoch=modes.epoch[middle], keep=keep,
        kept=keep[:, modes.part].astype(np.float32), scale=np.ascontiguousarray(modes.scale[middle]),
        white=modes.white / times, rest=modes.rest / times,
    )  # fmt: skip


def merged_motion(motion: kd.Motion, times: int) -> kd.Motion:
    """The motion in one step of ``times`` steps: K' = 1 - (1 - K)^times, and φ' = K' T / dt'."""
    gain = _merged_gain(motion.gain, times)
    exposed = gain * motion.exposed / (motion.gain * times) if motion.gain > 0.0 else 1.0
    return motion._replace(
        dt=motion.dt * times, gain=gain, exposed=exposed, closed=motion.a - gain * np.eye(2)
    )


def merged_draws(white: FloatArray, times: int) -> FloatArray:
    """The draws (T // times, n, 2) whose winds are the means of runs of ``white`` (T, n, 2)."""
    runs = len(white) // times
    grouped = white[: runs * times].reshape(runs, times, *white.shape[1:])
    return np.asarray(grouped.sum(axis=1) / math.sqrt(times), float)


def _middles(steps: int, times: int) -> IntArray:
    return times * np.arange(steps // times) + times // 2


def _merged_gain(gain: float, times: int) -> float:
    return 1.0 - (1.0 - gain) ** times


def _kept_between(keep: FloatArray, at: IntArray) -> FloatArray:
    """What θ keeps from each of the steps ``at`` to the next, (len(at) + 1, G); row 0: up to the first."""
    ends = [0, *(at + 1).tolist(), len(keep)]
    return np.array([keep[i:j].prod(axis=0) for i, j in pairwise(ends)])


# --- barriers ---------------------------------------------------------------------------------------


def barrier_polygons(problem: Problem) -> Corners:
    """The convex polygons of ``problem.barriers`` as corners, made once; a wall is a deep rectangle."""
    found = _POLYGONS.get(problem)
    if found is None:
        polygons = barrier_outlines(problem)
        _POLYGONS[problem] = found = pack_corners(range(len(polygons)), polygons)
    return found


def barrier_outlines(problem: Problem) -> list[FloatArray]:
    """The corners of each convex part of the obstacles, then of the walls [m]."""
    return [*problem.decomposition.obstacles, *(_walls(problem) if problem.scene.walled else [])]


def _walls(problem: Problem) -> list[FloatArray]:
    """West, east, south and north of the map as rectangles, in the order of ``problem.barriers``."""
    (west, south), (east, north) = problem.scene.bounds
    deep = BEYOND * max(east - west, north - south)
    sides = [
        (west - deep, south - deep, west, north + deep), (east, south - deep, east + deep, north + deep),
        (west - deep, south - deep, east + deep, south), (west - deep, north, east + deep, north + deep),
    ]  # fmt: skip
    return [np.array([[w, s], [e, s], [e, n], [w, n]]) for w, s, e, n in sides]


def lines_of(
    corners: Corners, requested: BoolArray, x: FloatArray, cov: FloatArray, slots: int, around: float = 0.0
) -> SegmentLines:
    """The ``slots`` closest supporting lines of each segment, and its risk.

    ``requested`` (T, m) are the polygons to avoid, ``x`` (T+1, 2) means [m], ``cov`` (T+1, 3)
    covariances [m²].
    """
    from plane_kernels.supporting_lines import SegmentLines, segment_lines

    T = len(requested)
    lines = SegmentLines(np.empty((T, slots, 4)), np.empty((T, slots), np.int64), np.empty(T))
    segment_lines(corners, requested, x, cov, LEAST_VARIANCE, around, lines)
    return lines


def start_risk(problem: Problem) -> float:
    """Σ_lines Q(z) at the start, Eq. (M73): the probability of a collision before anything is flown."""
    corners = barrier_polygons(problem)
    requested, x = np.ones((1, len(corners.radius)), bool), np.tile(problem.scene.start, (2, 1))
    return float(lines_of(corners, requested, x, np.tile(problem.start_cov, (2, 1)), 1).risk[0])


def start_breach(problem: Problem) -> str:
    """Text for a start that itself breaks the chance constraint."""
    walled = problem.scene.walled
    barrier = "an obstacle or the wall around the map" if walled else "an obstacle"
    cure = ", raise planner.epsilon or set scene.border=open" if walled else " or raise planner.epsilon"
    return (
        f"the start lies closer to {barrier} than planner.epsilon = {problem.epsilon:g} allows; move it, "
        f"lower robot.start_sd{cure}"
    )
