"""Altitude bands: a place with a floor or a ceiling is active only if the robot flies between them."""

from __future__ import annotations

import logging
from collections.abc import Iterable
from dataclasses import replace

from pareto_ltl.support.display import listed_text
from pareto_ltl.support.errors import DataError
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
    places = (*sketch.regions, *sketch.obstacles, *sketch.landmarks)
    banded = [place for place in places if place.banded]
    if not banded:
        return sketch
    if rules.altitude is None:
        LOG.info(
            "%s: scene.altitude is not set, so altitude limits are ignored: %s are always active",
            sketch.where, listed_text([place.what for place in banded]),
        )  # fmt: skip
        return sketch
    altitude = rules.altitude
    absent = [place for place in banded if not place.counts_at(altitude)]
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


def _band(place: Place) -> str:
    if place.floor is None:
        return f"up to {place.ceiling:g} m"
    return (
        f"above {place.floor:g} m"
        if place.ceiling is None
        else f"from {place.floor:g} to {place.ceiling:g} m"
    )
