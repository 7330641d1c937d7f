"""Plans in odd places: across the 180th meridian, far north, with fixes, without a step, without wind."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import fastkml
import geojson
import gpxpy
import numpy as np
import pytest
import shapely
from fastkml.validator import validate
from implicitdict import ImplicitDict
from numpy.random import SeedSequence
from pymavlink.dialects.v20 import all as mavlink
from uas_standards.astm.f3548.v21.api import OperationalIntentDetails

import pareto_ltl
from exported_plans import Flown, metres_apart, settings_named
from flight_quantities.frames import local_plane
from pareto_ltl.extend import Frame
from pareto_ltl.support.schemas import check_document
from pareto_ltl_apps.exports.exported import ExportedPlan, exported_plan
from pareto_ltl_apps.exports.formats import holds_pole, writable_formats, write_exports
from pareto_ltl_apps.exports.kinds import FORMATS
from pareto_ltl_apps.exports.mavlink import script_messages

PLACES = [(52.0, 179.9), (-45.0, -179.99), (80.0, 20.0), (0.0, 0.0)]


@pytest.fixture(scope="module")
def moved(flown: Flown) -> Callable[[float, float], ExportedPlan]:
    """The same plan with the map centred elsewhere."""

    def at(lat: float, lon: float) -> ExportedPlan:
        scene = replace(flown.result.scene, crs=local_plane(lat, lon))
        problem = replace(flown.problem, scene=scene)
        return exported_plan(settings_named("moved"), problem, flown.result.plan, SeedSequence(5))

    return at


@pytest.mark.parametrize(("lat", "lon"), PLACES)
def test_a_map_anywhere_is_drawn_by_all_readers(
    lat: float, lon: float, moved: Callable[[float, float], ExportedPlan], tmp_path: Path
) -> None:
    exported = moved(lat, lon)
    write_exports(exported, list(FORMATS), tmp_path)
    for name in ("plan.geojson", "corridor.geojson"):
        found = geojson.loads((tmp_path / name).read_text())
        assert found.is_valid
        for feature in found.features:
            shape = shapely.geometry.shape(feature.geometry)
            assert shape.is_valid, feature.properties
            assert shape.bounds[2] - shape.bounds[0] <= 180 or shape.geom_type.startswith("Multi")
            assert -180 <= shape.bounds[0] <= shape.bounds[2] <= 180
    assert validate(file_to_validate=tmp_path / "plan.kml")
    assert fastkml.KML.parse(tmp_path / "plan.kml")
    points = gpxpy.parse((tmp_path / "plan.gpx").read_text()).routes[0].points
    assert metres_apart([p.latitude for p in points], [p.longitude for p in points], exported) < 0.01
    assert all(-180 <= p.longitude < 180 for p in points)
    intent = json.loads((tmp_path / "operational_intent.json").read_text())
    assert ImplicitDict.parse(intent, OperationalIntentDetails).volumes


def test_what_crosses_the_180th_meridian_is_cut(moved: Callable[[float, float], ExportedPlan]) -> None:
    drawn = geojson.loads(FORMATS["geojson"].content(moved(52.0, 179.9)))
    kinds = {f.properties["role"]: f.geometry.type for f in drawn.features}
    assert kinds["bounds"] == "MultiPolygon"
    drawn = geojson.loads(FORMATS["geojson"].content(moved(52.0, 100.0)))
    assert not any(f.geometry.type.startswith("Multi") for f in drawn.features)


def test_fences_are_cut_at_the_180th_meridian_and_keep_their_area(
    moved: Callable[[float, float], ExportedPlan],
) -> None:
    for lon in (179.9, 178.0, -177.0, 100.0):
        exported = moved(40.0, lon)
        content = json.loads(FORMATS["qgc"].content(exported))
        fences = content["geoFence"]["polygons"]
        for fence in fences:
            lons = np.array(fence["polygon"])[:, 1]
            assert np.abs(np.diff(np.append(lons, lons[0]))).max() < 180.0
            assert np.abs(lons).max() <= 180.0
        outside = [np.array(f["polygon"])[:, ::-1] for f in fences if not f["inclusion"]]
        plane = Frame(exported.crs)
        drawn = shapely.union_all([shapely.Polygon(plane.to_plane(*ring.T)) for ring in outside])
        obstacles = shapely.union_all([shapely.Polygon(corners) for corners in exported.scene.obstacles])
        assert shapely.symmetric_difference(drawn, obstacles).area < 1e-3 * obstacles.area
        cut = lon != 100.0
        assert any(fence["inclusion"] for fence in fences) != cut
        assert ("no fence" in content["pareto_ltl"]["note"]) == cut
    assert len(json.loads(FORMATS["qgc"].content(moved(40.0, 179.9)))["geoFence"]["polygons"]) > len(
        exported.scene.obstacles
    )


@pytest.mark.parametrize(("lat", "held"), [(88.0, True), (-90.0 + 1e-9, True), (80.0, False), (0.0, False)])
def test_areas_are_not_drawn_around_a_pole(lat: float, held: bool, flown: Flown) -> None:
    scene = replace(flown.result.scene, crs=local_plane(lat, 10.0))
    assert holds_pole(scene) == held
    formats, reason = writable_formats(list(FORMATS), scene, flown.exported.log.t)
    assert (set(FORMATS) - set(formats)) == ({"geojson", "kml", "corridor"} if held else set())
    assert reason.startswith("geojson, kml, corridor: not written, since the map holds a pole") == held


def test_a_fix_is_to_be_filled_in_by_who_sees_the_landmark(flown: Flown) -> None:
    fixes = (3, len(flown.exported.log.t) - 1)
    exported = replace(flown.exported, log=replace(flown.exported.log, fixes=fixes))
    content = json.loads(FORMATS["mavlink"].content(exported))
    check_document(content, "mavlink_script", "script")
    asked = [told for told in content["messages"] if told.get("fill_in")]
    assert [told["t"] for told in asked] == [exported.log.t[k] for k in fixes]
    for told, k in zip(asked, fixes, strict=True):
        place = (told["x"], told["y"], float("nan") if told["z"] is None else told["z"])
        message = mavlink.MAVLink_command_int_message(
            1, 1, told["frame"], told["command"], 0, 0, *told["params"], *place
        )
        (decoded,) = mavlink.MAVLink(None).parse_buffer(message.pack(mavlink.MAVLink(None)))
        assert mavlink.enums["MAV_CMD"][decoded.command].name == "MAV_CMD_EXTERNAL_POSITION_ESTIMATE"
        assert decoded.x / 1e7 == pytest.approx(exported.log.lat[k], abs=1e-7)
        assert decoded.y / 1e7 == pytest.approx(exported.log.lon[k], abs=1e-7)
        assert decoded.param3 > 0
    rows = FORMATS["dead_reckoning"].content(exported).decode().splitlines()[1:]
    assert [k for k, row in enumerate(rows) if row.split(",")[-2] == "1"] == list(fixes)


def test_a_robot_that_drifts_has_no_heading(flown: Flown) -> None:
    log = flown.exported.log
    heading, airspeed = log.heading.copy(), log.airspeed.copy()
    heading[2], airspeed[2] = np.nan, 0.0
    exported = replace(flown.exported, log=replace(log, heading=heading, airspeed=airspeed))
    row = FORMATS["dead_reckoning"].content(exported).decode().splitlines()[3].split(",")
    assert row[3:5] == ["", "0.0"]
    sent = [told for told in script_messages(exported) if told["t"] == log.t[2]]
    assert [told["command"] for told in sent] == [43004, 43000]
    speeds = [
        i["params"][1]
        for i in json.loads(FORMATS["qgc"].content(exported))["mission"]["items"]
        if i["command"] == 178
    ]
    assert min(speeds) > 0
    assert geojson.loads(FORMATS["geojson"].content(exported)).is_valid
    assert b"nan" not in FORMATS["kml"].content(exported).lower()


def test_a_plan_without_a_step_and_without_wind_is_exported(tmp_path: Path) -> None:
    scene = {
        "bounds": [[0, 0], [1e6, 1e6]], "start": [5e5, 5e5], "centre": [37.0, -92.0],
        "regions": {"a": [[4e5, 4e5], [7e5, 4e5], [5e5, 7e5]]},
    }  # fmt: skip
    mission = {"formula": "F a", "start_time": "2018-10-09T00:00:00Z"}
    planner = {"trees": 1, "n_max": 300}
    with np.errstate(invalid="ignore"):  # the hypervolume of a front of length 0 is none
        result = pareto_ltl.plan(scene, mission, planner=planner, wind="calm", fidelity="paper")
    assert len(result.plan.path.u) == 0
    pareto_ltl.export(result, tmp_path, list(FORMATS), altitude_lower=0.0, altitude_upper=10.0)
    assert geojson.loads((tmp_path / "plan.geojson").read_text()).is_valid
    assert geojson.loads((tmp_path / "corridor.geojson").read_text()).is_valid
    assert validate(file_to_validate=tmp_path / "plan.kml")
    intent = json.loads((tmp_path / "operational_intent.json").read_text())
    assert intent["volumes"] == []
