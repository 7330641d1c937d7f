"""Certificates: half planes such that a flight whose positions lie in them succeeds.

A flight certainly succeeds if, for some choice of visits and of lines beside obstacles,

- at the step of each visit the position lies in a convex polygon that shows its label,
- both ends of every segment lie beyond one line that the obstacle does not cross: one of its faces, or a line
  that touches it and runs along the segment; so for hazards, cells whose letter leads away from acceptance,
- if the border is a wall, no position lies beyond it.

All of these are half planes n' x_t <= b. A flight that fails violates at least one of them, so the half
planes beyond the lines cover all failures. Of the certificates of a flight, :func:`find_certificate` returns
the one that flights near it are least likely to violate: with d the distance of its position from a line, in
standard deviations of the position, the sum of Φ(-d) over the lines of its visits is least.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TypeAlias

import numpy as np
from scipy.special import ndtr

from pareto_ltl.kernels.claims import ClaimCosts, ClaimEdges, cheapest_claims
from pareto_ltl.kernels.data import Faces, Logic
from pareto_ltl.planning.epochs import step_epochs
from pareto_ltl.planning.pack_logic import LIVE
from pareto_ltl.planning.problem import Problem
from pareto_ltl.support.arrays import BoolArray, FloatArray, IntArray
from pareto_ltl.world.cells import half_planes

Key: TypeAlias = tuple[float, ...]  # (step, face), or (step, normal, offset) of a line that touches
NEAR = 3.0  # standard deviations: closer to an obstacle, lines along the segment are tried
FAR = 9.0  # standard deviations: a line farther away is left out, its probability is 1e-19
LEAST_SD = 1e-3  # [m] across a line: with less, the side of the position counts as known
SHARED_AREA = 1e-6  # of a cell: a smaller intersection with a polygon is rounding error


@dataclass(frozen=True, slots=True)
class Lines:
    """Half planes ``normal' x_step <= offset``.

    Attributes
    ----------
    step : (K,) int, normal : (K, 2) float, offset : (K,) float
        The normals have unit length and point away from where the position should be; offsets in metres.
    sd : (K,) float
        Standard deviation of the position along the normal [m].
    key : tuple of K tuples
        Equal for equal lines.
    """

    step: IntArray
    normal: FloatArray
    offset: FloatArray
    sd: FloatArray
    key: tuple[Key, ...]

    def __len__(self) -> int:
        return len(self.key)


@dataclass(frozen=True, slots=True)
class Landscape:
    """Polygons and automaton from which certificates of flights near one plan are made.

    Attributes
    ----------
    x : (T+1, 2) float, cov : (T+1, 2, 2) float
        Mean [m] and covariance [m²] of the position.
    normal : (F, 2) float, offset : (F,) float
        Faces of all polygons, as half planes for a position; ``sd`` (T+1, F) across them [m].
    shown : tuple of slice
        The faces of each convex polygon that shows a label.
    shunned, hazards, barriers : tuple of slice
        The faces of each polygon to stay out of: a cell with a label, a hazard, an obstacle or a wall.
    corners : tuple of (K, 2) float
        Corners of each hazard, then of each barrier [m]; a wall has none.
    edges : ClaimEdges
        The automaton; ``start`` (Q,) is 0 where the initial state is as good as q, else inf.
    accepting : (Q,) bool
    """

    x: FloatArray
    cov: FloatArray
    normal: FloatArray
    offset: FloatArray
    sd: FloatArray
    shown: tuple[slice, ...]
    shunned: tuple[slice, ...]
    hazards: tuple[slice, ...]
    barriers: tuple[slice, ...]
    corners: tuple[FloatArray, ...]
    edges: ClaimEdges
    start: FloatArray
    accepting: BoolArray


# --- polygons and edges ------------------------------------------------------------------------


def landscape(problem: Problem, x: FloatArray, cov: FloatArray) -> Landscape:
    """The polygons and the automaton of ``problem`` for certificates of flights near a plan.

    The plan has means ``x`` (T+1, 2) [m] and covariances ``cov`` (T+1, 2, 2) [m²]. Barriers farther than
    ``FAR`` standard deviations from it are left out.
    """
    logic, faces = problem.logic, problem.cells.faces
    labelled = [c for c, label in enumerate(problem.labels) if label]
    polygons, members = shown_polygons(problem, labelled)
    walls = [np.empty((0, 2))] * (len(problem.barriers.ptr) - 1 - len(problem.decomposition.obstacles))
    outlines = [*problem.decomposition.obstacles, *walls]
    near = near_barriers(problem.barriers, x, cov)
    hazards = logic.hazards.cell.tolist()
    groups = [
        [half_planes(polygon) for polygon in polygons],
        [outer_planes(faces, c) for c in labelled],
        [outer_planes(faces, c) for c in hazards],
        [outer_planes(problem.barriers, j) for j in near],
    ]
    planes = [plane for group in groups for plane in group]
    rows = iter(consecutive_rows([len(offset) for _, offset in planes]))
    shown, shunned, hazard_rows, barriers = (tuple(next(rows) for _ in group) for group in groups)
    normal = np.vstack([np.empty((0, 2)), *[n for n, _ in planes]])
    variance = np.einsum("fi,tij,fj->tf", normal, cov, normal)
    return Landscape(
        x=x, cov=cov, normal=normal, offset=np.concatenate([np.empty(0), *[b for _, b in planes]]),
        sd=np.sqrt(np.maximum(variance, LEAST_SD**2)),
        shown=shown, shunned=shunned, hazards=hazard_rows, barriers=barriers,
        corners=(*[problem.decomposition.cells[c] for c in hazards], *[outlines[j] for j in near]),
        edges=claim_edges(logic, labelled, members),
        start=np.where(logic.covers[logic.initial], 0.0, np.inf), accepting=logic.distance == 0.0,
    )  # fmt: skip


def consecutive_rows(sizes: Sequence[int]) -> list[slice]:
    """Slices of the given sizes, one after another."""
    ends = np.cumsum([0, *sizes]).tolist()
    return [slice(first, last) for first, last in pairwise(ends)]


def outer_planes(faces: Faces, part: int) -> tuple[FloatArray, FloatArray]:
    """Normals and offsets of the half planes outside of a polygon."""
    rows = slice(int(faces.ptr[part]), int(faces.ptr[part + 1]))
    return -faces.normal[rows], -faces.offset[rows]


def near_barriers(barriers: Faces, x: FloatArray, cov: FloatArray) -> list[int]:
    """Barriers that some segment does not clear by ``FAR`` standard deviations along one of their faces."""
    near = []
    for j in range(len(barriers.ptr) - 1):
        normal, offset = outer_planes(barriers, j)
        sd = np.sqrt(np.maximum(np.einsum("fi,tij,fj->tf", normal, cov, normal), LEAST_SD**2))
        gap = (offset - x @ normal.T) / sd
        if np.minimum(gap[:-1], gap[1:]).max(axis=1).min(initial=np.inf) < FAR:
            near.append(j)
    return near


def shown_polygons(problem: Problem, labelled: Sequence[int]) -> tuple[list[FloatArray], list[list[int]]]:
    """Convex polygons that show labels, each with its cells as indices into ``labelled``.

    They are the cells with a label, and the convex parts of regions that consist of several such cells.
    """
    import shapely

    cells = [problem.decomposition.cells[c] for c in labelled]
    polygons, members = list(cells), [[i] for i in range(len(cells))]
    shapes = np.array([shapely.Polygon(cell) for cell in cells], object)
    for parts in problem.decomposition.regions.values():
        for part in parts:
            common = shapely.area(shapely.intersection(shapes, shapely.Polygon(part)))
            inside = np.flatnonzero(common > SHARED_AREA * shapely.area(shapes)).tolist()
            if len(inside) > 1:
                polygons.append(part)
                members.append(inside)
    return polygons, members


def claim_edges(logic: Logic, labelled: Sequence[int], members: Sequence[Sequence[int]]) -> ClaimEdges:
    """The edges between claims, without redundant ones.

    From q, a position in a polygon leads to p if the label of each of its cells c leads to a state as good as
    p and c does not lose q; any position does if the empty label leads there and the position is outside all
    cells whose label does not. An edge is redundant if another one of the same polygon leads to a claim that
    is as good and that no more hazards lose, and has no more cells to avoid. Of equal edges the first is
    kept.

    In automata of more than ``LIVE`` states the claims behind q are q itself and where labels lead to, as for
    margins of flights: tables of all pairs of claims for each label take 4 GB for 16,384 states.
    """
    rows: list[tuple[int, int, int]] = []
    shunned: list[IntArray] = []
    first = [0]
    for e in range(len(logic.delta)):
        _add_edges(logic, e, labelled, members, rows, shunned)
        first.append(len(rows))
    source, target, shown = np.array(rows, np.int64).reshape(-1, 3).T.copy()
    ptr = np.cumsum([0, *map(len, shunned)]).astype(np.int64)
    cells = np.concatenate([np.empty(0, np.int64), *shunned])
    return ClaimEdges(
        source, target, shown, ptr, cells, logic.loses[:, :, logic.hazards.cell].copy(),
        np.array(first, np.int64), logic.epoch,
    )  # fmt: skip


def _add_edges(
    logic: Logic, e: int, labelled: Sequence[int], members: Sequence[Sequence[int]],
    rows: list[tuple[int, int, int]], shunned: list[IntArray],
) -> None:  # fmt: skip
    """Append the edges of epoch ``e``: source, target and polygon, and the cells that each avoids."""
    delta, loses, columns = logic.delta[e], logic.loses[e], [*labelled, -1]
    ever = np.concatenate(logic.loses, axis=1)
    for q in range(len(delta)):
        claims = _claims_behind(delta, q, columns)
        good = logic.covers[np.ix_(delta[q, columns], claims)]  # (C + 1, K)
        spoils, keeps = ~good[:-1], ~loses[q, labelled, None]
        better = logic.covers[np.ix_(claims, claims)] & ~_exceeds(ever[claims])
        spoiling = (spoils & keeps).T
        nothing = np.zeros((len(claims), 0), bool)
        # first: of equal edges the one without lines of a polygon is kept
        choices = [(-1, good[-1], spoiling)]
        for g, own in enumerate(members):
            choices.append((g, (~spoils[own] & keeps[own]).all(axis=0), nothing))
        for g, reaches, shuns in choices:
            for k in _needed(np.flatnonzero(reaches), better, shuns):
                rows.append((q, int(claims[k]), g))
                shunned.append(np.flatnonzero(shuns[k]))


def _claims_behind(delta: IntArray, q: int, columns: Sequence[int]) -> IntArray:
    """Claims that edges from ``q`` may lead to; all of them in small automata."""
    if len(delta) <= LIVE:
        return np.arange(len(delta))
    return np.unique(np.append(delta[q, columns], q))


def _exceeds(table: BoolArray) -> BoolArray:
    """Entry (i, k): row i of ``table`` is true somewhere where row k is not."""
    return np.asarray(table.astype(np.float32) @ (~table).T.astype(np.float32) > 0.5, bool)


def _needed(reached: IntArray, better: BoolArray, shuns: BoolArray) -> list[int]:
    """The claims among ``reached`` that no other one makes redundant.

    ``better[p, q]``: claim p is at least as strong as q; ``shuns`` (Q, C) are the cells that each has to
    avoid.
    """
    at_least = better[np.ix_(reached, reached)] & ~_exceeds(shuns[reached])
    first = np.arange(len(reached))[:, None] < np.arange(len(reached))
    instead = at_least & (~at_least.T | first)
    return [int(p) for p in reached[~instead.any(axis=0)]]


# --- the certificate of one flight -------------------------------------------------------------


def find_certificate(scape: Landscape, y: FloatArray, broken: Collection[Key]) -> Lines | None:
    """A certificate of the flight ``y`` (T+1, 2) [m]; None if none is found.

    ``broken`` are keys of faces that must not be used: the flight is assumed to violate them. Lines that are
    more than ``FAR`` standard deviations from the plan itself are left out.
    """
    gap = (scape.offset - y @ scape.normal.T) / scape.sd
    for key in broken:
        if len(key) == 2:
            gap[int(key[0]), int(key[1])] = -math.inf
    ways = [
        _lines_beside(scape, y, gap, rows, corners)
        for rows, corners in zip((*scape.hazards, *scape.barriers), scape.corners, strict=True)
    ]
    hazards, barriers = ways[: len(scape.hazards)], ways[len(scape.hazards) :]
    if any(way.margin.min() <= 0.0 for way in barriers):
        return None
    costs = ClaimCosts(
        _columns(len(y), [_chance(gap[:, rows]).sum(axis=1) for rows in scape.shown]),
        _columns(len(y), [_chance(gap[:, rows].max(axis=1)) for rows in scape.shunned]),
        _columns(len(y), [_chance(way.margin) for way in hazards]),
    )
    run = _best_run(scape, costs)
    if run is None:
        return None
    pieces = _lines_of_run(scape, gap, run, hazards)
    for way in barriers:
        pieces += way.lines_of(np.arange(len(y)))
    return _gathered(scape, pieces)


Piece: TypeAlias = tuple[IntArray, FloatArray, FloatArray, IntArray]  # step, normal, offset, face or -1


@dataclass(frozen=True, slots=True)
class Way:
    """The best line between a polygon and each segment.

    Row t is the segment that ends at step t, row 0 the first position alone. ``face`` is -1 for a line that
    touches a corner.
    """

    margin: FloatArray
    normal: FloatArray
    offset: FloatArray
    face: IntArray

    def lines_of(self, steps: IntArray) -> list[Piece]:
        """The lines of some segments, for both of their ends."""
        own = self.normal[steps], self.offset[steps], self.face[steps]
        return [(steps, *own), (np.maximum(steps - 1, 0), *own)]


def _columns(rows: int, columns: Sequence[FloatArray]) -> FloatArray:
    return np.ascontiguousarray(np.stack(columns, axis=1)) if columns else np.empty((rows, 0))


def _chance(gap: FloatArray) -> FloatArray:
    """Φ(-gap), inf where the position is beyond the line."""
    return np.where(gap > 0.0, ndtr(-gap), math.inf)


def _lines_beside(scape: Landscape, y: FloatArray, gap: FloatArray, rows: slice, corners: FloatArray) -> Way:
    """The faces with the largest margin at both ends of each segment.

    Where that is less than ``NEAR``, lines that run along the segment and touch the polygon, if their margin
    is larger.
    """
    both = gap[:, rows].copy()
    both[1:] = np.minimum(gap[:-1, rows], gap[1:, rows])
    face = rows.start + both.argmax(axis=1)
    margin = both.max(axis=1)
    way = Way(margin, scape.normal[face], scape.offset[face], face)
    close = np.flatnonzero(margin < NEAR)
    close = close[close > 0]
    if len(close) == 0 or len(corners) == 0:
        return way
    along = y[close] - y[close - 1]
    along /= np.maximum(np.linalg.norm(along, axis=1), LEAST_SD)[:, None]
    for normal in (along[:, ::-1] * [-1.0, 1.0], along[:, ::-1] * [1.0, -1.0]):
        offset = (normal @ corners.T).min(axis=1)
        found = np.full(len(close), math.inf)
        for end in (close - 1, close):
            sd = np.sqrt(np.einsum("ki,kij,kj->k", normal, scape.cov[end], normal))
            found = np.minimum(found, (offset - np.sum(normal * y[end], axis=1)) / np.maximum(sd, LEAST_SD))
        better = np.flatnonzero(found > way.margin[close])
        way.margin[close[better]], way.face[close[better]] = found[better], -1
        way.normal[close[better]], way.offset[close[better]] = normal[better], offset[better]
    return way


def _best_run(scape: Landscape, costs: ClaimCosts) -> IntArray | None:
    """The edge taken at each step (T+1,) by the cheapest run to acceptance, if there is one."""
    least = np.empty((len(scape.x) + 1, len(scape.start)))
    via = np.empty((len(scape.x), len(scape.start)), np.int64)
    least[0] = scape.start
    cheapest_claims(scape.edges, costs, least, via)
    at = int(np.argmin(np.where(scape.accepting, least[-1], math.inf)))
    if not scape.accepting[at] or least[-1, at] == math.inf:
        return None
    run = np.empty(len(via), np.int64)
    for t in range(len(via) - 1, -1, -1):
        run[t] = via[t, at]
        at = int(scape.edges.source[run[t]])
    return run


def _lines_of_run(scape: Landscape, gap: FloatArray, run: IntArray, hazards: Sequence[Way]) -> list[Piece]:
    """The lines that the edges of a run require."""
    edges, pieces = scape.edges, list[Piece]()
    epoch = step_epochs(edges.epoch, len(run))
    for t, edge in enumerate(run.tolist()):
        faces = list[int]()
        if edges.shown[edge] >= 0:
            rows = scape.shown[edges.shown[edge]]
            faces += range(rows.start, rows.stop)
        for k in edges.shunned[edges.ptr[edge] : edges.ptr[edge + 1]].tolist():
            rows = scape.shunned[k]
            faces.append(rows.start + int(gap[t, rows].argmax()))
        if faces:
            face = np.array(faces, np.int64)
            pieces.append((np.full(len(face), t, np.int64), scape.normal[face], scape.offset[face], face))
    for h, way in enumerate(hazards):
        pieces += way.lines_of(np.flatnonzero(edges.loses[epoch, edges.source[run], h]))
    return pieces


def _gathered(scape: Landscape, pieces: Sequence[Piece]) -> Lines:
    """The lines of all pieces, each once, without those at ``FAR`` or more from the plan or of known side."""
    if not pieces:
        return Lines(np.empty(0, np.int64), np.empty((0, 2)), np.empty(0), np.empty(0), ())
    step, normal, offset, face = (np.concatenate(columns) for columns in zip(*pieces, strict=True))
    sd = np.sqrt(np.maximum(np.einsum("ki,kij,kj->k", normal, scape.cov[step], normal), 0.0))
    gap = offset - np.sum(normal * scape.x[step], axis=1)
    rows: dict[Key, int] = {}
    for i in np.flatnonzero((sd > LEAST_SD) & (gap < FAR * sd)).tolist():
        t, f = int(step[i]), int(face[i])
        key = (t, f) if f >= 0 else (t, *np.round(normal[i], 6).tolist(), round(float(offset[i]), 2))
        rows.setdefault(key, i)
    kept = np.array(list(rows.values()), np.int64)
    return Lines(step[kept], normal[kept], offset[kept], sd[kept], tuple(rows))
