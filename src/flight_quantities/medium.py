"""The words for what a craft moves in: air with its wind, or water with its current."""

from __future__ import annotations

from typing import NamedTuple


class Medium(NamedTuple):
    """The words for one medium.

    Attributes
    ----------
    flow, flows : str
        The wind or current, one and several.
    speed : str
        The speed of the craft relative to the medium.
    moves, time : str
        What the craft does, and the name of the time that it takes.
    matter, still : str
        The medium, and the medium without a flow.
    levels : str
        Places above or below each other, with other flows.
    """

    flow: str
    flows: str
    speed: str
    moves: str
    time: str
    matter: str
    still: str
    levels: str


AIR = Medium("wind", "winds", "airspeed", "flies", "flight time", "air", "calm air", "heights")
WATER = Medium(
    "current",
    "currents",
    "speed through the water",
    "moves",
    "time under way",
    "water",
    "still water",
    "depths",
)


MEDIA = {medium.matter: medium for medium in (AIR, WATER)}


def medium_of(*levels: str | None) -> Medium:
    """Water if one of the ``levels`` of a craft or a wind is a depth (``30m depth``), else air."""
    return WATER if any(level and level.endswith("depth") for level in levels) else AIR
