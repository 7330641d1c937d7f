"""The record of a map, and the errors of position fixes at its landmarks: along a direction and across it.

A beacon with range and bearing shows both, a coast or a depth contour only the distance across its line.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
import shapely

from careful_io.messages import shown_text
from careful_io.texts import distance_text, listed_text
from flight_quantities.lengths import length_in_metres
from pareto_ltl.settings.fidelity import BORDERS
from pareto_ltl.support.arrays import FloatArray, require_shape
from pareto_ltl.support.display import Displayed
from pareto_ltl.support.errors import DataError
from pareto_ltl.world.projection import Frame
from pareto_ltl.world.windows import Window

FIX_KEYS = ("sd", "along", "across", "bearing")
MAX_SD = 1e6  # [m] largest standard deviation, as of robot.fix_sd
SLENDER = 1.2  # ratio of the sides of a landmark from which it has a direction
EXPECTED_FIX = "expected {sd: M}, or {along: M, across: M} with bearing: DEG if the landmark is not long"
TITLE = re.compile(r"(obstacle )?\d+|obstacle \d+ \((?P<name>.*)\)", re.DOTALL)  # of an obstacle


class AbsentPlace(NamedTuple):
    """A place of a map that a flight at another height does not meet; ``floor``, ``ceiling`` [m]."""

    what: str
    floor: float
    ceiling: float

    def as_dict(self) -> dict[str, Any]:
        """For ``scene.json``: a missing limit is null."""
        limits = {"floor": self.floor, "ceiling": self.ceiling}
        finite = {key: value if math.isfinite(value) else None for key, value in limits.items()}
        return {"what": self.what, **finite}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> AbsentPlace:
        """The inverse of :meth:`as_dict`."""
        floor, ceiling = data.get("floor"), data.get("ceiling")
        return cls(
            str(data["what"]), -math.inf if floor is None else floor, math.inf if ceiling is None else ceiling
        )


@dataclass(frozen=True, slots=True, repr=False)
class Scene(Displayed):
    """A map: start of the robot, regions to visit, obstacles not to touch.

    Attributes
    ----------
    bounds : (2, 2) float
        South-west and north-east corner [m].
    start : (2,) float
        Position at departure [m].
    regions : mapping of name to tuple of (n, 2) float
        Regions of interest: each is the union of simple polygons without a common area, counter-clockwise
        [m]. The proposition of a region without polygons never holds. The constructor also accepts one
        polygon (n, 2) for a region.
    obstacles : tuple of (n, 2) float
        Simple polygons, counter-clockwise [m].
    landmarks : tuple of (n, 2) float
        Convex polygons in which the robot gets a position fix [m].
    border : str
        ``wall`` if leaving the map is a failure, else ``open``.
    crs : str or None
        PROJ string of the plane; None for a plane without position on Earth.
    time_zero : str or None
        Departure, ISO 8601 UTC; all other times are seconds since then.
    windows : mapping of proposition to Window
        When propositions hold. A window with the name of its region limits when the region is active.
    forbidden : tuple of str
        Propositions with a window that must never hold: obstacles that are active for a limited time.
    simplified : float
        Largest distance by which outlines were moved to simplify them [m]: obstacles and forbidden regions
        outwards, visited regions inwards.
    obstacle_names : tuple of str
        The name that the map gives to each obstacle, empty for those without one; () if none has a name.
    landmark_fixes : tuple of FixShape or None
        The error of fixes at each landmark, None for ``robot.fix_sd``; () if it is None for all.
    absent : tuple of AbsentPlace
        Places of the map that are above or below the flight, and so are not on this map.
    room : float
        Without a drawn border: what the uncertainty of the position adds to the margin about the drawing, by
        which time steps do not become longer [m].
    """

    bounds: FloatArray
    start: FloatArray
    regions: Mapping[str, tuple[FloatArray, ...]]
    obstacles: tuple[FloatArray, ...] = ()
    crs: str | None = None
    time_zero: str | None = None
    landmarks: tuple[FloatArray, ...] = ()
    border: str = "open"
    windows: Mapping[str, Window] = field(default_factory=dict)
    forbidden: tuple[str, ...] = ()
    simplified: float = 0.0
    obstacle_names: tuple[str, ...] = ()
    landmark_fixes: tuple[FixShape | None, ...] = ()
    absent: tuple[AbsentPlace, ...] = ()
    room: float = 0.0

    def __post_init__(self) -> None:
        require_shape("bounds", self.bounds, 2, 2)
        if not (self.bounds[0] < self.bounds[1]).all():
            raise ValueError(
                f"bounds must be a south-west and a north-east corner, got {self.bounds.tolist()}"
            )
        require_shape("start", self.start, 2)
        if self.border not in BORDERS:
            raise ValueError(f"border must be one of {', '.join(BORDERS)}, got {self.border!r}")
        parts = {
            name: (found,) if isinstance(found, np.ndarray) else tuple(found)
            for name, found in self.regions.items()
        }
        object.__setattr__(self, "regions", parts)
        for polygon in (*self.region_outlines, *self.obstacles, *self.landmarks):
            require_shape("polygon", polygon, None, 2)
        if self.obstacle_names and len(self.obstacle_names) != len(self.obstacles):
            raise ValueError(f"{len(self.obstacle_names)} obstacle_names for {len(self.obstacles)} obstacles")
        if self.landmark_fixes and len(self.landmark_fixes) != len(self.landmarks):
            raise ValueError(f"{len(self.landmark_fixes)} landmark_fixes for {len(self.landmarks)} landmarks")
        for name, window in self.windows.items():
            if window.region not in self.regions:
                raise ValueError(f"window {name!r} is of {window.region!r}, which is not a region of the map")
        if missing := set(self.forbidden) - set(self.windows):
            raise ValueError(f"forbidden: {sorted(missing)} have no window")

    @property
    def frame(self) -> Frame:
        """Plane and clock: positions to longitude and latitude, seconds to UTC."""
        return Frame(self.crs, self.time_zero)

    @property
    def __geo_interface__(self) -> dict[str, Any]:
        """The map as GeoJSON, with the roles of its places; in metres if it has no place on Earth."""
        from pareto_ltl.world.geo_interface import scene_features

        return scene_features(self)

    def document(self) -> dict[str, Any]:
        """The map as dicts and lists, the content of ``scene.json``."""
        from pareto_ltl.world.scene_files import scene_to_dict

        return scene_to_dict(self)

    def later(self, moment: float, start: FloatArray) -> Scene:
        """The map of a flight that departs ``moment`` [s] later, from ``start`` (2,) [m]."""
        departure = self.frame.utc([moment])
        return replace(
            self, start=np.array(start, float), time_zero=None if departure is None else departure[0],
            windows={name: window.later(moment) for name, window in self.windows.items()},
        )  # fmt: skip

    @property
    def walled(self) -> bool:
        """Whether leaving the map is a failure."""
        return self.border == "wall"

    @property
    def region_outlines(self) -> tuple[FloatArray, ...]:
        """The polygons of all regions."""
        return tuple(outline for outlines in self.regions.values() for outline in outlines)

    def obstacle_title(self, number: int) -> str:
        """``obstacle 3``, or ``obstacle 3 (EFKU CTR)`` if it has a name; the first has the number 1."""
        name = self.obstacle_names[number - 1] if self.obstacle_names else ""
        return f"obstacle {number} ({name})" if name else f"obstacle {number}"

    @staticmethod
    def name_in_title(text: str) -> str:
        """The name in a title of :meth:`obstacle_title`; of a number alone, none; any other text itself."""
        title = TITLE.fullmatch(text)
        return text if title is None else title["name"] or ""

    def barrier_title(self, barrier: str) -> str:
        """``barrier`` for people: for ``obstacle 3`` its title, for others, as borders, the same text."""
        kind, _, number = barrier.rpartition(" ")
        known = kind == "obstacle" and number.isdecimal() and 0 < int(number) <= len(self.obstacles)
        return self.obstacle_title(int(number)) if known else barrier

    def facts(self) -> Mapping[str, str]:
        """Size, regions, obstacles, border, departure and time windows."""
        east, north = (float(side) for side in self.bounds[1] - self.bounds[0])
        return {
            "size": f"{distance_text(east)} x {distance_text(north)}",
            "regions": listed_text(self.regions),
            "obstacles": f"{len(self.obstacles)}",
            "border": self.border,
            "departure": self.time_zero or "not set",
        } | {f"{name} holds": str(window) for name, window in self.windows.items()}


# --- position fixes ---------------------------------------------------------------------------------


class FixShape(NamedTuple):
    """Standard deviations of a fix [m] along a direction and across it.

    ``bearing`` is that direction, clockwise from the y axis of the plane [deg]; NaN: along the longer side
    of the landmark.
    """

    along: float
    across: float
    bearing: float = math.nan

    @property
    def cov(self) -> FloatArray:
        """Covariance (xx, xy, yy) [m²]."""
        if self.along == self.across:
            return np.array([self.along**2, 0.0, self.along**2])
        angle = math.radians(self.bearing)
        x, y, one, two = math.sin(angle), math.cos(angle), self.along**2, self.across**2
        return np.array([one * x * x + two * y * y, (one - two) * x * y, one * y * y + two * x * x])

    @property
    def document(self) -> dict[str, float]:
        """The fix as in ``scene.json``; :func:`read_fix` reads it again."""
        if self.along == self.across:
            return {"sd": self.along}
        return {"along": self.along, "across": self.across, "bearing": self.bearing}

    def in_area(self, where: str, what: str, area: shapely.Geometry) -> FixShape:
        """The same with a bearing; DataError if it needs one, and ``area`` has no longer side."""
        if self.along == self.across or not math.isnan(self.bearing):
            return self
        corners = shapely.get_coordinates(shapely.minimum_rotated_rectangle(area))
        sides = np.diff(corners[:3], axis=0)
        long, short = sorted(np.linalg.norm(sides, axis=1).tolist(), reverse=True)
        if long < SLENDER * short:
            raise DataError(
                f"{where}: {what} is about as long as wide, so that along and across have no direction; add "
                "bearing, the direction of along in degrees clockwise from north, to its fix"
            )
        x, y = sides[int(np.argmax(np.linalg.norm(sides, axis=1)))]
        return self._replace(bearing=math.degrees(math.atan2(x, y)) % 180.0)


def read_fix(where: str, what: str, value: Any) -> FixShape | None:
    """The property ``fix`` of the landmark ``what``, a mapping or its JSON text; None if it is missing.

    Raises
    ------
    DataError
        If it has other keys, lacks one, or a number is no standard deviation.
    """
    if value is None or value == "":
        return None
    begin = f"{where}: {what}: fix"
    if isinstance(value, str):
        try:
            value = json.loads(value)
        except ValueError:
            raise DataError(f"{begin} is {shown_text(repr(value))}; {EXPECTED_FIX}") from None
    if not isinstance(value, Mapping) or not value or not set(value) <= set(FIX_KEYS):
        raise DataError(f"{begin} is {shown_text(str(value))}; {EXPECTED_FIX}")
    numbers = {key: _number(begin, key, given) for key, given in value.items()}
    sd, bearing = numbers.get("sd", math.nan), numbers.get("bearing", math.nan)
    along, across = numbers.get("along", sd), numbers.get("across", sd)
    if math.isnan(along) or math.isnan(across) or len({"sd", "along", "across"} & set(numbers)) == 3:
        given = shown_text(str(dict(value)))
        raise DataError(f"{begin} is {given}: give along and across, or sd for one of them")
    return FixShape(along, across, bearing)


def _number(begin: str, key: str, value: Any) -> float:
    if key != "bearing" and isinstance(value, str):
        value = length_in_metres(f"{begin}: {key}", value)
    fits = isinstance(value, int | float) and not isinstance(value, bool)
    if key == "bearing" and fits and abs(value) <= 360.0:
        return float(value)
    if key != "bearing" and fits and 0.0 < value <= MAX_SD:
        return float(value)
    wanted = "degrees from -360 to 360" if key == "bearing" else f"metres, above 0 and at most {MAX_SD:g}"
    raise DataError(f"{begin}: {key} is {shown_text(repr(value))}; expected a number of {wanted}")
