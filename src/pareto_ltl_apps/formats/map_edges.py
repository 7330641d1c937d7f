"""Edges of places on Earth: straight in longitude and latitude (RFC 7946, 3.1.1), and without a seam.

An edge along a parallel is an arc in the plane, so long edges get further corners. Corners that lie on edges
of other places become corners of these edges too, so that places with a common edge touch in the plane.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import shapely

from pareto_ltl.extend import Place
from pareto_ltl.support.arrays import FloatArray, IntArray

BEND = 2e-4  # of the longer side of the map: how far a straight edge may pass from the true one
CRS_BEND = 30.0  # [m] the same for edges of another system, before the size of the map is known
DEGREE = 111_200.0  # [m] of latitude
MAX_PARTS = 512  # of one edge
ON_EDGE = 1e-8  # [deg], 1 mm: corners this close to an edge lie on it
PROBES = np.array([0.25, 0.5, 0.75])  # of an edge, where its bend is measured

Plane = Callable[[FloatArray], FloatArray]


def unwrapped(places: Sequence[Place]) -> list[Place]:
    """``places`` with longitudes in one range of 360 degrees whose ends lie in the widest empty arc.

    The middle of the range lies between -180 and 180 degrees. Along a ring or a line, longitude changes by at
    most 180 degrees from corner to corner.
    """
    joined = [place.moved(_continuous) for place in places]
    arcs = np.array([_range(line) for place in joined for line in _all_lines(place)])
    if not len(arcs):
        return joined
    seam = _widest_gap(arcs)
    turns = np.floor((arcs[:, 0] - seam) / 360.0)  # whole circles, exact zeros where nothing is to be turned
    west, east = (arcs[:, 0] - 360.0 * turns).min(), (arcs[:, 1] - 360.0 * turns).max()
    turns += np.floor(((west + east) / 2 + 180.0) / 360.0)
    left = iter(turns.tolist())

    def turned(line: FloatArray) -> FloatArray:
        turn = next(left)
        return np.column_stack([line[:, 0] - 360.0 * turn, line[:, 1]]) if turn else line

    return [place.moved(turned) for place in joined]


def _continuous(line: FloatArray) -> FloatArray:
    jumps = np.abs(np.diff(line[:, 0])) > 180.0
    if not jumps.any():
        return line
    return np.column_stack([np.unwrap(line[:, 0], period=360.0), line[:, 1]])


def _all_lines(place: Place) -> list[FloatArray]:
    return [*(ring for polygon in place.polygons for ring in polygon), *place.lines]


def _range(line: FloatArray) -> tuple[float, float]:
    return float(line[:, 0].min()), float(line[:, 0].max())


def _widest_gap(arcs: FloatArray) -> float:
    """A longitude [deg] in the middle of the widest arc that none of ``arcs`` (n, 2) [deg] covers.

    Of gaps of the same width the first one east of -180 is taken, as maps usually end there.
    """
    low = (arcs[:, 0] + 180.0) % 360.0
    order = np.argsort(low, kind="stable")
    low, high = low[order], low[order] + np.diff(arcs[order], axis=1)[:, 0]
    reach = np.maximum.accumulate(high)
    gaps = np.append(low[1:], low[0] + 360.0) - reach
    widest = int(np.argmax(gaps))
    return float(reach[widest] + gaps[widest] / 2 - 180.0)


# --- straight edges ---------------------------------------------------------------------------------------


def straight_in_degrees(
    places: Sequence[Place], metres: Plane, size: float, barriers: Sequence[bool]
) -> list[Place]:
    """``places`` [deg] with corners added to their edges, to be moved to the plane by ``metres``.

    The edges of the result, straight in the plane, pass at most ``BEND * size`` [m] from edges that are
    straight in longitude and latitude. ``barriers`` states which places are obstacles or the border: a corner
    of one on an edge of a region or landmark becomes a corner of both, and the reverse.
    """
    limit = BEND * size
    split = [
        replace(
            place,
            polygons=tuple(
                tuple(_subdivided(ring, metres, limit, True) for ring in p) for p in place.polygons
            ),
            lines=tuple(_subdivided(line, metres, limit, False) for line in place.lines),
        )
        for place in places
    ]
    return _noded(split, barriers)


def _subdivided(line: FloatArray, metres: Plane, limit: float, closed: bool) -> FloatArray:
    """``line`` (n, 2) [deg] with each edge cut into as many equal parts as its bend needs."""
    if len(line) < 2:
        return line
    first = line if closed else line[:-1]
    after = np.roll(line, -1, axis=0) if closed else line[1:]
    after = np.column_stack([first[:, 0] + _shortest(after[:, 0] - first[:, 0]), after[:, 1]])
    parts = _parts(first, after, metres, limit)
    if (parts == 1).all():
        return line
    pieces = []
    for a, b, n in zip(first, after, parts.tolist(), strict=True):
        low, high, turned = (a, b, False) if tuple(a) <= tuple(b) else (b, a, True)
        share = np.linspace(0.0, 1.0, n + 1)[:, None]
        points = low + share * (high - low)  # the same corners in both directions
        points = points[::-1] if turned else points
        pieces.append(np.concatenate([a[None], points[1:-1]]))
    return np.concatenate(pieces if closed else [*pieces, line[-1:]])


def straight_in_crs(line: FloatArray, degrees: Plane, closed: bool) -> FloatArray:
    """``line`` (n, 2) of another system in degrees, with corners added where its edges are bent there.

    The edges pass from the true ones at most ``CRS_BEND`` [m], or ``BEND`` times their length.
    """
    if len(line) < 2:
        return degrees(line)
    first, after = (line, np.roll(line, -1, axis=0)) if closed else (line[:-1], line[1:])
    start, end, middle = degrees(first), degrees(after), degrees((first + after) / 2)
    scale = np.column_stack([np.cos(np.deg2rad(middle[:, 1])), np.ones(len(middle))])
    chord = np.column_stack([_shortest(end[:, 0] - start[:, 0]), end[:, 1] - start[:, 1]])
    away = np.column_stack([_shortest(middle[:, 0] - start[:, 0]), middle[:, 1] - start[:, 1]]) - chord / 2
    limit = np.maximum(CRS_BEND, BEND * DEGREE * np.hypot(*(chord * scale).T))
    bend = DEGREE * np.hypot(*(away * scale).T)
    parts = np.clip(np.ceil(np.sqrt(bend / limit)), 1, MAX_PARTS).astype(np.int64)
    pieces = [a + np.arange(n)[:, None] / n * (b - a) for a, b, n in zip(first, after, parts, strict=True)]
    return degrees(np.concatenate(pieces if closed else [*pieces, line[-1:]]))


def _shortest(turn: FloatArray) -> FloatArray:
    """Differences of longitude as the shorter way round, exact where they are short already."""
    return np.where(np.abs(turn) > 180.0, (turn + 180.0) % 360.0 - 180.0, turn)


def _parts(first: FloatArray, after: FloatArray, metres: Plane, limit: float) -> IntArray:
    """The number of parts of each edge; n parts are each bent by 1/n² of the bend of the edge."""
    start, end = metres(first), metres(after)
    along = end - start
    length = np.maximum(np.linalg.norm(along, axis=1), 1e-9)
    bend = np.zeros(len(first))
    for share in PROBES:
        away = metres(first + share * (after - first)) - start
        across = np.abs(along[:, 0] * away[:, 1] - along[:, 1] * away[:, 0]) / length
        bend = np.maximum(bend, across)
    return np.clip(np.ceil(np.sqrt(bend / limit)), 1, MAX_PARTS).astype(np.int64)


def _noded(places: list[Place], barriers: Sequence[bool]) -> list[Place]:
    """``places`` with corners of the same place, or of the other kind, that lie on an edge as its corners."""
    rings = [
        (number, ring)
        for number, place in enumerate(places)
        for polygon in place.polygons
        for ring in polygon
    ]
    if not rings:
        return places
    owner = np.repeat([number for number, _ in rings], [len(ring) for _, ring in rings])
    corners = np.concatenate([ring for _, ring in rings])
    after = np.concatenate([np.roll(ring, -1, axis=0) for _, ring in rings])
    kind = np.asarray(barriers, bool)[owner]
    tree = shapely.STRtree(np.atleast_1d(np.asarray(shapely.points(corners))).tolist())
    edges = shapely.linestrings(np.stack([corners, after], axis=1))
    edge, corner = tree.query(edges, predicate="dwithin", distance=ON_EDGE)
    a, b, p = corners[edge], after[edge], corners[corner]
    apart = (np.abs(p - a).max(axis=1) > 2 * ON_EDGE) & (np.abs(p - b).max(axis=1) > 2 * ON_EDGE)
    apart &= (owner[edge] == owner[corner]) | (kind[edge] != kind[corner])
    added: dict[int, dict[tuple[float, float], float]] = {}
    for number, point, start in zip(edge[apart].tolist(), p[apart].tolist(), a[apart], strict=True):
        added.setdefault(number, {})[tuple(point)] = float(np.abs(np.array(point) - start).sum())
    if not added:
        return places
    count = iter(range(len(corners)))

    def with_corners(ring: FloatArray) -> FloatArray:
        found = []
        for one in ring:
            more = added.get(next(count), {})
            found += [one, *(np.array(point) for point in sorted(more, key=lambda point: more[point]))]
        return np.stack(found)

    return [
        replace(place, polygons=tuple(tuple(map(with_corners, polygon)) for polygon in place.polygons))
        for place in places
    ]
