"""``operational_intent.json``: volumes in time as ASTM F3548-21 has them in OperationalIntentDetails.

Each leg is a Volume4D: the hull of the ellipses at both ends, of the size that 95 % of whole flights stay in,
and all places within :data:`LATERAL_FLOOR` of the leg.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import shapely

from pareto_ltl.exports.degrees import lonlat
from pareto_ltl.exports.exported import ExportedPlan
from pareto_ltl.exports.geojson import leg_hulls
from pareto_ltl.exports.json_text import listed_json
from pareto_ltl.support.errors import ConfigError
from pareto_ltl.support.files import plain_data

LATERAL_FLOOR = 10.0  # [m] least distance from the expected path to the edge: navigation errors in calm air
SHARE = 0.95  # of whole flights that stay in the volumes


def operational_intent(exported: ExportedPlan) -> bytes:
    """The file; raises ConfigError if the heights are not set."""
    if exported.band is None:
        raise ConfigError(
            "f3548 needs heights above the WGS 84 ellipsoid; set exports.altitude_lower and "
            "exports.altitude_upper"
        )
    corridor, log = exported.corridor, exported.log
    assert log.utc is not None
    size = corridor.whole[corridor.level(SHARE)]
    hulls = leg_hulls(corridor.outlines(np.full(len(corridor.mean), size)))
    ways = (shapely.LineString(ends) for ends in pairwise(corridor.mean))
    hulls = [
        hull.union(way.buffer(LATERAL_FLOOR)).convex_hull for hull, way in zip(hulls, ways, strict=False)
    ]
    legs = zip(hulls, pairwise(log.utc), strict=False)  # a plan without a step has a hull and no leg
    volumes = [_volume(exported, hull, *times) for hull, times in legs]
    note = f"{SHARE * 100:g} % of whole flights in {corridor.law} winds stay in these volumes. "
    head = {"pareto_ltl": {"note": note + " ".join(exported.sentences())}, "priority": 0}
    return listed_json(head | {"off_nominal_volumes": []}, "volumes", plain_data(volumes))


def _volume(exported: ExportedPlan, hull: Any, start: str, end: str) -> dict[str, Any]:
    assert exported.band is not None
    corners = lonlat(exported.crs, shapely.get_coordinates(hull)[:-1])
    lower, upper = ({"value": h, "reference": "W84", "units": "M"} for h in exported.band)
    return {
        "volume": {
            "outline_polygon": {"vertices": [{"lng": lon, "lat": lat} for lon, lat in corners.tolist()]},
            "altitude_lower": lower,
            "altitude_upper": upper,
        },
        "time_start": {"value": start, "format": "RFC3339"},
        "time_end": {"value": end, "format": "RFC3339"},
    }
