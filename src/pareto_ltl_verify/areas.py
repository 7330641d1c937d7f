"""Whether drawn lines and rings are the lines and areas that they should be, within a tolerance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pareto_ltl_verify.arrays import BoolArray, FloatArray, IntArray
from pareto_ltl_verify.geometry import in_plane, outline_distance, signed_area, within

TOLERANCE = 0.5  # [m] between a drawn place and the true one
CHUNK = 2_000_000  # products of points and corners that are held at a time
MOST = 50_000_000  # products of points and corners up to which areas that are not one ring are compared
WINDOW = 512  # places of a line among which the next corner is looked for first
SAMPLES = 2000  # points at which the insides of two areas are compared
EARTH = 6.371e6  # [m]
MERIDIAN = 1e-6  # [deg] from 180, within which a corner lies on the cut there
MAX_CHORDS = 200  # of one edge: files draw no more, however long it is


# --- lines and rings ------------------------------------------------------------------------------


def line_fault(line: FloatArray, corners: FloatArray, tolerance: float = TOLERANCE) -> str:
    """Why the places ``line`` (N, 2) do not lead along ``corners`` (M, 2), in their order; empty if they do.

    Further places between two corners must lie on the straight line between these.
    """
    met, at = list[int](), 0
    for number, corner in enumerate(corners):
        found = _first_near(line, corner, at, tolerance)
        if found < 0:
            return f"corner {number} is missing"
        met.append(at := found)
    if np.hypot(*(line[[0, -1]] - corners[[0, -1]]).T).max() > tolerance:
        return "other ends"
    owner = np.clip(np.searchsorted(met, np.arange(len(line)), side="right") - 1, 0, max(len(corners) - 2, 0))
    ends = np.minimum(owner + 1, len(corners) - 1)
    off = segment_distance(line, corners[owner], corners[ends])
    return f"{off.max():.3g} m off" if off.max() > tolerance else ""


def _first_near(line: FloatArray, corner: FloatArray, at: int, tolerance: float) -> int:
    """The first place of ``line`` from ``at`` on that is at ``corner``; -1 without one."""
    for rows in (slice(at, at + WINDOW), slice(at, None)):
        near = np.flatnonzero(np.hypot(*(line[rows] - corner).T) <= tolerance)
        if len(near):
            return at + int(near[0])
    return -1


def segment_distance(points: FloatArray, begin: FloatArray, end: FloatArray) -> FloatArray:
    """Distance (N,) [m] of each of ``points`` (N, 2) from its own segment ``begin`` to ``end``, (N, 2)."""
    along, offset = end - begin, points - begin
    share = (offset * along).sum(axis=1) / np.maximum((along**2).sum(axis=1), 1e-12)
    gap = offset - np.clip(share, 0.0, 1.0)[:, None] * along
    return np.asarray(np.hypot(gap[:, 0], gap[:, 1]), float)


def ring_fault(ring: FloatArray, corners: FloatArray, tolerance: float = TOLERANCE) -> str:
    """Why a closed ``ring`` (N, 2), first place not repeated, is not the polygon; empty if it is."""
    if signed_area(ring) * signed_area(corners) < 0.0:
        corners = corners[::-1]
    begin = int(np.hypot(*(ring - corners[0]).T).argmin())
    turned = np.roll(ring, -begin, axis=0)
    return line_fault(np.concatenate([turned, turned[:1]]), np.concatenate([corners, corners[:1]]), tolerance)


# --- areas ----------------------------------------------------------------------------------------


def area_fault(
    rings: Sequence[FloatArray],
    pieces: Sequence[FloatArray],
    tolerance: float = TOLERANCE,
    cuts: Sequence[BoolArray] | None = None,
) -> str:
    """Why the area inside ``rings``, holes among them, is not the union of the polygons ``pieces``.

    Empty if it is. Every ring runs along outlines of the pieces and never inside one; every corner of a
    piece is covered; sampled points lie in both areas or in neither. ``cuts`` says which corners of each
    ring lie on the 180th meridian, along which areas are cut.
    """
    if not rings or not pieces:
        return "" if len(rings) == len(pieces) else "nothing is drawn" if pieces else "an area too many"
    if min(map(len, rings)) < 3:
        return "a ring of less than 3 corners"
    cut = [np.zeros(len(ring), bool) for ring in rings] if cuts is None else list(cuts)
    whole = len(rings) == len(pieces) == 1 and not cut[0].any()
    fault = ring_fault(rings[0], pieces[0], tolerance) if whole else "several rings"
    corners = sum(map(len, pieces))
    if not fault or (whole and corners * len(rings[0]) > MOST):
        return fault
    ends = [np.roll(ring, -1, axis=0) for ring in rings]
    free = [~mask for mask in cut]
    free_edges = [~(mask & np.roll(mask, -1)) for mask in cut]
    middles = [0.5 * (ring + end)[keep] for ring, end, keep in zip(rings, ends, free_edges, strict=True)]
    edge = np.concatenate([*(ring[keep] for ring, keep in zip(rings, free, strict=True)), *middles])
    near, deep = np.full(len(edge), np.inf), np.zeros(len(edge), bool)
    for piece in pieces:
        rows = _around(piece, edge, tolerance)
        gap = _distance(piece, edge[rows])
        near[rows] = np.minimum(near[rows], gap)
        deep[rows] |= within(piece, edge[rows]) & (gap > tolerance)
    if (near > tolerance).any():
        return fault if whole else "an edge outside the outlines"
    if deep.any():
        return "an edge inside the area"
    return _cover_fault(rings, pieces, tolerance)


def _around(piece: FloatArray, points: FloatArray, margin: float) -> IntArray:
    """The numbers of the points in the rectangle around a polygon, ``margin`` [m] wider."""
    low, high = piece.min(axis=0) - margin, piece.max(axis=0) + margin
    return np.flatnonzero(((points >= low) & (points <= high)).all(axis=1))


def _cover_fault(rings: Sequence[FloatArray], pieces: Sequence[FloatArray], tolerance: float) -> str:
    """Why corners of the pieces, or samples around them, are in one of the areas only; empty without any."""
    corners = np.concatenate(list(pieces))
    low, high = corners.min(axis=0) - tolerance, corners.max(axis=0) + tolerance
    samples = low + (high - low) * np.random.default_rng(5).random((SAMPLES, 2))
    covered = np.zeros(SAMPLES, bool)
    for piece in pieces:
        rows = _around(piece, samples, 0.0)
        covered[rows] |= within(piece, samples[rows])
    for places, wanted in ((corners, np.ones(len(corners), bool)), (samples, covered)):
        inside = np.logical_xor.reduce([within(ring, places) for ring in rings])
        other = places[inside != wanted]
        if len(other) and (np.min([_distance(ring, other) for ring in rings], axis=0) > tolerance).any():
            return "another area"
    return ""


def _distance(outline: FloatArray, points: FloatArray) -> FloatArray:
    """Distance of ``points`` (P, 2) from an outline [m], in pieces that fit into memory."""
    rows = max(CHUNK // max(len(outline), 1), 1)
    parts = [outline_distance(outline, points[k : k + rows]) for k in range(0, len(points), rows)]
    return np.concatenate(parts) if parts else np.zeros(0)


# --- in degrees -----------------------------------------------------------------------------------


def rings_of(geometry: Mapping[str, Any]) -> list[FloatArray]:
    """The closed rings (N, 2) [deg] of a polygon or of several, as GeoJSON has them."""
    coordinates = geometry["coordinates"]
    polygons = {"Polygon": [coordinates], "MultiPolygon": coordinates}[geometry["type"]]
    return [np.array(ring, float)[:, :2] for polygon in polygons for ring in polygon]


def drawn_fault(
    crs: str, closed: Sequence[FloatArray], pieces: Sequence[FloatArray], sag: float,
    tolerance: float = TOLERANCE,
) -> str:  # fmt: skip
    """As :func:`area_fault`, for closed rings (N, 2) [deg]; a chord must not leave its edge by far.

    A reader draws straight lines in degrees: these may be 4 ``sag`` [m] from the straight line of the plane.
    """
    if any(len(ring) < 4 or (ring[0] != ring[-1]).any() for ring in closed):
        return "a ring is not closed"
    rings = [in_plane(crs, ring) for ring in closed]
    cuts = [180.0 - np.abs(ring[:-1, 0]) < MERIDIAN for ring in closed]
    fault = area_fault([ring[:-1] for ring in rings], pieces, tolerance, cuts)
    if fault:
        return fault
    longest = max(float(np.hypot(*(p - np.roll(p, 1, axis=0)).T).max()) for p in pieces)
    bends = [bend(crs, ring, places, longest, sag) for ring, places in zip(closed, rings, strict=True)]
    return f"{max(bends):.3g} times its largest bend" if max(bends) > 1.0 else ""


def bend(crs: str, lonlat: FloatArray, places: FloatArray, longest: float, sag: float) -> float:
    """Largest distance of chords in degrees from those in the plane, as a share of what is allowed."""
    if len(lonlat) < 2:
        return 0.0
    turned = np.column_stack([np.rad2deg(np.unwrap(np.deg2rad(lonlat[:, 0]))), lonlat[:, 1]])
    middle = in_plane(crs, 0.5 * (turned[1:] + turned[:-1]))
    off = segment_distance(middle, places[:-1], places[1:])
    steep = max(float(np.abs(np.tan(np.deg2rad(np.clip(lonlat[:, 1], -89.0, 89.0)))).max()), 0.1)
    allowed = max(sag, (longest / MAX_CHORDS) ** 2 * steep / (8.0 * EARTH))
    return float(off.max() / (4.0 * allowed))
