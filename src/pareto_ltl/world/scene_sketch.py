"""A map as it is drawn, before the checks of the complete map: numbers and outlines are checked one by one.

Some variations are accepted: a repeated closing corner is removed here, and ``scene_checks`` reverses
clockwise outlines and clips obstacles to the bounds. All other faults are described in the coordinates of the
map's author; one DataError names all of them.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from careful_io.faults import Faults
from careful_io.messages import shown_text
from flight_quantities.heights import Height as FlightHeight
from flight_quantities.lengths import HIGHEST, LOWEST, Height
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import DataError
from pareto_ltl.world.map_formats import Unread
from pareto_ltl.world.scene import AbsentPlace, FixShape, read_fix
from pareto_ltl.world.windows import TimedPlace

MAX_COORDINATE = 1e15  # largest coordinate, in any unit
LEAST_ROOM = 0.07  # of the longer side of a drawing without a border
RELATIVE_TOLERANCE = 1e-9  # of the size of the map; smaller lengths count as rounding errors


@dataclass(frozen=True, slots=True)
class Place:
    """A region, an obstacle, a landmark or the border, as it is drawn.

    Attributes
    ----------
    name : str
        The name of a region; for other places the same as ``what``.
    what : str
        The name in messages: ``region 'a'``, ``obstacle 3``.
    polygons : tuple of tuple of (n, 2) float
        Outline and holes of each part.
    lines : tuple of (n, 2) float
        Points (n = 1) and lines, which get an area by the buffer.
    buffer : float
        Safety distance of polygons, radius of points and lines [m on the ground].
    floor, ceiling : Height
        Heights between which the place is active; infinite: no limit.
    solid : bool
        Whether a region is an obstacle that is active for a limited time.
    fix : FixShape or None
        The error of fixes at a landmark; None: ``robot.fix_sd``.
    """

    name: str
    what: str
    polygons: tuple[tuple[FloatArray, ...], ...] = ()
    lines: tuple[FloatArray, ...] = ()
    buffer: float = 0.0
    floor: Height = LOWEST
    ceiling: Height = HIGHEST
    solid: bool = False
    fix: FixShape | None = None

    @property
    def corners(self) -> FloatArray:
        """All corners and points (n, 2)."""
        rings = [ring for polygon in self.polygons for ring in polygon]
        return np.concatenate([*rings, *self.lines])

    @property
    def banded(self) -> bool:
        """Whether the place is active only at some heights."""
        return self.floor.metres > -np.inf or self.ceiling.metres < np.inf

    def counts_at(self, metres: float) -> bool:
        """Whether the place is active at a height of ``metres``; the limits are included."""
        return self.floor.metres <= metres <= self.ceiling.metres

    def moved(self, change: Callable[[FloatArray], FloatArray]) -> Place:
        """The place with ``change`` applied to all coordinates (n, 2)."""
        return replace(
            self,
            polygons=tuple(tuple(change(ring) for ring in polygon) for polygon in self.polygons),
            lines=tuple(change(line) for line in self.lines),
        )


@dataclass(frozen=True, slots=True)
class SceneSketch:
    """A map before its checks, in metres.

    Attributes
    ----------
    where : str
        Start of every error message, e.g. ``scene file map.geojson``.
    bounds : (2, 2) float
        South-west and north-east corner [m].
    start : (2,) float
        Start position [m]; empty if the map has none.
    regions, obstacles, landmarks : tuple of Place
        Places in metres.
    show : callable
        Text of a point (2,) [m] in the coordinates of the author.
    border : str or None
        ``wall`` or ``open``; None if the map does not set it.
    timed : tuple of TimedPlace
        Time windows of regions and obstacles; obstacles with a window are in ``regions``.
    fence : Place or None
        A border that is not a rectangle: one polygon; ``bounds`` is the box around it.
    simplified : float
        For a ``scene.json``: largest distance by which outlines were moved to simplify them [m].
    absent : tuple of AbsentPlace
        Places that are above or below the flight.
    faults : tuple of str
        Messages about places that could not be read; they are left out of the sketch.
    unread : Unread
        What the map file has and the sketch has not.
    drawing : (2, 2) float or None
        Of a map without a border: the corners of the box around the drawing [m], inside of ``bounds``.
    room : float
        :attr:`Scene.room`.
    """

    where: str
    bounds: FloatArray
    start: FloatArray
    regions: tuple[Place, ...]
    obstacles: tuple[Place, ...]
    show: Callable[[FloatArray], str]
    crs: str | None = None
    time_zero: str | None = None
    landmarks: tuple[Place, ...] = ()
    border: str | None = None
    timed: tuple[TimedPlace, ...] = ()
    fence: Place | None = None
    simplified: float = 0.0
    absent: tuple[AbsentPlace, ...] = ()
    faults: tuple[str, ...] = ()
    unread: Unread = field(default_factory=Unread)
    drawing: FloatArray | None = None
    room: float = 0.0

    @property
    def tolerance(self) -> float:
        """Length below which differences count as rounding errors [m]."""
        return RELATIVE_TOLERANCE * float((self.bounds[1] - self.bounds[0]).max())

    @property
    def size(self) -> float:
        """The longer side of the map, without the room around a drawing that has no border [m]."""
        low, high = self.bounds if self.drawing is None else self.drawing
        return float((high - low).max())


class SkyRoom(NamedTuple):
    """The room [m] that flights need around a drawing without a border, and how it was found, as text."""

    margin: float
    reason: str


class MissionUse(NamedTuple):
    """Names of the regions that the mission visits, and of the regions that it avoids; both can be true."""

    visited: frozenset[str]
    forbidden: frozenset[str]


def unknown_use() -> MissionUse | None:
    """The use of regions if the formula is not known: None."""
    return None


@dataclass(frozen=True, slots=True)
class DrawingRules:
    """How a sketch becomes a scene.

    Attributes
    ----------
    use : callable
        Returns how the mission uses the regions, or None if it is not known; called only if it is needed.
    simplify : float or str
        How far the outlines of polygons with many corners may move [m]; 0: not at all; or ``auto``.
    height : Height or float or None
        Of the flight: places with another band of heights are not active. A number is in the datum of the
        map. None: all are active.
    ground : float or None
        Height of the ground above mean sea level [m].
    walled : bool
        Whether leaving the map is a failure.
    """

    use: Callable[[], MissionUse | None] = unknown_use
    simplify: float | str = 0.0
    height: FlightHeight | float | None = None
    ground: float | None = None
    walled: bool = False


def least_room(drawing: FloatArray) -> float:
    """The least margin [m] about a ``drawing`` (2, 2) [m], so that flights can pass outside of its places."""
    return LEAST_ROOM * float(np.ptp(drawing, axis=0).max())


def open_bounds(drawing: FloatArray, margin: float = 0.0) -> FloatArray:
    """The box (2, 2) [m] in which plans lie on a map without a border: ``drawing`` (2, 2) [m] with a margin.

    The sky is open: leaving the box is no failure. The margin is at least :func:`least_room`.
    """
    margin = max(margin, least_room(drawing))
    return np.stack([drawing[0] - margin, drawing[1] + margin])


def read_bounds(where: str, key: str, value: Any) -> FloatArray:
    """South-west and north-east corner (2, 2) in the unit of the map; ``key`` is their name in messages.

    DataError if they are missing, not finite or not in order.
    """
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
            f"{where}: {key} {_typed_text(value)} is reversed or empty; "
            f"{expected}, west < east, south < north"
        )
    return bounds


def read_start(where: str, key: str, value: Any) -> FloatArray:
    """The start (2,) in the unit of the map; ``key`` is its name in messages; DataError if not valid."""
    if value is None or _is_empty(value):
        raise DataError(f"{where} has no start; give {key} as [x, y]")
    start = _number_array(value)
    if start is None or start.shape != (2,) or not _are_finite(start):
        raise DataError(f"{where}: {key} is {_typed_text(value)}; expected [x, y], two finite numbers")
    return start


def numbered_outlines(polygons: Sequence[Any]) -> list[tuple[str, Any]]:
    """Outlines with their numbers from 1 as names."""
    return [(str(number), polygon) for number, polygon in enumerate(polygons, 1)]


def called(kind: str, name: str) -> str:
    """The name of a place in messages: ``region 'a'``, ``obstacle 3``."""
    return f"region {shown_text(name)!r}" if kind == "region" else f"{kind} {shown_text(name)}"


def read_places(
    faults: Faults, kind: str, items: Any, metres: Callable[[FloatArray], FloatArray]
) -> tuple[Place, ...]:
    """The places of ``items``, pairs of a name and corners, converted by ``metres``; others are ``faults``.

    A region may have several parts: a list of outlines instead of corners. A landmark may have the error of
    its fixes: {corners: ..., fix: ...} instead of corners.
    """

    def read(item: tuple[Any, Any]) -> Place:
        key, drawn = item
        name, what, fix = str(key), called(kind, str(key)), None
        if kind == "landmark" and isinstance(drawn, Mapping):
            if not {"corners"} <= set(drawn) <= {"corners", "fix"}:
                keys = shown_text(", ".join(map(str, drawn)))
                raise DataError(
                    f"{faults.where}: {what} has the keys {keys}; expected corners, and fix if need be"
                )
            drawn, fix = drawn["corners"], read_fix(faults.where, what, drawn.get("fix"))
        parts = drawn if kind == "region" and _are_outlines(drawn) else [drawn]
        outlines = [metres(read_corners(faults.where, what, polygon)) for polygon in parts]
        shown = name if kind == "region" else what
        return Place(shown, what, tuple((outline,) for outline in outlines), fix=fix)

    return tuple(place for _, place in faults.each(items, read))


def _are_outlines(value: Any) -> bool:
    """Whether ``value`` is a list of outlines: its first item is a list of lists."""
    if not isinstance(value, list | tuple) or not value:
        return False
    first = value[0]
    return isinstance(first, list | tuple) and bool(first) and isinstance(first[0], list | tuple)


def read_corners(where: str, what: str, polygon: Any) -> FloatArray:
    """Corners (n, 2) of ``polygon`` without repetitions, in the unit of the map; DataError if not valid."""
    if not isinstance(polygon, list | tuple | np.ndarray):
        raise DataError(
            f"{where}: {what} is {_typed_text(polygon)}; expected a list of corners [[x, y], ...]"
        )
    whole = _number_array(polygon)
    known = whole is not None and whole.ndim == 2 and whole.shape[1] == 2 and _are_finite(whole)
    for number, corner in enumerate(() if known else polygon, 1):
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
    """The windows of the settings: mappings with the keys ``region``, ``from``, ``until``, ``forbidden``.

    DataError if a window is not valid or its region is not in ``regions``.
    """
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
    return bool((np.abs(numbers) < MAX_COORDINATE).all())


def _number_array(value: Any) -> FloatArray | None:
    """``value`` as an array of floats; None for texts, booleans and rows of unequal length."""
    try:
        array = np.array(value)
    except (TypeError, ValueError, OverflowError):
        return None
    return array.astype(float) if array.dtype.kind in "iuf" else None


def _is_empty(value: Any) -> bool:
    return hasattr(value, "__len__") and len(value) == 0


def _typed_text(value: Any) -> str:
    return shown_text(str(value.tolist() if isinstance(value, np.ndarray) else value))
