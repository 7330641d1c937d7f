"""What keeps each segment of a path away from obstacles, walls and forbidden cells: lines and their risks.

At the end ``planner.epsilon``: which paths keep it in every segment, and the barriers in the way of others.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from careful_io.texts import distance_text, probability_text, round_up
from pareto_ltl.kernels.chance import Chance
from pareto_ltl.kernels.path import Flight
from pareto_ltl.planning.evaluate import propagate
from pareto_ltl.planning.limits import WorstSegment
from pareto_ltl.planning.pack import NO_LIMIT, pack_faces
from pareto_ltl.planning.pack_logic import pack_corners
from pareto_ltl.planning.problem import LEAST_VARIANCE, Problem, barrier_outlines, lines_of
from pareto_ltl.planning.records import PlannedPath
from pareto_ltl.planning.routes.obligations import face_deviations, path_obligations
from pareto_ltl.planning.routes.search_map import search_map
from pareto_ltl.support.arrays import BoolArray, FloatArray, IntArray
from plane_kernels import types as kd
from plane_kernels.supporting_lines import SegmentLines

LOG = logging.getLogger(__name__)

ROWS = 2  # lines of a segment in a programme, the closest ones (3 take half as long again)
ALIKE = 0.25  # relative difference of two risks of a segment that does not decide which path is nearer
ROUNDING = 1e-6  # relative excess over epsilon that is rounding
KEPT = 1.4  # standard deviations that taut lines keep where polygons share epsilon as they need it
_POLYGONS: WeakKeyDictionary[Problem, kd.Corners] = WeakKeyDictionary()
WALLS = ("western", "eastern", "southern", "northern")


@dataclass(frozen=True, slots=True)
class Separation:
    """Half planes c'x >= h that hold both ends of each segment, the closest ``ROWS`` of each.

    Attributes
    ----------
    normal (T, K, 2), offset (T, K) : float
        Unit normals c, and h [m]; c is 0 in rows that are not used.
    sd : (T, 2, K) float
        √(c' Σ c) of both ends [m].
    owner : (T, K) int
        Number of the polygon: barriers, then the forbidden cells of this path; -1 in rows that are not used.
    deviations : float
        Standard deviations that both ends keep from every line.
    risk : (T,) float
        Σ_j Φ(-z_j) over all polygons near the segment, z_j of its nearer end.
    elsewhere : (T,) float
        The part of ``risk`` of the polygons that have no row.
    limit : float
        The largest risk allowed in a segment; inf if ``deviations`` limit it.
    """

    normal: FloatArray
    offset: FloatArray
    sd: FloatArray
    owner: IntArray
    deviations: float
    risk: FloatArray
    elsewhere: FloatArray
    limit: float


def separation(
    problem: Problem, flight: Flight, avoid: BoolArray | None = None, around: float = 0.0
) -> Separation:
    """The lines of every segment of ``flight``, as the collision bound of ``problem`` has them.

    ``avoid`` (T+1, C) are the cells to avoid at each step, by default the forbidden cells of the mission.
    Polygons up to ``around`` [m] away have lines as well, even if they add no risk.
    """
    return SEPARATIONS[type(problem.world.collision)](problem, flight, avoid, around)


def forbidden_polygons(problem: Problem) -> list[FloatArray]:
    """Convex polygons (k, 2) [m] around the labelled cells, which a path may have to avoid."""
    return [polygon for group in search_map(problem).shown.values() for polygon in group.around]


def avoided(problem: Problem, flight: Flight, avoid: BoolArray | None = None) -> BoolArray:
    """Which of the forbidden polygons each segment avoids (T, m); ``avoid`` as in :func:`separation`.

    Where many cells with one label are merged into one shape, it is avoided at steps where all of them are.
    """
    if avoid is None and len(problem.logic.hazards):
        avoid = path_obligations(problem, flight.x, flight.cov).avoid
    elif avoid is None:
        avoid = np.zeros((len(flight.x), len(problem.labels)), bool)
    parts = [np.zeros((len(flight.u), 0), bool)]
    for group in search_map(problem).shown.values():
        hit = avoid[:, group.cells]
        if group.united:
            hit = np.repeat(np.all(hit, axis=1, keepdims=True), len(group.around), axis=1)
        parts.append(hit[1:] & hit[:-1])
    return np.hstack(parts)


def allowed_risk(problem: Problem) -> float:
    """``planner.epsilon``, the largest risk of a segment; inf without a limit."""
    return problem.epsilon if problem.epsilon < NO_LIMIT else math.inf


def kept_deviations(problem: Problem) -> float:
    """Standard deviations that taut lines, and the faces of Eq. (10), keep from obstacles."""
    bound = problem.world.collision
    return float(bound.z) if isinstance(bound, kd.StepBound) else KEPT


# --- supporting lines --------------------------------------------------------------------------


def chance_along(problem: Problem, flight: Flight, stiff: float) -> Chance:
    """The chance constraint of paths in the steps of ``flight``, and in its order of visits."""
    T, limit = len(flight.u), allowed_risk(problem)
    asked = not math.isinf(limit)  # else what a path avoids is not looked for
    requested = _requested(problem, flight, None) if asked else np.zeros((T, 0), bool)
    lines = SegmentLines(np.empty((T, ROWS, 4)), np.empty((T, ROWS), np.int64), np.empty(T))
    return Chance(stiff, _all_polygons(problem), requested, limit, LEAST_VARIANCE, lines, np.empty((ROWS, 4)))


def excess(problem: Problem, flight: Flight) -> FloatArray:
    """By how much the risk of each segment exceeds epsilon, relative to it (T,); 0 where it is kept."""
    limit = allowed_risk(problem)
    if math.isinf(limit):
        return np.zeros(len(flight.u))
    return np.maximum(segment_risks(problem, flight) / limit - 1.0 - ROUNDING, 0.0)


def segment_risks(problem: Problem, flight: Flight) -> FloatArray:
    """The probability of a collision in each segment (T,) of ``flight``."""
    if isinstance(problem.world.collision, kd.StepBound):
        return separation(problem, flight).risk
    requested = _requested(problem, flight, None)
    return lines_of(_all_polygons(problem), requested, flight.x, flight.cov, 1).risk


def _all_polygons(problem: Problem) -> kd.Corners:
    """The barriers, then the forbidden polygons, made once."""
    found = _POLYGONS.get(problem)
    if found is None:
        polygons = [*barrier_outlines(problem), *forbidden_polygons(problem)]
        _POLYGONS[problem] = found = pack_corners(range(len(polygons)), polygons)
    return found


def _requested(problem: Problem, flight: Flight, avoid: BoolArray | None) -> BoolArray:
    """Which of the barriers and forbidden polygons each segment avoids (T, m): all barriers."""
    forbidden = avoided(problem, flight, avoid)
    barriers = len(_all_polygons(problem).radius) - forbidden.shape[1]
    return np.hstack([np.ones((len(flight.u), barriers), bool), forbidden])


def _by_lines(problem: Problem, flight: Flight, avoid: BoolArray | None, around: float) -> Separation:
    """Supporting lines; the programme lets their polygons share ``epsilon`` as they need it, Eq. (M51)."""
    from scipy.special import ndtr

    requested = _requested(problem, flight, avoid)
    line, owner, risk = lines_of(_all_polygons(problem), requested, flight.x, flight.cov, ROWS, around)
    normal, offset = line[..., :2], line[..., 2]
    cov = np.stack([flight.cov[:-1], flight.cov[1:]], axis=1)
    n, e = normal[..., 0][:, None], normal[..., 1][:, None]
    variance = n * n * cov[..., :1] + 2.0 * n * e * cov[..., 1:2] + e * e * cov[..., 2:]
    sd = np.sqrt(np.maximum(variance, 0.0) + LEAST_VARIANCE)
    ends = np.stack([flight.x[:-1], flight.x[1:]], axis=1)
    nearer = ((np.einsum("tki,tei->tek", normal, ends) - offset[:, None]) / sd).min(axis=1)
    beside = risk - np.where(owner >= 0, ndtr(-nearer), 0.0).sum(axis=1)
    return Separation(normal, offset, sd, owner, 0.0, risk, np.maximum(beside, 0.0), allowed_risk(problem))


# --- faces, Eq. (10) ---------------------------------------------------------------------------


def _by_faces(problem: Problem, flight: Flight, avoid: BoolArray | None, _around: float) -> Separation:
    """The paper's choice: for each segment one face of every obstacle, and an equal share of epsilon each.

    Only the means have to stay outside of the cells to avoid.
    """
    from scipy.special import ndtr

    polygons, requested = forbidden_polygons(problem), avoided(problem, flight, avoid)
    z = kept_deviations(problem)
    everywhere = np.ones((len(flight.u), len(problem.barriers.ptr) - 1), bool)
    sets = [(problem.barriers, flight.cov, everywhere), (pack_faces(polygons), 0.0 * flight.cov, requested)]
    parts = [_separating_faces(faces, flight.x, cov, z, wanted) for faces, cov, wanted in sets]
    T = len(flight.u)
    parts.append(  # rows that are not used
        (np.zeros((T, ROWS, 2)), np.zeros((T, ROWS)), np.zeros((T, 2, ROWS)), np.full((T, 2, ROWS), np.inf))
    )
    normal, offset, sd, gap = (
        np.concatenate(pair, axis=axis)
        for pair, axis in zip(zip(*parts, strict=True), (1, 1, 2, 2), strict=True)
    )
    left = (gap - z * sd).min(axis=1)
    rows = np.argsort(left, axis=1, kind="stable")[:, :ROWS]
    t, used = np.arange(len(left))[:, None], np.isfinite(np.take_along_axis(left, rows, axis=1))
    barriers = slice(0, everywhere.shape[1])
    nearer = (gap[..., barriers] / np.maximum(sd[..., barriers], math.sqrt(LEAST_VARIANCE))).min(axis=1)
    return Separation(
        np.where(used[..., None], normal[t, rows], 0.0), offset[t, rows],
        np.take_along_axis(sd, rows[:, None], axis=2), np.where(used, rows, -1), z,
        ndtr(-nearer).sum(axis=1), np.zeros(T), math.inf,
    )  # fmt: skip


def _separating_faces(
    faces: kd.Faces, x: FloatArray, cov: FloatArray, z: float, wanted: BoolArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """For every segment and polygon the face with the most room beyond z standard deviations.

    Normals (T, m, 2), offsets (T, m), and of both ends σ and the distance from the face (T, 2, m), inf where
    the polygon is not ``wanted`` (T, m); lengths in metres.
    """
    sd, gap = face_deviations(faces.normal, cov), x @ faces.normal.T - faces.offset
    chosen = separating(faces, gap - z * sd) if wanted.shape[1] else np.zeros(wanted.shape, np.int64)
    t = np.arange(len(wanted))[:, None]
    spread, far = (np.stack([table[t, chosen], table[t + 1, chosen]], axis=1) for table in (sd, gap))
    return faces.normal[chosen], faces.offset[chosen], spread, np.where(wanted[:, None], far, np.inf)


def separating(faces: kd.Faces, room: FloatArray) -> IntArray:
    """For every segment and polygon the face with the most ``room`` (T+1, F) at the closer end, (T, m)."""
    both = np.minimum(room[:-1], room[1:])
    # Where faces tie, as at a corner, the one with the larger sum of both is taken.
    both = both + 1e-6 * (room[:-1] + room[1:])
    largest = np.maximum.reduceat(both, faces.ptr[:-1], axis=1)
    rows = np.where(
        both == np.repeat(largest, np.diff(faces.ptr), axis=1), np.arange(both.shape[1]), both.shape[1]
    )
    return np.asarray(np.minimum.reduceat(rows, faces.ptr[:-1], axis=1), np.int64)


SEPARATIONS: dict[type, Callable[[Problem, Flight, BoolArray | None, float], Separation]] = {
    kd.PathBound: _by_lines,
    kd.StepBound: _by_faces,
}


# --- planner.epsilon ---------------------------------------------------------------------------


def keeps_epsilon(problem: Problem, path: PlannedPath) -> bool:
    """Whether no segment of ``path`` is more likely to collide than ``planner.epsilon`` allows."""
    limit = _limit(problem)
    return math.isinf(limit) or bool(segment_risks(problem, propagate(problem, path.x)).max() <= limit)


def _limit(problem: Problem) -> float:
    """The largest risk of a segment that counts as ``planner.epsilon``; inf without a limit."""
    return allowed_risk(problem) * (1.0 + ROUNDING)


def worst_segment(problem: Problem, path: PlannedPath) -> WorstSegment:
    """The segment of ``path`` that is most likely to collide, and its closest barrier."""
    flight = propagate(problem, path.x)
    part = separation(problem, flight)
    step = int(part.risk.argmax())
    name = _polygon_name(problem, int(part.owner[step, 0]))
    return WorstSegment(step, name, min(1.0, float(part.risk[step])))


def nearest_paths(problem: Problem, paths: Sequence[PlannedPath]) -> tuple[PlannedPath, ...]:
    """The paths whose worst segment exceeds ``planner.epsilon`` least, within :data:`ALIKE` of the least."""
    worst = _largest_risks(problem, paths)
    return tuple(path for path, risk in zip(paths, worst, strict=True) if risk <= (1.0 + ALIKE) * worst.min())


def within_limits(problem: Problem, paths: Sequence[PlannedPath]) -> tuple[PlannedPath, ...]:
    """The paths that keep ``planner.epsilon`` in every segment; a line in the log states how many do not."""
    limit = _limit(problem)
    if not paths or math.isinf(limit):
        return tuple(paths)
    worst = _largest_risks(problem, paths)
    kept = tuple(path for path, risk in zip(paths, worst, strict=True) if risk <= limit)
    if len(kept) < len(paths):
        LOG.info(
            "%d of %d refined paths are not on the front: a segment of each is more likely to collide than "
            "planner.epsilon = %g allows; planner.epsilon=%g would admit the next",
            len(paths) - len(kept), len(paths), problem.epsilon, _admitting(worst[worst > limit].min()),
        )  # fmt: skip
    return kept


def breach_text(problem: Problem, paths: Sequence[PlannedPath]) -> str:
    """Which of ``paths`` is nearest to ``planner.epsilon``, where none keeps it, and its worst segment."""
    path = min(nearest_paths(problem, paths), key=lambda path: path.objectives.length)
    worst = worst_segment(problem, path)
    least = _admitting(_largest_risks(problem, paths).min())
    barrier, steps = problem.scene.barrier_title(worst.nearest), len(path.u)
    return (
        f"no path keeps planner.epsilon = {problem.epsilon:g} in every segment: the nearest of {len(paths)} "
        f"paths ({path.order or 'no region'}, {distance_text(path.objectives.length)}) comes closest to "
        f"{barrier} at step {worst.step + 1} of {steps}, with a collision probability of "
        f"{probability_text(worst.probability)}; set planner.epsilon={least:g}, or null for no limit"
    )


def _largest_risks(problem: Problem, paths: Sequence[PlannedPath]) -> FloatArray:
    """The risk of the worst segment of each path (P,)."""
    return np.array([segment_risks(problem, propagate(problem, path.x)).max() for path in paths])


def _admitting(risk: float) -> float:
    """A value of ``planner.epsilon`` that admits a path whose worst segment has ``risk``."""
    return min(round_up(1.05 * float(risk)), 0.99)


def _polygon_name(problem: Problem, number: int) -> str:
    """The name of the polygon ``number`` of a separation: a barrier, then the forbidden polygons."""
    names = barrier_names(problem)
    for shown, group in search_map(problem).shown.items():
        names += [f"region {' and '.join(sorted(shown))}"] * len(group.around)
    return names[number] if number >= 0 else "no barrier"


def barrier_names(problem: Problem) -> list[str]:
    """Names of the barriers: ``obstacle 3``, the third of the map, for each of its convex parts; walls."""
    import shapely

    outlines = [shapely.Polygon(corners) for corners in problem.scene.obstacles]
    names = []
    for part in problem.decomposition.obstacles:
        gaps = shapely.distance(outlines, shapely.Point(part.mean(axis=0)))
        names.append(f"obstacle {int(np.argmin(gaps)) + 1}")
    return names + [f"the {side} border" for side in WALLS if problem.scene.walled]
