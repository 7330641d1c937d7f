"""Coasts, borders and cities of a part of the map that is shown."""

from __future__ import annotations

import math
from typing import Any

from careful_io.messages import shown_value
from pareto_ltl.support.errors import ConfigError
from pareto_ltl_apps.view.geography import FINEST, geography_of

LONGEST_NAME = 80  # characters of a search
MOST_PIXELS = 20_000
WIDEST = 1080.0  # [deg]


def ground_view(box: str, pixels: str) -> dict[str, Any]:
    """The geography of ``box``, WEST,SOUTH,EAST,NORTH [deg], as fine as so many ``pixels`` across show."""
    try:
        west, south, east, north = map(float, box.split(","))
        across = int(pixels)
    except ValueError:
        west = south = east = north = math.nan
        across = 0
    fits = -90.0 <= south < north <= 90.0 and west < east <= west + WIDEST and abs(west) <= WIDEST
    if not fits or not 0 < across <= MOST_PIXELS:
        raise ConfigError(
            "expected ?box=WEST,SOUTH,EAST,NORTH in degrees, and &pixels from 1 to "
            f"{MOST_PIXELS:,}, got box {shown_value(box)} and pixels {shown_value(pixels)}"
        )
    if east - west > 360.0:  # once round the Earth is enough
        middle = (west + east) / 2.0
        west, east = middle - 180.0, middle + 180.0
    return geography_of((west, south, east, north), max(FINEST, (east - west) / across)).as_dict()
