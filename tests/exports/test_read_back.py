"""Every file, read by a library that is not ours: positions within a metre, times within a second."""

from __future__ import annotations

import csv
import io
import json
import math
import re
from dataclasses import replace
from datetime import UTC, datetime
from itertools import pairwise
from types import SimpleNamespace
from typing import Any
from xml.etree import ElementTree

import fastkml
import geojson
import geopandas
import gpxpy
import numpy as np
import pytest
import shapely
import xarray
from fastkml.utils import find_all
from fastkml.validator import validate
from implicitdict import ImplicitDict
from pymavlink.dialects.v20 import all as mavlink
from uas_standards.astm.f3548.v21.api import OperationalIntentDetails, Volume4D

from exported_plans import Flown, metres_apart, seconds_apart
from flight_quantities.heights import Height, level_height
from flight_quantities.levels import parse_level
from pareto_ltl.extend import Frame
from pareto_ltl.planning.power import energy_model
from pareto_ltl.settings import RobotConfig, Settings
from pareto_ltl.support.schemas import read_document
from pareto_ltl_apps.exports.exported import vehicle_of
from pareto_ltl_apps.exports.kinds import FORMATS
from pareto_ltl_apps.exports.xml_files import short_text


def test_the_table_has_a_row_for_each_leg_and_one_for_the_arrival(flown: Flown) -> None:
    text = (flown.folder / "dead_reckoning.csv").read_text()
    rows = list(csv.DictReader(io.StringIO(text)))
    log = flown.exported.log
    assert (
        metres_apart(*([float(row[key]) for row in rows] for key in ("lat_deg", "lon_deg")), flown.exported)
        < 1e-6
    )
    assert seconds_apart([datetime.fromisoformat(row["time_utc"]) for row in rows], flown.exported) == 0
    assert [float(row["heading_true_deg"]) for row in rows[:-1]] == log.heading.tolist()
    assert [float(row["airspeed_tas_m_s"]) for row in rows[:-1]] == log.airspeed.tolist()
    assert [float(row["wind_from_deg"]) for row in rows[:-1]] == log.wind_from.tolist()
    assert [float(row["radius_95_m"]) for row in rows] == log.radius.tolist()
    assert {row["wind_law"] for row in rows} == {"coherent"}
    assert rows[-1]["heading_true_deg"] == rows[-1]["wind_m_s"] == ""


def features(flown: Flown, name: str) -> list[geojson.Feature]:
    found = geojson.loads((flown.folder / name).read_text())
    assert found.is_valid, found.errors()
    assert all(feature.is_valid for feature in found.features)
    return list(found.features)


def test_the_plan_in_geojson(flown: Flown) -> None:
    found = features(flown, "plan.geojson")
    positions = [f for f in found if f.properties["role"] == "position"]
    lon, lat = np.array([f.geometry.coordinates for f in positions]).T
    assert metres_apart(lat, lon, flown.exported) < 0.1  # this reader rounds to six digits
    times = [datetime.fromisoformat(f.properties["time_utc"]) for f in positions]
    assert seconds_apart(times, flown.exported) == 0
    legs = [f for f in found if f.properties["role"] == "leg"]
    assert [f.properties["airspeed_tas_m_s"] for f in legs] == flown.exported.log.airspeed.tolist()
    assert {f.properties["wind_law"] for f in (*legs, *positions)} == {"coherent"}
    for role, polygons in (
        ("region", flown.result.scene.region_outlines), ("obstacle", flown.result.scene.obstacles),
    ):  # fmt: skip
        drawn = [shapely.geometry.shape(f.geometry) for f in found if f.properties["role"] == role]
        assert len(drawn) == len(polygons)
        for shape, corners in zip(drawn, polygons, strict=True):
            assert shape.exterior.is_ccw
            back = Frame(flown.exported.crs).to_plane(*np.array(shape.exterior.coords).T)
            assert shapely.hausdorff_distance(shapely.Polygon(back), shapely.Polygon(corners)) < 1.0


def test_the_corridor_in_geojson(flown: Flown) -> None:
    found, corridor = features(flown, "corridor.geojson"), flown.exported.corridor
    assert {f.properties["wind_law"] for f in found} == {"coherent"}
    tubes = [f for f in found if f.properties["meaning"] == "whole_flight"]
    assert [f.properties["probability"] for f in tubes] == [0.5, 0.9, 0.95, 0.99]
    shapes = [shapely.geometry.shape(f.geometry) for f in tubes]
    for inner, outer in pairwise(shapes):
        assert shapely.covers(shapely.buffer(outer, 1e-9), inner)
    ellipses = [f for f in found if f.properties["meaning"] == "at_time"]
    assert len(ellipses) == 4 * len(corridor.mean)
    for feature in ellipses[:: len(corridor.mean) // 3]:
        level = corridor.level(feature.properties["probability"])
        k = feature.properties["step"]
        if k == 0:
            continue  # a circle of a metre, and this reader rounds to six digits
        back = (
            Frame(flown.exported.crs).to_plane(*np.array(feature.geometry.coordinates[0]).T)
            - corridor.mean[k]
        )
        sizes = np.sqrt(np.einsum("ni,ij,nj->n", back, np.linalg.inv(corridor.cov[k]), back))
        np.testing.assert_allclose(sizes, corridor.at_time[level, k] / np.cos(np.pi / 36), rtol=1e-3)


def test_the_plan_in_kml(flown: Flown) -> None:
    path = flown.folder / "plan.kml"
    assert validate(file_to_validate=path)  # against the OGC schema
    document = fastkml.KML.parse(path)
    marks = list(find_all(document, of_type=fastkml.Placemark))
    positions = [mark for mark in marks if mark.times is not None]
    lon, lat, height = np.array([mark.geometry.coords[0] for mark in positions]).T
    assert metres_apart(lat, lon, flown.exported) < 0.01
    assert set(height) == {10.0}
    assert path.read_text().count("<altitudeMode>relativeToGround</altitudeMode>") == len(positions) + 1
    assert seconds_apart([mark.times.timestamp.dt for mark in positions], flown.exported) == 0
    names = [mark.name for mark in marks]
    assert {"a", "b", "c", "obstacle 1", "95 % of whole flights, coherent winds"} <= set(names)
    (document,) = document.features
    assert document.name == "phi1 <&>"
    assert "coherent winds" in document.description
    text = path.read_text()
    styles, used = (
        set(re.findall(pattern, text)) for pattern in (r'<Style id="(\w+)"', r"<styleUrl>#(\w+)<")
    )
    assert used <= styles  # the map has no landmark
    assert len(styles) >= 3  # regions, obstacles and the path differ
    assert text.count("<styleUrl>") >= len(marks) - len(positions)


@pytest.mark.parametrize("name", ["plan.geojson", "corridor.geojson", "plan.kml", "plan.gpx"])
def test_maps_open_in_gdal_as_in_qgis(flown: Flown, name: str) -> None:
    """Without a warning, in degrees, and in the area of the plan; no shape is broken."""
    path = flown.folder / name
    layers = [str(layer) for layer in geopandas.list_layers(path)["name"]]
    read = [geopandas.read_file(path, layer=layer) for layer in layers]
    shapes = [shape for table in read for shape in table.geometry]
    assert {table.crs.to_epsg() for table in read} == {4326}
    assert all(shape.is_valid and not shape.is_empty for shape in shapes)
    west, south, east, north = np.add(shapely.total_bounds(shapes), [-1e-7, -1e-7, 1e-7, 1e-7])
    log = flown.exported.log
    assert west <= min(log.lon) <= max(log.lon) <= east
    assert south <= min(log.lat) <= max(log.lat) <= north
    assert max(east - west, north - south) < 60.0
    if name == "plan.geojson":
        legs = read[0][read[0]["role"] == "leg"]
        assert legs["airspeed_tas_m_s"].tolist() == pytest.approx(log.airspeed.tolist())


def test_the_plan_in_gpx(flown: Flown) -> None:
    found = gpxpy.parse((flown.folder / "plan.gpx").read_text())
    (route,) = found.routes
    lat, lon = np.array([(p.latitude, p.longitude) for p in route.points]).T
    assert metres_apart(lat, lon, flown.exported) < 0.01
    assert seconds_apart([p.time for p in route.points], flown.exported) == 0
    assert found.name == "phi1 <&>"
    assert "fail" in found.description
    assert {p.elevation for p in route.points} == {None}
    assert all("10 m above the ground" in p.description for p in route.points)


def test_the_gpx_route_has_the_departure_for_opencpn(flown: Flown) -> None:
    text = (flown.folder / "plan.gpx").read_text()
    assert f"<opencpn:planned_departure>{flown.exported.log.utc[0]}</opencpn:planned_departure>" in text


def test_the_card_is_the_table_rounded_and_no_leg_is_lost(flown: Flown) -> None:
    rows = list(csv.DictReader(io.StringIO(FORMATS["card"].content(flown.exported).decode())))
    log, legs = flown.exported.log, list[int]()
    for row in rows[:-1]:
        first, _, last = row["legs"].partition("-")
        own = list(range(int(first), int(last or first) + 1))
        legs += own
        assert all(round(log.heading[k]) % 360 == int(row["heading_true_deg"]) for k in own)
        assert np.abs(log.airspeed[own] - float(row["airspeed_tas_m_s"])).max() <= 0.051
        assert abs(log.duration[own].sum() - float(row["duration_s"])) <= 0.51
        assert row["time_utc"] == log.utc[own[0]]
    assert legs == list(range(len(log.airspeed)))
    assert rows[-1]["legs"] == str(len(legs))
    assert len(rows) <= len(legs) + 1


def test_the_card_of_a_slow_robot_has_hundredths_of_a_metre_per_second(flown: Flown) -> None:
    log = flown.exported.log
    speeds = {name: 0.01 * getattr(log, name) for name in ("airspeed", "calibrated")}
    slow = replace(flown.exported, log=replace(log, **speeds))
    rows = list(csv.DictReader(io.StringIO(FORMATS["card"].content(slow).decode())))
    assert {len(row["airspeed_tas_m_s"].partition(".")[2]) for row in rows[:-1]} == {2}
    assert float(rows[0]["airspeed_tas_m_s"]) == pytest.approx(0.01 * log.airspeed[0], abs=0.0051)


def test_the_plan_for_garmin(flown: Flown) -> None:
    """Every point of the route is in the table; identifiers and comments have the letters of a navigator."""
    root = ElementTree.fromstring(FORMATS["fpl"].content(flown.exported))
    space = "{http://www8.garmin.com/xmlschemas/FlightPlan/v1}"
    assert [child.tag.removeprefix(space) for child in root] == [
        "file-description", "created", "waypoint-table", "route",
    ]  # fmt: skip
    table = {str(p.findtext(f"{space}identifier")): p for p in root.iter(f"{space}waypoint")}
    route = [table[str(p.findtext(f"{space}waypoint-identifier"))] for p in root.iter(f"{space}route-point")]
    lat, lon = (np.array([float(str(p.findtext(f"{space}{key}"))) for p in route]) for key in ("lat", "lon"))
    assert metres_apart(lat, lon, flown.exported) < 0.01
    assert "fail" in str(root.findtext(f"{space}file-description"))
    for place in table.values():
        assert re.fullmatch(r"[A-Z0-9]{1,6}", str(place.findtext(f"{space}identifier")))
        assert re.fullmatch(r"[A-Z0-9 /]{0,25}", str(place.findtext(f"{space}comment") or ""))
    assert short_text("Päijänne north, EFKU CTR / <b>") == "PAIJANNE NORTH EFKU CTR /"


HIGH, DEEP = (level_height(parse_level(text)) for text in ("3000m amsl", "50m depth"))


@pytest.mark.parametrize("height", [HIGH, DEEP])
def test_heights_above_sea_level_are_in_the_files_and_the_home_is_on_the_ground(
    flown: Flown, height: Height
) -> None:
    exported = replace(flown.exported, height=height)
    (route,) = gpxpy.parse(FORMATS["gpx"].content(exported).decode()).routes
    assert {p.elevation for p in route.points} == {height.metres}
    assert b"<altitudeMode>absolute</altitudeMode>" in FORMATS["kml"].content(exported)
    mission = json.loads(FORMATS["qgc"].content(exported))["mission"]
    assert mission["plannedHomePosition"][2] == 0.0


AIR, SEA, WATER = level_height(parse_level("100m")), HIGH, DEEP


@pytest.mark.parametrize(
    ("robot", "height", "vehicle", "first", "last"),
    [
        ("multirotor", AIR, 2, 22, 17),
        ("multirotor", SEA, 2, 178, 17),
        ("fixed_wing", AIR, 1, 178, 16),
        ("underwater_glider", WATER, 12, 178, 16),
        (None, AIR, 0, 178, 16),
    ],
)
def test_the_mission_names_the_vehicle_and_takes_off_and_hovers_with_rotors(
    flown: Flown, robot: str | None, height: Height, vehicle: int, first: int, last: int
) -> None:
    """The landing is left to the pilot: the plan may end over water."""
    cfg = RobotConfig() if robot is None else Settings.of_section("robot", robot)
    problem: Any = SimpleNamespace(
        energy=energy_model(cfg.power), motion=flown.problem.motion._replace(u_min=cfg.u_min)
    )
    log = flown.exported.log
    changing = np.linspace(1.0, 0.9, len(log.airspeed)) * log.airspeed
    log = replace(log, airspeed=changing, calibrated=changing)
    exported = replace(flown.exported, height=height, vehicle=vehicle_of(height, problem), log=log)
    content = json.loads(FORMATS["qgc"].content(exported))
    mission = content["mission"]
    items = mission["items"]
    assert (mission["vehicleType"], items[0]["command"], items[-1]["command"]) == (vehicle, first, last)
    assert items[-1]["params"][4:] == [log.lat[-1], log.lon[-1], height.metres]
    assert ("hovers at the end" in content["pareto_ltl"]["note"]) == (last == 17)
    assert [item["doJumpId"] for item in items] == list(range(1, len(items) + 1))
    assert {item["command"] for item in items[1:]} == {16, 178, last}
    if first == 22:
        assert items[0]["params"][4:] == [exported.log.lat[0], exported.log.lon[0], 100.0]
        assert items[0]["frame"] == 3


def test_calm_air_has_no_wind_message_and_volumes_of_some_width(flown: Flown) -> None:
    log, corridor = flown.exported.log, flown.exported.corridor
    calm = replace(
        flown.exported,
        log=replace(log, wind_speed_sd=0.0 * log.wind_speed_sd),
        corridor=replace(corridor, cov=1e-6 * corridor.cov),
    )
    sent = {told["name"] for told in json.loads(FORMATS["mavlink"].content(calm))["messages"]}
    assert "MAV_CMD_EXTERNAL_WIND_ESTIMATE" not in sent
    for volume, x, end in zip(
        json.loads(FORMATS["f3548"].content(calm))["volumes"], log.x, log.x[1:], strict=False
    ):
        corners = [(v["lng"], v["lat"]) for v in volume["volume"]["outline_polygon"]["vertices"]]
        outline = shapely.Polygon(Frame(calm.crs).to_plane(*np.array(corners).T))
        assert outline.exterior.distance(shapely.LineString([x, end])) > 9.0


def test_the_trajectory_in_netcdf(flown: Flown) -> None:
    with xarray.open_dataset(flown.folder / "trajectory.nc", engine="h5netcdf") as found:
        assert found.attrs["Conventions"] == "CF-1.8"
        assert found.attrs["featureType"] == "trajectory"
        assert found.trajectory.attrs["cf_role"] == "trajectory_id"
        assert found.trajectory.item().decode() == "phi1 <&>"
        assert {found[name].attrs["units"] for name in ("lat", "lon")} == {"degrees_north", "degrees_east"}
        assert metres_apart(found.lat.values, found.lon.values, flown.exported) < 1e-6
        times = [
            datetime.fromtimestamp(t / 1e9, UTC)
            for t in found.time.values.astype("datetime64[ns]").astype(int)
        ]
        assert seconds_apart(times, flown.exported) == 0
        np.testing.assert_array_equal(found.airspeed.values[:-1], flown.exported.log.airspeed)
        assert math.isnan(found.airspeed.values[-1])
        assert all(
            "time lat lon" in found[n].encoding.get("coordinates", "") for n in ("airspeed", "wind_from")
        )


def test_the_volumes_hold_the_positions_at_their_times(flown: Flown) -> None:
    intent = ImplicitDict.parse(flown.json("operational_intent.json"), OperationalIntentDetails)
    log = flown.exported.log
    assert intent.volumes is not None
    assert len(intent.volumes) == len(log.airspeed)
    starts = [volume.time_start.value.datetime for volume in intent.volumes]
    ends = [volume.time_end.value.datetime for volume in intent.volumes]
    assert seconds_apart([*starts, ends[-1]], flown.exported) == 0
    assert seconds_apart([starts[0], *ends], flown.exported) == 0
    for k, volume in enumerate(intent.volumes):
        assert isinstance(volume, Volume4D)
        corners = [(v.lng, v.lat) for v in volume.volume.outline_polygon.vertices]
        assert len(set(corners)) == len(corners)  # nor is the first one repeated
        outline = shapely.Polygon(corners)
        assert outline.is_valid
        assert outline.contains(shapely.Point(log.lon[k], log.lat[k]))
        assert outline.contains(shapely.Point(log.lon[k + 1], log.lat[k + 1]))
        low, high = volume.volume.altitude_lower, volume.volume.altitude_upper
        assert (low.value, high.value, low.reference, high.units) == (300.0, 420.0, "W84", "M")


def test_the_messages_of_the_script_are_those_of_mavlink(flown: Flown) -> None:
    script = read_document(flown.folder / "mavlink_script.json", "mavlink_script")
    link, log = mavlink.MAVLink(None), flown.exported.log
    seen: dict[str, list[mavlink.MAVLink_message]] = {}
    for told in script["messages"]:
        assert mavlink.enums["MAV_CMD"][told["command"]].name == told["name"]
        packed = mavlink.MAVLink_command_long_message(1, 1, told["command"], 0, *told["params"]).pack(link)
        (decoded,) = mavlink.MAVLink(None).parse_buffer(packed)
        seen.setdefault(told["name"], []).append((told, decoded))
    headings = seen["MAV_CMD_GUIDED_CHANGE_HEADING"]
    np.testing.assert_allclose([m.param2 for _, m in headings], log.heading, rtol=1e-6)
    assert {m.param1 for _, m in headings} == {mavlink.HEADING_TYPE_HEADING}
    winds = seen["MAV_CMD_EXTERNAL_WIND_ESTIMATE"]
    np.testing.assert_allclose([m.param1 for _, m in winds], log.wind_speed, rtol=1e-6)
    np.testing.assert_allclose([m.param3 for _, m in winds], log.wind_from, rtol=1e-6)
    assert all(0 < m.param2 < 10 and 0 < m.param4 < 90 for _, m in winds)
    speeds = seen["MAV_CMD_GUIDED_CHANGE_SPEED"]
    assert {m.param1 for _, m in speeds} == {mavlink.SPEED_TYPE_AIRSPEED}
    np.testing.assert_allclose([m.param2 for _, m in speeds], log.calibrated, rtol=1e-6)
    times = [datetime.fromisoformat(told["utc"]) for told, _ in headings]
    assert seconds_apart([*times, datetime.fromisoformat(log.utc[-1])], flown.exported) == 0


def test_the_prologue_of_the_script_is_that_of_mavlink(flown: Flown) -> None:
    script, log = read_document(flown.folder / "mavlink_script.json", "mavlink_script"), flown.exported.log
    origin, home, position = script["prologue"]
    place = (round(1e7 * log.lat[0]), round(1e7 * log.lon[0]))
    assert all((told["x"], told["y"]) == place for told in script["prologue"])
    assert origin["message"] == "SET_GPS_GLOBAL_ORIGIN"
    assert mavlink.MAVLink_set_gps_global_origin_message.fieldnames[1:4] == [
        "latitude",
        "longitude",
        "altitude",
    ]
    for told in (home, position):
        assert mavlink.enums["MAV_CMD"][told["command"]].name == told["name"]
    assert origin["fill_in"] == home["fill_in"] == ["z"]
    assert position["params"][2] >= 1.0
    assert "ArduPlane" in script["firmware"]


@pytest.mark.parametrize(
    "name", ["plan.kml", "plan.gpx", "plan.geojson", "mission.plan", "mavlink_script.json"]
)
def test_every_text_names_the_law_of_its_probabilities(flown: Flown, name: str) -> None:
    text = (flown.folder / name).read_text()
    assert "in coherent winds" in text
    assert "Not covered" in text


def test_the_start_is_where_the_scene_says(flown: Flown) -> None:
    lon, lat = Frame(flown.exported.crs).to_geographic(flown.result.scene.start)
    assert (flown.exported.log.lat[0], flown.exported.log.lon[0]) == (lat[0], lon[0])
