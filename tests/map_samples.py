"""Small files of airspace and fences, as other programs write them, shared by the suites."""

from __future__ import annotations

from typing import Any


def box(west: float, south: float, east: float, north: float) -> list[list[float]]:
    """A closed square of GeoJSON [deg]."""
    return [[west, south], [east, south], [east, north], [west, north], [west, south]]


AREA = [box(10.2, 59.95, 10.4, 60.3)]
OPENAIR = """* a comment
AC D
AN TEST CTR
AL GND
AH 2500ft
DP 60:24:00 N 010:00:00 E
DP 60:24:00 N 010:18:00 E * the corner
DP 60:30:00 N 010:18:00 E
DP 60:30:00 N 010:00:00 E

AC R
AN CIRCLE
AL 1000ft MSL
AH FL65
V X=60:06:00 N 010:12:00 E
DC 1.5

AC Q
AN WEDGE
AL SFC
AH UNL
V X=60:00.0 N 010:30.0 E
V D=+
DP 60:00.0N 010:30.0E
DA 2,0,90

AC Q
AN HALF
AH NOTAM
V D=-
V X=60.25N 10.5E
DB 60:17:00 N 010:30:00 E, 60:13:00 N 010:30:00 E
"""
PLAN: dict[str, Any] = {
    "fileType": "Plan", "groundStation": "QGroundControl", "version": 1,
    "geoFence": {
        "version": 2,
        "circles": [{"circle": {"center": [60.25, 10.3], "radius": 2000.0}, "inclusion": False}],
        "polygons": [
            {"inclusion": True, "polygon": [[59.9, 9.9], [59.9, 10.9], [60.5, 10.9], [60.5, 9.9]]},
            {"inclusion": False, "polygon": [[60.1, 10.2], [60.1, 10.4], [60.2, 10.4], [60.2, 10.2]]},
        ],
    },
    "mission": {"plannedHomePosition": [60, 10, 100], "items": [{"command": 16}]},
}  # fmt: skip
WAYPOINTS = """QGC WPL 110
0\t1\t0\t16\t0\t0\t0\t0\t60.0\t10.0\t100\t1
1\t0\t0\t5001\t4\t0\t0\t0\t59.9\t9.9\t0\t1
2\t0\t0\t5001\t4\t0\t0\t0\t59.9\t10.9\t0\t1
3\t0\t0\t5001\t4\t0\t0\t0\t60.5\t10.9\t0\t1
4\t0\t0\t5001\t4\t0\t0\t0\t60.5\t9.9\t0\t1
5\t0\t0\t5002\t4\t0\t0\t0\t60.1\t10.2\t0\t1
6\t0\t0\t5002\t4\t0\t0\t0\t60.1\t10.4\t0\t1
7\t0\t0\t5002\t4\t0\t0\t0\t60.2\t10.4\t0\t1
8\t0\t0\t5002\t4\t0\t0\t0\t60.2\t10.2\t0\t1
9\t0\t0\t5004\t2000\t0\t0\t0\t60.25\t10.3\t0\t1
"""
ED269: dict[str, Any] = {
    "title": "zones",
    "features": [
        {
            "identifier": "X1", "name": "prison", "type": "COMMON", "restriction": "PROHIBITED",
            "applicability": [{"permanent": "YES"}],
            "geometry": [
                {
                    "uomDimensions": "FT", "lowerLimit": 0, "lowerVerticalReference": "AGL",
                    "upperLimit": 400, "upperVerticalReference": "AGL",
                    "horizontalProjection": {"type": "Polygon", "coordinates": AREA},
                }
            ],
        },
        {
            "identifier": "X2", "name": "race", "restriction": "CONDITIONAL",
            "applicability": [
                {
                    "permanent": "NO",
                    "startDateTime": "2026-01-01T06:00:00Z", "endDateTime": "2026-01-01T09:00:00Z",
                }
            ],
            "geometry": [
                {
                    "uomDimensions": "M", "lowerLimit": 0, "upperLimit": 500,
                    "horizontalProjection": {"type": "Circle", "center": [10.5, 60.3], "radius": 1500},
                }
            ],
        },
        {
            "identifier": "X3", "restriction": "NO_RESTRICTION",
            "geometry": [{"horizontalProjection": {"type": "Polygon", "coordinates": AREA}}],
        },
    ],
}  # fmt: skip
OPENAIP_LIMITS = {
    "lowerLimit": {"value": 1000, "unit": 1, "referenceDatum": 1},
    "upperLimit": {"value": 65, "unit": 6, "referenceDatum": 2},
}
