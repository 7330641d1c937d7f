"""A map before the checks of the whole: each number and outline is read and checked on its own.

Harmless variations are accepted: a repeated closing corner is removed here, and ``scene_checks`` reverses
clockwise outlines and clips obstacles at the bounds. All other errors raise a DataError with one line in the
coordinates of the author.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import DataError
from pareto_ltl.support.messages import shown_text
from pareto_ltl.world.windows import TimedPlace

MOST_COORDINATE = 1e15  # in any unit
RELATIVE_TOLERANCE = 1e-9  # of the size of the map; smaller lengths are rounding errors


@dataclass(frozen=True, slots=True)
class SceneSketch:
    """A map before its checks, in metres.

    Attributes
    ----------
    where : str
        Start of every message, e.g. ``scene file map.geojson``.
    regions, obstacles, landmarks : tuple of (name, (n, 2) float)
        Outlines [m] with the name used in messages.
    show : callable
        Text of a point (2,) [m] in the coordinates of the author.
    border : str or None
        ``wall`` or ``open``; None where the map does not say.
    timed : tuple of TimedPlace
        Regions that count, and obstacles that stand, only for a time; the latter are regions here.
    """

    where: str
    bounds: FloatArray
    start: FloatArray
    regions: tuple[tuple[str, FloatArray], ...]
    obstacles: tuple[tuple[str, FloatArray], ...]
    show: Callable[[FloatArray], str]
    crs: str | None = None
    time_zero: str | None = None
    landmarks: tuple[tuple[str, FloatArray], ...] = ()
    border: str | None = None
    timed: tuple[TimedPlace, ...] = ()

    @property
    def tolerance(self) -> float:
        """Length below which differences are rounding errors [m]."""
        return RELATIVE_TOLERANCE * float((self.bounds[1] - self.bounds[0]).max())


def read_bounds(where: str, key: str, value: Any) -> FloatArray:
    """South-west and north-east corner (2, 2) in the unit of the author; ``key`` names them in messages."""
    expected = "expected [[west, south], [east, north]]"
    if value is None or _is_empty(value):
        raise DataError(f"{where} has no bounds; give {key} as [[west, south], [east, north]]")
    bounds = _number_array(value)
    if bounds is None or bounds.shape != (2, 2):
        raise DataError(f"{where}: {key} is {_typed_text(value)}; {expected}")
    if not _are_finite(bounds):
        raise DataError(f"{where}: {key} {_typed_text(value)} has a number that is not finite; {expected}")
    (west, south), (east, north) = bounds.tolist()
    if west >= east or south >= north:
        raise DataError(
            f"{where}: {key} {_typed_text(value)} is turned round or empty; "
            f"{expected}, west < east, south < north"
        )
    return bounds


def read_start(where: str, key: str, value: Any) -> FloatArray:
    """The start (2,) in the unit of the author; ``key`` names it in messages."""
    if value is None or _is_empty(value):
        raise DataError(f"{where} has no start; give {key} as [x, y]")
    start = _number_array(value)
    if start is None or start.shape != (2,) or not _are_finite(start):
        raise DataError(f"{where}: {key} is {_typed_text(value)}; expected [x, y], two finite numbers")
    return start


def numbered_outlines(polygons: Sequence[Any]) -> list[tuple[str, Any]]:
    """Outlines without names, numbered from 1."""
    return [(str(number), polygon) for number, polygon in enumerate(polygons, 1)]


def read_outlines(
    where: str, kind: str, items: Any, metres: Callable[[FloatArray], FloatArray]
) -> Iterator[tuple[str, FloatArray]]:
    """Names and corners of ``items``, pairs of name and corners, converted by ``metres``."""
    for name, polygon in items:
        what = f"region {shown_text(str(name))!r}" if kind == "region" else f"{kind} {name}"
        yield str(name) if kind == "region" else what, metres(read_corners(where, what, polygon))


def read_corners(where: str, what: str, polygon: Any) -> FloatArray:
    """Corners (n, 2) of ``polygon`` without repetitions, in the unit of the author."""
    if not isinstance(polygon, list | tuple | np.ndarray):
        raise DataError(
            f"{where}: {what} is {_typed_text(polygon)}; expected a list of corners [[x, y], ...]"
        )
    for number, corner in enumerate(polygon, 1):
        point = _number_array(corner)
        if point is None or point.shape != (2,):
            raise DataError(f"{where}: {what}: corner {number} is {_typed_text(corner)}; expected [x, y]")
        if not _are_finite(point):
            raise DataError(
                f"{where}: {what}: corner {number} is {_typed_text(corner)}; expected finite numbers"
            )
    corners = np.array(polygon, float).reshape(-1, 2)
    corners = corners[np.any(corners != np.roll(corners, 1, axis=0), axis=1)]
    if len(corners) < 3:
        raise DataError(f"{where}: {what} has {len(corners)} distinct corners; a polygon needs at least 3")
    return corners


def read_timed(where: str, windows: Any, regions: Collection[str]) -> Iterator[TimedPlace]:
    """The windows of settings, each a mapping with the keys ``region``, ``from``, ``until``, ``forbidden``."""
    for name, keys in windows.items():
        what = f"{where}: window {shown_text(str(name))!r}"
        known = {"region", "from", "until", "forbidden"}
        if not isinstance(keys, Mapping) or not set(keys) <= known or not {"from", "until"} & set(keys):
            raise DataError(
                f"{what} is {shown_text(str(keys))}; expected {{from: TIME, until: TIME}} or one of the two, "
                "and region and forbidden if need be"
            )
        region = str(keys.get("region", name))
        if region not in regions:
            have = ", ".join(sorted(regions)) or "none"
            raise DataError(f"{what} is of region {shown_text(region)!r}; the map has {have}")
        yield TimedPlace(str(name), region, keys.get("from"), keys.get("until"), bool(keys.get("forbidden")))


def _are_finite(numbers: FloatArray) -> bool:
    """Whether no number is NaN, infinite, or so large that its square is."""
    return bool((np.abs(numbers) < MOST_COORDINATE).all())


def _number_array(value: Any) -> FloatArray | None:
    """``value`` as an array; None for anything but numbers: texts, truth values, rows of several lengths."""
    try:
        array = np.array(value)
    except (TypeError, ValueError, OverflowError):
        return None
    return array.astype(float) if array.dtype.kind in "iuf" else None


def _is_empty(value: Any) -> bool:
    return hasattr(value, "__len__") and len(value) == 0


def _typed_text(value: Any) -> str:
    return shown_text(str(value.tolist() if isinstance(value, np.ndarray) else value))


__all__ = [
    "SceneSketch",
    "numbered_outlines",
    "read_bounds",
    "read_corners",
    "read_outlines",
    "read_start",
    "read_timed",
]
