"""Which places of a map are active at the height of the flight."""

from __future__ import annotations

import logging
import math
from collections.abc import Iterable
from dataclasses import replace

from careful_io.texts import listed_text
from flight_quantities.heights import Height as FlightHeight
from flight_quantities.lengths import HIGHEST, LOWEST, Height
from pareto_ltl.support.errors import DataError
from pareto_ltl.world.scene import AbsentPlace
from pareto_ltl.world.scene_sketch import DrawingRules, Place, SceneSketch

LOG = logging.getLogger(__name__)
ABOVE_GROUND, SEA_DATUMS = "AGL", ("AMSL", "FL")


def sketch_at_height(sketch: SceneSketch, rules: DrawingRules) -> SceneSketch:
    """``sketch`` with only the places that are active at ``rules.height``; the others are ``absent``.

    A region that is not active remains without polygons, so that its proposition never holds. Without a
    height, all places are active.

    Raises
    ------
    DataError
        If the mission visits a region that the robot flies above or below.
    """
    banded = [place for place in _places(sketch) if place.banded]
    if not banded:
        return sketch
    if rules.height is None:
        LOG.warning(
            "%s: the height of the flight is not set (robot.level), so floors and ceilings are ignored: %s "
            "are active at every height", sketch.where, listed_text([place.what for place in banded]),
        )  # fmt: skip
        return sketch
    height = _flight_height(sketch, rules.height)
    sketch = _in_one_datum(sketch, height, rules.ground)
    absent = [place for place in _places(sketch) if not place.counts_at(height.metres)]
    if not absent:
        return sketch
    use = rules.use()
    for place in absent:
        if use and place.name in use.visited and place in sketch.regions:
            raise DataError(
                f"{sketch.where}: the mission visits {place.what}, which lies {_band(place)}, and the flight "
                f"is {height.text}: change robot.level, or the floor and ceiling of the region"
            )
    listed = listed_text([f"{place.what} ({_band(place)})" for place in absent])
    LOG.info("%s: a flight %s does not meet %s", sketch.where, height.text, listed)

    def present(some: Iterable[Place]) -> tuple[Place, ...]:
        return tuple(place for place in some if place.counts_at(height.metres))

    return replace(
        sketch,
        regions=tuple(
            place if place.counts_at(height.metres) else replace(place, polygons=(), lines=(), buffer=0.0)
            for place in sketch.regions
        ),
        obstacles=present(sketch.obstacles),
        landmarks=present(sketch.landmarks),
        absent=tuple(AbsentPlace(place.what, place.floor.metres, place.ceiling.metres) for place in absent),
    )


def _places(sketch: SceneSketch) -> tuple[Place, ...]:
    return (*sketch.regions, *sketch.obstacles, *sketch.landmarks)


def _datums(sketch: SceneSketch) -> set[str]:
    """The datums that limits of the map state."""
    return {limit.datum for place in _places(sketch) for limit in (place.floor, place.ceiling)} - {""}


def _flight_height(sketch: SceneSketch, height: FlightHeight | float) -> FlightHeight:
    """The height of the flight; a number is in the datum of the map.

    If all limits of the map are above ground, this is above ground, otherwise above mean sea level.
    """
    if isinstance(height, FlightHeight):
        return height
    above_sea = _datums(sketch) != {ABOVE_GROUND} and height >= 0.0
    return FlightHeight(height, above_sea, "")


def _in_one_datum(sketch: SceneSketch, height: FlightHeight, ground: float | None) -> SceneSketch:
    """``sketch`` with all limits counted as the height of the flight is; a limit without a datum is already.

    ``ground`` [m] is the height of the ground above mean sea level. Where it is not known, an obstacle
    with a limit in the other datum is active on that side.
    """
    datums = _datums(sketch)
    if "FL" in datums:
        LOG.info(
            "%s: a flight level is the height in the standard atmosphere, up to 300 m off by air pressure",
            sketch.where,
        )
    other = {ABOVE_GROUND} if height.above_sea else set(SEA_DATUMS)
    if not datums & other:
        return sketch
    if ground is None:
        unknown = [
            place.what for place in _places(sketch) if {place.floor.datum, place.ceiling.datum} & other
        ]
        LOG.warning(
            "%s: the flight is %s, and these have limits that count from elsewhere: %s; the height of the "
            "ground between them is not known, so obstacles are active on that side: set scene.ground",
            sketch.where, height.text, listed_text(unknown),
        )  # fmt: skip

    def moved(limit: Height, without: Height) -> Height:
        if limit.datum not in other or math.isinf(limit.metres):
            return limit
        if ground is None:
            return without
        return Height(limit.metres + (ground if height.above_sea else -ground))

    def counted(place: Place, floor: Height, ceiling: Height) -> Place:
        return replace(place, floor=moved(place.floor, floor), ceiling=moved(place.ceiling, ceiling))

    return replace(
        sketch,
        obstacles=tuple(counted(place, LOWEST, HIGHEST) for place in sketch.obstacles),
        regions=tuple(counted(place, place.floor, place.ceiling) for place in sketch.regions),
        landmarks=tuple(counted(place, place.floor, place.ceiling) for place in sketch.landmarks),
    )


def _band(place: Place) -> str:
    if place.floor.metres == -math.inf:
        return f"up to {_text(place.ceiling)}"
    if place.ceiling.metres == math.inf:
        return f"above {_text(place.floor)}"
    return f"from {place.floor.metres:g} to {_text(place.ceiling)}"


def _text(limit: Height) -> str:
    return f"{limit.metres:g} m {limit.datum}".strip()
