"""Scene, wind, automaton and robot as the named tuples of arrays that kernels read, made once per run."""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import zip_longest

import numpy as np

from pareto_ltl.kernels import data as kd
from pareto_ltl.logic.automaton import Automaton
from pareto_ltl.logic.timed import letter_of, places_of
from pareto_ltl.planning.costs import ALWAYS
from pareto_ltl.planning.pack_logic import Epoch, epochs_of, pack_corners, pack_logic, pack_ordered
from pareto_ltl.planning.power import energy_model
from pareto_ltl.planning.problem import Problem, feedback_shares, motion_with_feedback, unaided
from pareto_ltl.planning.turns import turns_of
from pareto_ltl.settings import FidelityConfig, PlannerConfig, RobotConfig, WindConfig
from pareto_ltl.settings.fidelity import PAPER
from pareto_ltl.support.arrays import FloatArray, IntArray
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl.wind.records import WindField
from pareto_ltl.world.cells import BUCKETS, Decomposition, bucket_cells, half_planes
from pareto_ltl.world.scene import FixShape, Scene
from pareto_ltl.world.time_step import with_time_step
from plane_kernels.types import Cells, CollisionBound, Faces, Nearby, PathBound, StepBound
from plane_logic.types import Logic, MissionBound, Theorem2
from wind_laws.records import HELD, PARTS, SPACE, TIME, WindModes, forecast_parts
from wind_laws.tails import error_tail

LOG = logging.getLogger(__name__)

HELD_EPOCH = 10_800.0  # [s] for which the error pattern of a held field is taken as constant
NO_MODES = WindModes(
    np.zeros(2), 1.0, np.zeros((1, 2, 2, 2, 0), np.float32), np.zeros(0, np.int64), 1.0, 1.0, np.ones((1, 2)),
    np.ones((1, 2)),
)  # fmt: skip
NO_LIMIT = 1.0  # epsilon without a limit
CORNERS = 16  # of the polygon that stands for a beacon
NEARBY_ENTRIES, NEARBY_SQUARES = 4_000_000, 64  # table of near obstacles: entries; squares along one side

# --- the map ----------------------------------------------------------------------------------


def pack_faces(polygons: Sequence[FloatArray]) -> Faces:
    """Half planes of convex polygons, one after another."""
    ptr = np.concatenate([[0], np.cumsum([len(p) for p in polygons])]).astype(np.int64)
    if not polygons:
        return Faces(ptr, np.empty((0, 2)), np.empty(0))
    parts = [half_planes(p) for p in polygons]
    return Faces(ptr, np.vstack([n for n, _ in parts]), np.concatenate([b for _, b in parts]))


def pack_barriers(scene: Scene, obstacles: Faces) -> Faces:
    """The polygons that a path must not touch: obstacles and, where the border is a wall, its sides.

    A side is a polygon with one face: the half plane beyond it, which the normal points away from.
    """
    if not scene.walled:
        return obstacles
    (west, south), (east, north) = scene.bounds
    normal = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    return Faces(
        np.concatenate([obstacles.ptr, obstacles.ptr[-1] + np.arange(1, 5)]),
        np.vstack([obstacles.normal, normal]),
        np.concatenate([obstacles.offset, [west, -east, south, -north]]),
    )


def pack_nearby(barriers: Faces, bounds: FloatArray) -> Nearby:
    """For each square of a grid over the map, the barriers sorted by the distance of its centre."""
    (west, south), (east, north) = bounds
    m = len(barriers.ptr) - 1
    along = int(np.clip(math.sqrt(NEARBY_ENTRIES / max(m, 1)), 1, NEARBY_SQUARES))
    side = max(east - west, north - south) / along
    columns, rows = (max(1, math.ceil(length / side - 1e-9)) for length in (east - west, north - south))
    x, y = west + side * (np.arange(columns) + 0.5), south + side * (np.arange(rows) + 0.5)
    gap = np.empty((columns, rows, m))
    for i in range(columns if m else 0):
        beyond = np.outer(barriers.normal[:, 0], np.full(rows, x[i])) + np.outer(barriers.normal[:, 1], y)
        gap[i] = np.maximum.reduceat(beyond - barriers.offset[:, None], barriers.ptr[:-1], axis=0).T
    gap = gap.reshape(columns * rows, m)
    order = np.argsort(gap, axis=1, kind="stable")
    below = np.nextafter(np.take_along_axis(gap, order, axis=1).astype(np.float32), np.float32(-np.inf))
    owner = np.repeat(np.arange(m), np.diff(barriers.ptr))
    return Nearby(
        float(west), float(south), float(side), columns, rows, order.astype(np.int32), below,
        owner.astype(np.int32),
    )  # fmt: skip


def pack_cells(bounds: FloatArray, decomposition: Decomposition) -> Cells:
    """The cells with the grid that finds the cell of a point."""
    (west, south), (east, north) = bounds
    ptr, index = bucket_cells(decomposition, bounds)
    faces = pack_faces(decomposition.cells)
    return Cells(float(west), float(south), float(east), float(north), BUCKETS, ptr, index, faces)


# --- wind and motion --------------------------------------------------------------------------


def pack_wind(field: WindField, dt: float, max_steps: int) -> kd.Wind:
    """The wind on its lattice and, for every step of ``dt`` [s], the two times of the data around it.

    Raises
    ------
    DataError
        If the wind is not known at departure.
    """
    t: FloatArray = dt * np.arange(max_steps, dtype=float)
    t = t[t <= field.known_until + 1e-6]
    if len(t) == 0 or field.times[0] > 1e-6:
        raise DataError(
            f"the wind is known from {field.times[0]:.0f} s to {field.known_until:.0f} s after departure, "
            "not at departure itself; give mission.start_time within the data"
        )
    slot = np.clip(np.searchsorted(field.times, t, side="right") - 1, 0, max(len(field.times) - 2, 0))
    if len(field.times) == 1:
        weight = np.zeros(len(t), float)
    else:
        weight = np.clip((t - field.times[slot]) / np.diff(field.times)[slot], 0.0, 1.0)
    return kd.Wind(
        float(field.origin[0]), float(field.origin[1]), 1.0 / field.spacing, slot.astype(np.int64), weight,
        np.ascontiguousarray(field.mean), np.ascontiguousarray(field.latent_var),
        np.ascontiguousarray(field.gust_var), field.time_variance(t),
    )  # fmt: skip


def pack_modes(field: WindField, wind: kd.Wind, dt: float, speed: float) -> kd.Modes:
    """The coherent law: each step uses the modes of the nearest slot, and each part of the error persists.

    The error outside the modes is correlated over ``rest_length`` [m]. For it 2 rest_length / ``speed`` [s]
    takes the place of ``gust_time``, but at most the whole flight; ``speed`` [m/s]: of the robot.

    Eq. (M19) of docs/mathematics.md.
    """
    steps = len(wind.slot)
    slot = np.where(wind.weight > 0.5, wind.slot + 1, wind.slot)
    found = field.modes or NO_MODES
    psi = found.psi if field.modes else np.zeros((len(field.times), 2, 2, 2, 0), np.float32)
    keep = part_persistence(field, wind, slot, dt)
    part = np.maximum(found.part, 0)
    scale = np.ones((steps, len(part)), np.float32)
    scale[:, found.part == TIME] = np.sqrt(wind.between)[:, None]
    slope, bend = mean_derivatives(field.mean, field.spacing)
    return kd.Modes(
        float(found.origin[0]), float(found.origin[1]), 1.0 / found.spacing, slot.astype(np.int64),
        np.cumsum((keep[:steps] < 1.0).any(axis=1)), keep, part, keep[:, part].astype(np.float32), scale,
        np.ascontiguousarray(psi, np.float32), slope, bend, field.gust_time / dt,
        min(2.0 * found.rest_length / (speed * dt), float(steps)),
    )  # fmt: skip


def part_persistence(field: WindField, wind: kd.Wind, slot: IntArray, dt: float) -> FloatArray:
    """Correlation (S + 1, parts) of θ with θ of the step before, for each part of the error.

    The errors of interpolation in space and of the forecast change from slot to slot, each part of the
    forecast with its memory at the lead of the slot. The error of
    interpolation in time is independent in every gap between fields; for a held field it changes every
    ``HELD_EPOCH``, with the correlation of the wind's changes since the time of the field; for one that was
    conditioned on a fix, it changes from slot to slot. Members of an ensemble do not change.

    Eq. (M14) of docs/mathematics.md.
    """
    steps, times, last = len(wind.slot), field.times, field.last_field
    keep = np.ones((steps + 1, len(PARTS)))
    passed = np.diff(np.minimum(times, last)[slot], prepend=min(times[slot[0]], last))
    if field.modes is not None:
        keep[:steps, SPACE] = field.modes.rho ** (passed / field.modes.gap)
    leads = field.leads[np.append(slot[:1], slot[:-1])]
    for number, part in forecast_parts(field.error):
        keep[:steps, number] = part.persistence(leads, passed)
    if field.error is not None and field.held is not None:
        for n in np.flatnonzero(np.diff(slot)) + 1:
            keep[n, HELD] = field.error.change_correlation(*(times[slot[n - 1 : n + 1]] - last))
    elif field.error is not None:
        late = np.floor((dt * np.arange(steps) - times[-1]) / HELD_EPOCH).astype(int)
        gap = np.where(late >= 0, len(times) + late, wind.slot)
        for n in np.flatnonzero(np.diff(gap)) + 1:
            middles = (late[n - 1] + 0.5) * HELD_EPOCH, (late[n] + 0.5) * HELD_EPOCH
            keep[n, TIME] = field.error.change_correlation(*middles) if late[n - 1] >= 0 else 0.0
    return keep


def mean_derivatives(mean: FloatArray, spacing: float) -> tuple[FloatArray, FloatArray]:
    """First (K, NX, NY, 4) [1/s] and second (K, NX, NY, 6) [1/(m s)] differences of the expected wind."""

    def along(table: FloatArray, axis: int) -> FloatArray:
        return np.asarray(np.gradient(table, spacing, axis=axis), float)

    x, y = along(mean, 1), along(mean, 2)
    slope = np.stack([x[..., 0], y[..., 0], x[..., 1], y[..., 1]], axis=-1)
    xx, xy, yy = along(x, 1), 0.5 * (along(x, 2) + along(y, 1)), along(y, 2)
    bend = np.stack([d[..., c] for c in (0, 1) for d in (xx, xy, yy)], axis=-1)
    return np.ascontiguousarray(slope), np.ascontiguousarray(bend)


def pack_motion(robot: RobotConfig, ball: float, judge: str = "bound") -> kd.Motion:
    """Matrices, feedback and bounds of the robot; ``ball`` is the ball of the maximum-trace rule.

    No airspeed is reserved for feedback where flights judge: they show what a robot at its limits cannot
    correct.

    Eq. (M1) of docs/mathematics.md.
    """
    a, b = np.array(robot.a, float), np.array(robot.b, float)
    open_loop = kd.Motion(
        a=a,
        closed=a,
        gain=0.0,
        exposed=1.0,
        effort=math.sqrt(-2.0 * math.log(robot.effort_risk)) if judge == "bound" else 0.0,
        b=b,
        b_inv=np.linalg.inv(b),
        dt=robot.dt,
        u_min=robot.u_min,
        u_max=robot.u_max,
        ball=ball,
    )
    return motion_with_feedback(open_loop, robot.feedback_time)


def pack_errors(robot: RobotConfig) -> kd.RobotErrors:
    """The law of the robot's own errors; settings count headings clockwise, the law does not.

    Eq. (M24a) of docs/mathematics.md.
    """
    sd = np.array([robot.airspeed_sd or 0.0, math.radians(robot.heading_sd or 0.0), robot.clock_sd or 0.0])
    mean = np.array([robot.airspeed_bias, -math.radians(robot.heading_bias), robot.clock_bias])
    if not sd.any():
        return kd.EXACT
    turned = np.array([1.0, -1.0, 1.0])
    if isinstance(robot.dt, float) and robot.clock_bias >= 0.5 * robot.dt:
        raise ConfigError(
            f"robot.clock_bias = {robot.clock_bias:g} s is not below half a step, robot.dt = {robot.dt:g} s: "
            "set the clock, or plan in longer steps"
        )
    correlation, (r, s, t) = np.eye(3), robot.error_correlation
    correlation[[0, 0, 1], [1, 2, 2]] = correlation[[1, 2, 2], [0, 0, 1]] = r, s, t
    correlation *= np.outer(turned, turned)
    root = sd[:, None] * np.linalg.cholesky(correlation)
    unit = np.array([1.0, -math.radians(1.0), 1.0])
    shared = np.array(robot.start_error_covariance, float) * unit[:, None]
    return kd.RobotErrors(mean, root, np.ascontiguousarray((np.linalg.pinv(root, rcond=1e-12) @ shared).T))


def pack_landmarks(
    robot: RobotConfig, marks: Sequence[FloatArray], fixes: Sequence[FixShape | None] = ()
) -> kd.Landmarks:
    """Landmarks, the errors of their fixes, and the share of a known deviation corrected in one step.

    ``fixes`` are the errors of the first landmarks; None, and missing ones, mean ``robot.fix_sd``.
    """
    middle = np.array([polygon.mean(axis=0) for polygon in marks])
    radius = [np.linalg.norm(polygon - own, axis=1).max() for polygon, own in zip(marks, middle, strict=True)]
    usual = FixShape(robot.fix_sd, robot.fix_sd)
    error = np.stack([(fix or usual).cov for fix, _ in zip_longest(fixes, marks)])
    gain, _ = feedback_shares(robot.fix_time, robot.dt)
    return kd.Landmarks(
        pack_faces(marks), pack_corners(range(len(marks)), marks), np.column_stack([middle, radius]), error,
        gain,
    )  # fmt: skip


# --- models -----------------------------------------------------------------------------------


def pack_theorem2(
    decomposition: Decomposition, automaton: Automaton, cells: Cells, logic: Logic,
    epochs: Sequence[Epoch],
) -> Theorem2:  # fmt: skip
    """The paper's bound: convex parts of the regions to visit, and the propositions of each cell by epoch."""
    windows, atoms = automaton.windows, automaton.atoms
    place = {name: windows[name].region if name in windows else name for name in atoms}
    visits = [name for name in atoms if place[name] is not None and name not in automaton.forbidden]
    regions = {name: decomposition.regions.get(place[name] or "", ()) for name in visits}
    parts = [(atoms.index(name), part) for name, own in regions.items() for part in own]
    owner = np.array([atom for atom, _ in parts], np.int64)
    letters = [[letter_of(label, windows, one.now) for label in decomposition.labels] for one in epochs]
    holds = [[[name in regions and name in shown for name in atoms] for shown in row] for row in letters]
    faces = pack_faces([part for _, part in parts])
    return Theorem2(faces, owner, np.array(holds, bool), cells, logic)


def pack_laws(
    robot: RobotConfig,
    planner: PlannerConfig,
    motion: kd.Motion,
    wind: WindField,
    marks: kd.Landmarks | None,
) -> dict[str, kd.Law]:
    """Every wind law by name; the coherent one uses position fixes where there are landmarks (``marks``)."""
    lattice = pack_wind(wind, robot.dt, planner.max_steps)
    modes = pack_modes(wind, lattice, robot.dt, robot.u_max)
    errors = pack_errors(robot)
    coherent: kd.Law = kd.CoherentLaw(lattice, modes, motion, errors)
    if marks is not None:
        coherent = kd.LandmarkLaw(lattice, modes, motion, marks, errors)
    return {"independent": kd.IndependentLaw(lattice, motion), "coherent": coherent}


def pack_collision(
    kind: str, barriers: Faces, nearby: Nearby, epsilon: float, delta: float
) -> CollisionBound:
    """The collision bound ``step``, which splits epsilon equally over the barriers, or ``path``."""
    from scipy.special import ndtri

    if kind == "path":
        return PathBound(barriers, nearby, epsilon, delta)
    if epsilon >= NO_LIMIT:
        raise ConfigError(
            "planner.epsilon=null needs fidelity.collision_bound=path: Eq. (9) divides epsilon among the "
            "obstacles; set planner.epsilon, e.g. 0.05"
        )
    return StepBound(barriers, nearby, float(-ndtri(epsilon / max(len(barriers.ptr) - 1, 1))))


def build_problem(
    robot: RobotConfig, planner: PlannerConfig, wind_cfg: WindConfig, scene: Scene, wind: WindField,
    decomposition: Decomposition, automaton: Automaton, fidelity: FidelityConfig = PAPER,
) -> Problem:  # fmt: skip
    """Make the problem from its parts, and check them against each other.

    Raises
    ------
    DataError
        If the wind is not known at departure, or is faster than the robot everywhere.
    """
    robot = with_time_step(robot, scene, planner.max_steps)
    epsilon = NO_LIMIT if planner.epsilon is None else planner.epsilon
    marks = used_landmarks(scene, robot, fidelity)
    _refuse_strong_wind(robot, wind)
    laws = pack_laws(robot, planner, pack_motion(robot, wind_cfg.ball, fidelity.judge), wind, marks)
    cells = pack_cells(scene.bounds, decomposition)
    epoch, epochs = epochs_of(automaton.windows, float(robot.dt), planner.max_steps)
    logic = pack_logic(automaton, decomposition, epoch, epochs)
    theorem2 = pack_theorem2(decomposition, automaton, cells, logic, epochs)
    ordered = pack_ordered(decomposition, cells, logic)
    obstacles = pack_faces(decomposition.obstacles)
    missions: dict[str, MissionBound] = {"theorem2": theorem2, "ordered": ordered}
    barriers = pack_barriers(scene, obstacles)
    nearby = pack_nearby(barriers, scene.bounds)
    collision = pack_collision(fidelity.collision_bound, barriers, nearby, epsilon, planner.delta)
    coherent = laws["coherent"]
    assert not isinstance(coherent, kd.IndependentLaw)
    return Problem(
        scene=scene,
        decomposition=decomposition,
        world=kd.World(laws[fidelity.law], missions[fidelity.mission_bound], collision),
        laws=laws,
        theorem2=theorem2,
        ordered=ordered,
        automaton=automaton,
        labels=tuple(places_of(label, automaton.windows) for label in decomposition.labels),
        fidelity=fidelity,
        obstacles=obstacles,
        start_variance=robot.start_sd**2,
        epsilon=epsilon,
        max_steps=planner.max_steps,
        wind_ends=wind.ends,
        energy=energy_model(robot.power),
        costs=ALWAYS,
        turns=turns_of(robot),
        tail=error_tail(wind, coherent.modes.slot, coherent.modes.epoch),
    )


def used_landmarks(scene: Scene, robot: RobotConfig, fidelity: FidelityConfig) -> kd.Landmarks | None:
    """The landmarks at which the robot of these settings measures; a warning states why there are none."""
    missing = missing_for_fixes(robot, fidelity)
    if scene.landmarks and missing:
        LOG.warning("scene.landmarks are not used: position fixes need %s", missing)
    used = bool(scene.landmarks) and not missing
    return pack_landmarks(robot, scene.landmarks, scene.landmark_fixes) if used else None


def missing_for_fixes(robot: RobotConfig, fidelity: FidelityConfig) -> str:
    """The settings that position fixes need and that are not set; empty if the robot takes fixes."""
    needs = {
        "fidelity.law=coherent": fidelity.law == "coherent",
        "fidelity.judge=flights (a bound does not show who misses a landmark)": fidelity.judge == "flights",
        "robot.feedback_time=null (a robot that always knows its position)": robot.feedback_time is None,
    }
    return " and ".join(need for need, met in needs.items() if not met)


def with_landmarks(problem: Problem, robot: RobotConfig, marks: Sequence[FloatArray]) -> Problem:
    """``problem`` with further landmarks ``marks``, convex polygons (n, 2) [m], for this robot.

    Raises
    ------
    ConfigError
        If the robot takes no position fixes.
    """
    if missing := missing_for_fixes(robot, problem.fidelity):
        raise ConfigError(f"the robot of this plan takes no position fixes: they need {missing}")
    fixes, without = problem.scene.landmark_fixes, (None,) * len(marks)
    scene = replace(
        problem.scene,
        landmarks=(*problem.scene.landmarks, *marks),
        landmark_fixes=(*fixes, *without) if fixes else (),
    )
    robot = replace(robot, dt=problem.motion.dt)
    plain = unaided(problem.laws["coherent"])
    assert isinstance(plain, kd.CoherentLaw)
    packed = pack_landmarks(robot, scene.landmarks, scene.landmark_fixes)
    law = kd.LandmarkLaw(plain.wind, plain.modes, plain.motion, packed, plain.errors)
    laws, world = {**problem.laws, "coherent": law}, problem.world._replace(law=law)
    return replace(problem, scene=scene, laws=laws, world=world)


def disc(middle: FloatArray, radius: float) -> FloatArray:
    """A regular polygon (``CORNERS``, 2) [m] with the area of a disc."""
    angles = 2.0 * np.pi * np.arange(CORNERS) / CORNERS
    size = radius * np.sqrt(2.0 * np.pi / (CORNERS * np.sin(2.0 * np.pi / CORNERS)))
    return np.asarray(middle + size * np.column_stack([np.cos(angles), np.sin(angles)]), float)


def _refuse_strong_wind(robot: RobotConfig, wind: WindField) -> None:
    calmest = float(np.linalg.norm(wind.mean, axis=-1).min())
    if calmest > robot.u_max:
        raise DataError(
            f"robot.u_max = {robot.u_max:g} m/s is below the wind everywhere on the map (at least "
            f"{calmest:.1f} m/s): the robot could only drift; raise robot.u_max or change mission.start_time"
        )
