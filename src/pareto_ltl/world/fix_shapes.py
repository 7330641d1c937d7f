"""The error of a position fix at a landmark: standard deviations along a direction and across it.

A beacon with range and bearing shows both, a coast or a depth contour only the distance across its line.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import DataError
from pareto_ltl.support.messages import shown_text

if TYPE_CHECKING:
    import shapely

KEYS = ("sd", "along", "across", "bearing")
MOST_SD = 1e6  # [m] largest standard deviation, as of robot.fix_sd
SLENDER = 1.2  # ratio of the sides of a landmark from which it has a direction
EXPECTED = "expected {sd: M}, or {along: M, across: M} with bearing: DEG if the landmark is not long"


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

    def in_area(self, where: str, what: str, area: shapely.Geometry) -> FixShape:
        """The same with a bearing; DataError if it needs one, and ``area`` has no longer side."""
        if self.along == self.across or not math.isnan(self.bearing):
            return self
        import shapely

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
            raise DataError(f"{begin} is {shown_text(repr(value))}; {EXPECTED}") from None
    if not isinstance(value, Mapping) or not value or not set(value) <= set(KEYS):
        raise DataError(f"{begin} is {shown_text(str(value))}; {EXPECTED}")
    numbers = {key: _number(begin, key, given) for key, given in value.items()}
    sd, bearing = numbers.get("sd", math.nan), numbers.get("bearing", math.nan)
    along, across = numbers.get("along", sd), numbers.get("across", sd)
    if math.isnan(along) or math.isnan(across) or len({"sd", "along", "across"} & set(numbers)) == 3:
        given = shown_text(str(dict(value)))
        raise DataError(f"{begin} is {given}: give along and across, or sd for one of them")
    return FixShape(along, across, bearing)


def _number(begin: str, key: str, value: Any) -> float:
    fits = isinstance(value, int | float) and not isinstance(value, bool)
    if key == "bearing" and fits and abs(value) <= 360.0:
        return float(value)
    if key != "bearing" and fits and 0.0 < value <= MOST_SD:
        return float(value)
    wanted = "degrees from -360 to 360" if key == "bearing" else f"metres, above 0 and at most {MOST_SD:g}"
    raise DataError(f"{begin}: {key} is {shown_text(repr(value))}; expected a number of {wanted}")


def fix_document(fix: FixShape | None) -> dict[str, float] | None:
    """``fix`` as in ``scene.json``; :func:`read_fix` reads it again."""
    if fix is None:
        return None
    if fix.along == fix.across:
        return {"sd": fix.along}
    return {"along": fix.along, "across": fix.across, "bearing": fix.bearing}
