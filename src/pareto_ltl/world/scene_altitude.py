"""Which places of a map are active at the height of the flight."""

from __future__ import annotations

import logging
import math
from collections.abc import Iterable
from dataclasses import replace

from pareto_ltl.support.display import listed_text
from pareto_ltl.support.errors import DataError
from pareto_ltl.world.map_lengths import HIGHEST, Height
from pareto_ltl.world.scene_sketch import DrawingRules, Place, SceneSketch

LOG = logging.getLogger(__name__)


def sketch_at_altitude(sketch: SceneSketch, rules: DrawingRules) -> SceneSketch:
    """``sketch`` with only the places that are active at ``rules.altitude``.

    A region that is not active remains without polygons, so that its proposition never holds. Without an
    altitude, all places are active.

    Raises
    ------
    DataError
        If the mission visits a region that the robot flies above or below.
    """
    banded = [place for place in _places(sketch) if place.banded]
    if not banded:
        return sketch
    if rules.altitude is None:
        LOG.info(
            "%s: scene.altitude is not set, so altitude limits are ignored: %s are always active",
            sketch.where, listed_text([place.what for place in banded]),
        )  # fmt: skip
        return sketch
    sketch = _in_one_datum(sketch)
    altitude = rules.altitude
    absent = [place for place in _places(sketch) if not place.counts_at(altitude)]
    if not absent:
        return sketch
    use = rules.use()
    for place in absent:
        if use and place.name in use.visited and place in sketch.regions:
            raise DataError(
                f"{sketch.where}: the mission visits {place.what}, which lies {_band(place)}, and the robot "
                f"flies at {altitude:g} m: change scene.altitude, or the floor and ceiling of the region"
            )
    LOG.info("at %g m these are not active: %s", altitude, listed_text([place.what for place in absent]))

    def present(some: Iterable[Place]) -> tuple[Place, ...]:
        return tuple(place for place in some if place.counts_at(altitude))

    return replace(
        sketch,
        regions=tuple(
            place if place.counts_at(altitude) else replace(place, polygons=(), lines=(), buffer=0.0)
            for place in sketch.regions
        ),
        obstacles=present(sketch.obstacles),
        landmarks=present(sketch.landmarks),
    )


def _places(sketch: SceneSketch) -> tuple[Place, ...]:
    return (*sketch.regions, *sketch.obstacles, *sketch.landmarks)


def _in_one_datum(sketch: SceneSketch) -> SceneSketch:
    """``sketch`` with all limits in the datum of ``scene.altitude``; says which datum that is.

    If all limits are above ground, so is the altitude; otherwise it is above mean sea level. The height of
    the ground is not known, so obstacles with a ceiling above ground then have none, and a floor above ground
    counts from the sea, which is lower.
    """
    datums = {limit.datum for place in _places(sketch) for limit in (place.floor, place.ceiling)} - {""}
    if not datums:
        return sketch
    if datums == {"AGL"}:
        LOG.info("%s: its limits are above ground, and so is scene.altitude", sketch.where)
        return sketch
    LOG.info(
        "%s: its limits are above mean sea level, and so is scene.altitude%s", sketch.where,
        "; a flight level is the height in the standard atmosphere, up to 300 m off by air pressure"
        if "FL" in datums else "",
    )  # fmt: skip
    unknown = [place.what for place in sketch.obstacles if place.ceiling.datum == "AGL"]
    if unknown:
        LOG.warning(
            "%s: the height of the ground is not known, so these have no ceiling: %s", sketch.where,
            listed_text(unknown),
        )  # fmt: skip
    obstacles = (
        replace(place, ceiling=HIGHEST) if place.ceiling.datum == "AGL" else place
        for place in sketch.obstacles
    )
    return replace(sketch, obstacles=tuple(obstacles))


def _band(place: Place) -> str:
    if place.floor.metres == -math.inf:
        return f"up to {_text(place.ceiling)}"
    if place.ceiling.metres == math.inf:
        return f"above {_text(place.floor)}"
    return f"from {place.floor.metres:g} to {_text(place.ceiling)}"


def _text(limit: Height) -> str:
    return f"{limit.metres:g} m {limit.datum}".strip()
