"""Edges of places on Earth: straight in longitude and latitude (RFC 7946, 3.1.1), and without a seam.

An edge along a parallel is an arc in the plane, so long edges get further corners. Corners that lie on edges
of other places become corners of these edges too, so that places with a common edge touch in the plane.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import shapely

from pareto_ltl.support.arrays import FloatArray, IntArray
from pareto_ltl.world.scene_sketch import Place

BEND = 5e-5  # of the longer side of the map: how far a straight edge may pass from the true one
MOST_PARTS = 512  # of one edge
ON_EDGE = 1e-8  # [deg], 1 mm: corners this close to an edge lie on it
PROBES = np.array([0.25, 0.5, 0.75])  # of an edge, where its bend is measured

Plane = Callable[[FloatArray], FloatArray]


def unwrapped(places: Sequence[Place]) -> list[Place]:
    """``places`` with longitudes in one range of 360 degrees whose ends lie in the widest empty arc.

    The middle of the range lies between -180 and 180 degrees. Along a ring or a line, longitude changes by at most 180 degrees from corner to corner.
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


def straight_in_degrees(places: Sequence[Place], metres: Plane, size: float) -> list[Place]:
    """``places`` [deg] with corners added to their edges, to be moved to the plane by ``metres``.

    The edges of the result, straight in the plane, pass at most ``BEND * size`` [m] from edges that are
    straight in longitude and latitude. Corners of one place on an edge of another are corners of both.
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
    return _noded(split)


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


def _shortest(turn: FloatArray) -> FloatArray:
    """Differences of longitude as the shorter way round, exact where they are short already."""
    return np.where(np.abs(turn) > 180.0, (turn + 180.0) % 360.0 - 180.0, turn)


def _parts(first: FloatArray, after: FloatArray, metres: Plane, limit: float) -> IntArray:
    """The number of parts of each edge; the bend of a part is that of the edge over its square."""
    start, end = metres(first), metres(after)
    along = end - start
    length = np.maximum(np.linalg.norm(along, axis=1), 1e-9)
    bend = np.zeros(len(first))
    for share in PROBES:
        away = metres(first + share * (after - first)) - start
        across = np.abs(along[:, 0] * away[:, 1] - along[:, 1] * away[:, 0]) / length
        bend = np.maximum(bend, across)
    return np.clip(np.ceil(np.sqrt(bend / limit)), 1, MOST_PARTS).astype(np.int64)


def _noded(places: list[Place]) -> list[Place]:
    """``places`` with each corner that lies on an edge as a corner of this edge."""
    rings = [ring for place in places for polygon in place.polygons for ring in polygon]
    if not rings:
        return places
    corners = np.unique(np.concatenate(rings), axis=0)
    edges = np.concatenate([np.stack([ring, np.roll(ring, -1, axis=0)], axis=1) for ring in rings])
    tree = shapely.STRtree(shapely.points(corners))
    hits, on = tree.query(shapely.linestrings(edges), predicate="dwithin", distance=ON_EDGE)
    a, b, p = edges[hits, 0], edges[hits, 1], corners[on]
    apart = (np.abs(p - a).max(axis=1) > 2 * ON_EDGE) & (np.abs(p - b).max(axis=1) > 2 * ON_EDGE)
    added: dict[int, list[tuple[float, FloatArray]]] = {}
    for edge, point in zip(hits[apart].tolist(), p[apart], strict=True):
        start = edges[edge, 0]
        added.setdefault(edge, []).append((float(np.abs(point - start).sum()), point))
    if not added:
        return places
    count = iter(range(len(edges)))

    def with_corners(ring: FloatArray) -> FloatArray:
        found = []
        for corner in ring:
            found.append(corner)
            found += [point for _, point in sorted(added.get(next(count), ()), key=lambda item: item[0])]
        return np.stack(found)

    return [
        replace(place, polygons=tuple(tuple(map(with_corners, polygon)) for polygon in place.polygons))
        for place in places
    ]
