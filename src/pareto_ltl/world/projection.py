"""The plane and the clock of a map."""

from __future__ import annotations

from flight_quantities import frames


class Frame(frames.Frame):
    """Plane and clock of a map; errors name the settings that state them."""

    __slots__ = ()
    CRS = "scene.crs"
    UNPLACED = "the map has no place on Earth: give scene.centre, or draw it as GeoJSON in degrees"
