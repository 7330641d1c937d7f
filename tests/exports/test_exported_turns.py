"""Files of an aircraft that banks: orders with the turn in them, one set of places and times in all files."""

from __future__ import annotations

import csv
import json
import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.random import SeedSequence

from exported_plans import EXPORTS, Flown, metres_apart, seconds_apart, settings_named
from pareto_ltl.planning.turns import BankedTurns
from pareto_ltl_apps.exports.exported import exported_plan
from pareto_ltl_apps.exports.formats import write_exports

AIRSHIP = BankedTurns(math.radians(2.0), 60.0)  # slow enough for turns that show in legs of half an hour


@pytest.fixture(scope="module")
def turning(flown: Flown, tmp_path_factory: pytest.TempPathFactory) -> Flown:
    problem = replace(flown.problem, turns=AIRSHIP)
    plan = flown.exported.plan
    exported = exported_plan(settings_named("turning"), problem, plan, SeedSequence(5))
    folder = tmp_path_factory.mktemp("turning")
    write_exports(exported, EXPORTS.formats, folder)
    return Flown(flown.result, exported, folder)


def test_positions_stay_and_legs_last_longer_by_their_turns(flown: Flown, turning: Flown) -> None:
    spot, banked = flown.exported.log, turning.exported.log
    np.testing.assert_allclose(banked.x, spot.x, atol=1e-2)
    assert (banked.t >= spot.t - 1e-6).all()
    assert banked.late == pytest.approx(banked.t[-1] - spot.t[-1])
    assert banked.late > 60.0
    np.testing.assert_allclose(banked.airspeed, spot.airspeed)


def test_all_files_have_the_same_places_and_times(turning: Flown) -> None:
    import gpxpy
    import xarray

    points = gpxpy.parse((turning.folder / "plan.gpx").read_text()).routes[0].points
    exported = turning.exported
    assert metres_apart([p.latitude for p in points], [p.longitude for p in points], exported) < 0.01
    assert seconds_apart([p.time for p in points], exported) < 1e-3
    places = [f for f in turning.json("plan.geojson")["features"] if f["properties"]["role"] == "position"]
    lon, lat = np.array([f["geometry"]["coordinates"][:2] for f in places]).T
    assert metres_apart(lat, lon, exported) < 0.01
    with xarray.open_dataset(turning.folder / "trajectory.nc", decode_times=False) as file:
        np.testing.assert_allclose(file["time"].to_numpy(), exported.log.t - exported.log.t[0])
    with (turning.folder / "dead_reckoning.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["t_s"]) for row in rows] == exported.log.t.tolist()


def test_the_script_turns_at_the_bank_of_the_aircraft(flown: Flown, turning: Flown) -> None:
    def accelerations(case: Flown) -> set[float]:
        sent = case.json("mavlink_script.json")["messages"]
        return {m["params"][2] for m in sent if m["name"] == "MAV_CMD_GUIDED_CHANGE_HEADING"}

    (acceleration,) = accelerations(turning)
    assert acceleration == pytest.approx(9.80665 * math.tan(math.radians(2.0)))
    assert accelerations(flown) == {5.0}


def test_the_files_say_what_turns_take(flown: Flown, turning: Flown) -> None:
    told = json.dumps(turning.json("plan.geojson"))
    assert f"Turns take {turning.exported.log.late:.0f} s" in told
    assert "Turns take" not in json.dumps(flown.json("plan.geojson"))
