"""``mission.plan`` against what QGroundControl requires when it loads a plan.

QGroundControl has no schema file. The schema below states the keys, types and versions that its loaders
check (PlanMasterController, MissionController, MissionItem, GeoFenceController, QGCFencePolygon and
RallyPointController in github.com/mavlink/qgroundcontrol, and docs.qgroundcontrol.com, "Plan File Format").
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import jsonschema
import numpy as np
import pytest

from exported_plans import Flown
from flight_quantities.heights import Height
from pareto_ltl_apps.exports.exported import FIXED_WING, GENERIC, MULTIROTOR, SUBMARINE, Vehicle
from pareto_ltl_apps.exports.kinds import FORMATS

NUMBER, LATITUDE = {"type": "number"}, {"type": "number", "minimum": -90, "maximum": 90}
LONGITUDE = {"type": "number", "minimum": -180, "maximum": 180}
OPTIONAL = {"type": ["number", "null"]}  # null is NaN: not set


def parts(**properties: Any) -> dict[str, Any]:
    return {"type": "object", "required": list(properties), "properties": properties}


def row(*items: Any) -> dict[str, Any]:
    return {"type": "array", "prefixItems": items, "minItems": len(items), "maxItems": len(items)}


def listed(items: Any, least: int = 0) -> dict[str, Any]:
    return {"type": "array", "items": items, "minItems": least}


ITEM = parts(
    type={"const": "SimpleItem"}, frame={"type": "integer"}, command={"type": "integer"},
    autoContinue={"type": "boolean"}, doJumpId={"type": "integer", "minimum": 1},
    params=row(*[OPTIONAL] * 7),
)  # fmt: skip
PLACE = parts(
    params=row(*[OPTIONAL] * 4, LATITUDE, LONGITUDE, NUMBER), Altitude=NUMBER,
    AltitudeMode={"enum": [1, 2]}, AMSLAltAboveTerrain=OPTIONAL, frame={"enum": [0, 3]},
)  # fmt: skip
AT_A_PLACE = {"properties": {"command": {"enum": [16, 17, 22]}}}  # waypoint, hovering, take-off
PLAN = parts(
    fileType={"const": "Plan"},
    version={"const": 1},
    groundStation={"type": "string"},
    mission=parts(
        version={"const": 2},
        firmwareType={"enum": [0, 3, 12]},
        vehicleType={"enum": [GENERIC, FIXED_WING, MULTIROTOR, SUBMARINE]},
        cruiseSpeed=NUMBER,
        hoverSpeed=NUMBER,
        globalPlanAltitudeMode={"enum": [1, 2]},
        plannedHomePosition=row(LATITUDE, LONGITUDE, NUMBER),
        items=listed({"allOf": [ITEM, {"if": AT_A_PLACE, "then": PLACE}]}, 1),
    ),
    geoFence=parts(
        version={"const": 2},
        circles=listed({}),
        polygons=listed(
            parts(
                version={"const": 1},
                inclusion={"type": "boolean"},
                polygon=listed(row(LATITUDE, LONGITUDE), 3),
            )
        ),
    ),
    rallyPoints=parts(version={"const": 2}, points=listed(row(LATITUDE, LONGITUDE, NUMBER))),
)


@pytest.mark.parametrize("height", [Height(100.0, False, "100m"), Height(3000.0, True, "3000m amsl")])
@pytest.mark.parametrize("vehicle", [Vehicle(GENERIC), Vehicle(MULTIROTOR, takes_off=True, hovers=True)])
def test_the_plan_has_what_qgroundcontrol_requires(flown: Flown, vehicle: Vehicle, height: Height) -> None:
    content = json.loads(FORMATS["qgc"].content(replace(flown.exported, vehicle=vehicle, height=height)))
    jsonschema.Draft202012Validator(PLAN).validate(content)
    numbers = [item["doJumpId"] for item in content["mission"]["items"]]
    assert numbers == list(range(1, len(numbers) + 1))


@pytest.mark.parametrize(
    "spoil",
    [
        lambda plan: plan["mission"].pop("plannedHomePosition"),
        lambda plan: plan["mission"]["plannedHomePosition"].pop(),
        lambda plan: plan["mission"]["items"][-1]["params"].pop(),
        lambda plan: plan["mission"]["items"][-1]["params"].__setitem__(4, None),
        lambda plan: plan["geoFence"]["polygons"][0]["polygon"][0].reverse(),
        lambda plan: plan.pop("rallyPoints"),
    ],
)
def test_a_spoilt_plan_is_refused(flown: Flown, spoil: Callable[[Any], object]) -> None:
    content = flown.json("mission.plan")
    spoil(content)
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.Draft202012Validator(PLAN).validate(content)


def loaded(item: dict[str, Any]) -> list[Any]:
    """``params`` as QGroundControl loads an item: the ``coordinate`` of older files is appended to them."""
    params = [*item["params"], *item.get("coordinate", [])]
    if len(params) != 7:
        raise ValueError("params key must contain 7 values")
    return params


def test_no_item_has_a_coordinate_beside_its_seven_params(flown: Flown) -> None:
    """QGroundControl would refuse the file; other readers find the places in ``params``."""
    items = flown.json("mission.plan")["mission"]["items"]
    places = [loaded(item)[4:6] for item in items if item["command"] == 16]
    log = flown.exported.log
    np.testing.assert_allclose(places, np.column_stack([log.lat, log.lon])[1:])
    with pytest.raises(ValueError, match="7 values"):
        loaded(items[-1] | {"coordinate": [1.0, 2.0, 3.0]})
