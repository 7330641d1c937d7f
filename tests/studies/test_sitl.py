"""JSBSim's aircraft flies the exported table: where geometry says, in our winds, near our steps."""

from __future__ import annotations

import csv
import json
import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.random import SeedSequence
from pyproj import Geod

from flight_quantities.atmosphere import standard_air, true_airspeed
from pareto_ltl.extend import Frame
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.records import Plan
from pareto_ltl.run.plan_run import Run
from pareto_ltl.run.results import planned_run
from pareto_ltl.settings import Settings
from pareto_ltl.simulation.flights import draw_block, fly_block, pilot_maker
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl_apps.cli.commands import run_command_line
from pareto_ltl_apps.studies import sitl
from pareto_ltl_apps.studies.aircraft import Orders, fly_orders, read_orders
from pareto_ltl_apps.studies.settings import SitlConfig
from quick_wind import wind_words

FLIGHTS = 2
RATE = 60.0
SMALL = (
    "+experiment=hop", "fidelity=paper", "selection=priority", "planner.trees=2", "planner.n_max=600",
    "exports.flights=200", f"sitl.flights={FLIGHTS}", "sitl.drawn=2", "report.formats=[png]", *wind_words(),
)  # fmt: skip


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small plan, and two flights of its table."""
    place = tmp_path_factory.mktemp("sitl") / "run"
    assert run_command_line(["sitl", *SMALL, f"hydra.run.dir={place}"]) == 0
    return place


@pytest.fixture(scope="module")
def planned(flown: Path) -> tuple[Problem, Plan]:
    run = planned_run(flown)
    return run.problem, run.plan


def legs(*rows: tuple[float, float, float]) -> Orders:
    """Orders from 37 N, 92 W: (heading [deg], airspeed [m/s], duration [s]) of each leg."""
    heading, airspeed, duration = np.array(rows).T
    return Orders(heading, airspeed, duration, np.array([37.0, -92.0]))


# --- the aircraft ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("wind", "height"), [((0.0, 0.0), 10.0), ((8.0, -6.0), 800.0), ((8.0, -6.0), 1600.0)]
)
def test_a_straight_flight_ends_where_airspeed_and_wind_lead(
    wind: tuple[float, float], height: float
) -> None:
    """Within 1.5 % of 15 km in five minutes: what heading, airspeed and height hold leave.

    The aircraft holds a calibrated airspeed; JSBSim's atmosphere makes the true one of it, and so does ours,
    to 0.7 %: its pitot tube points along the fuselage, some degrees above the flow.
    """
    orders = legs((60.0, 50.0, 300.0))
    track = fly_orders(orders, lambda t, lat, lon: wind, height, RATE)
    true = true_airspeed(50.0, standard_air(height).density_ratio)
    over_ground = true * np.array([np.sin(np.pi / 3), np.cos(np.pi / 3)]) + wind
    geod = Geod(ellps="WGS84")
    bearing, distance = np.degrees(np.arctan2(*over_ground)), 300.0 * np.hypot(*over_ground)
    lon, lat, _ = geod.fwd(-92.0, 37.0, bearing, distance)
    _, _, apart = geod.inv(lon, lat, track.lon[-1], track.lat[-1])
    assert apart < 0.015 * 300.0 * true
    _, _, begun = geod.inv(-92.0, 37.0, track.lon[0], track.lat[0])
    assert begun < 20.0  # it came past the start, settled
    assert track.airspeed == pytest.approx([50.0], abs=0.5)
    assert track.true / track.airspeed == pytest.approx([true / 50.0], rel=7e-3)
    assert track.climb < 60.0


def test_the_aircraft_holds_its_height_from_its_start_and_in_a_turn() -> None:
    """It begins trimmed; the autopilot alone climbs by hundreds of metres before it finds the elevator."""
    orders = legs((60.0, 50.8, 120.0), (60.0, 50.8, 120.0), (210.0, 50.8, 120.0), (210.0, 47.0, 120.0))
    track = fly_orders(orders, lambda t, lat, lon: (0.0, 0.0), 1600.0, 30.0)
    assert track.climb < 60.0
    assert track.airspeed[[0, 1, 3]] == pytest.approx(orders.airspeed[[0, 1, 3]], abs=1.0)


def test_a_turn_costs_what_a_bank_allows_and_flights_repeat(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A turn of 150 degrees at 30 degrees of bank: between one and four radii off a turn on the spot."""
    monkeypatch.chdir(tmp_path)
    orders = legs((0.0, 50.0, 60.0), (150.0, 50.0, 120.0))
    one, other = (fly_orders(orders, lambda t, lat, lon: (0.0, 0.0), 800.0, RATE) for _ in range(2))
    assert list(tmp_path.iterdir()) == []  # no table of JSBSim's own
    assert one.lat.tobytes() == other.lat.tobytes()
    assert one.lon.tobytes() == other.lon.tobytes()
    true = true_airspeed(50.0, standard_air(800.0).density_ratio)
    geod, radius = Geod(ellps="WGS84"), true**2 / (9.81 * np.tan(np.radians(30.0)))
    lon, lat, _ = geod.fwd(-92.0, 37.0, 0.0, 60.0 * true)
    lon, lat, _ = geod.fwd(lon, lat, 150.0, 120.0 * true)
    assert radius < geod.inv(lon, lat, one.lon[-1], one.lat[-1])[2] < 4.5 * radius


# --- the winds ------------------------------------------------------------------------------------


@pytest.mark.parametrize("law", ["independent", "coherent"])
def test_the_aircraft_meets_the_wind_of_our_flight(planned: tuple[Problem, Plan], law: str) -> None:
    """Where ours is, its wind is what moved it: x' = x + dt (u + w)."""
    problem, plan = planned
    u, dt = plan.path.u, problem.motion.dt
    block = draw_block(problem, law, 3, len(u), SeedSequence(1))
    block.errors[...] = 0.0  # so that the robot flies u itself
    x = np.empty((3, len(u) + 1, 2))
    fly_block(problem, block, pilot_maker(problem, u, plan.path.x, law), x)
    crs = str(problem.scene.crs)
    for i in range(3):
        air = sitl.flight_air(problem, block.draws, i, len(u))
        for t in (0, len(u) // 2, len(u) - 1):
            lon, lat = Frame(crs).to_geographic(x[i, t][None])
            east, north = air((t + 0.5) * dt, float(lat[0]), float(lon[0]))
            turn = float(Frame(crs).convergence(lon, lat)[0])
            back = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) @ [east, north]
            np.testing.assert_allclose(back, (x[i, t + 1] - x[i, t]) / dt - u[t], atol=1e-4)


# --- the study ------------------------------------------------------------------------------------


def test_the_aircraft_stays_near_our_steps(flown: Path) -> None:
    """A bend costs a Cessna a few of its turn radii, 0.5 km; the rest of a hundred kilometres agrees."""
    with (flown / "sitl.csv").open() as file:
        rows = list(csv.DictReader(file))
    told = json.loads((flown / "metrics.json").read_text())
    assert [int(row["flight"]) for row in rows] == list(range(FLIGHTS))
    assert told["sitl_flights"] == FLIGHTS
    assert told["sitl_failure"] == sum(int(row["failed"]) for row in rows) / FLIGHTS
    assert told["sitl_steps_failure"] == sum(int(row["failed_steps"]) for row in rows) / FLIGHTS
    assert max(float(row["apart_most_m"]) for row in rows) < 5000.0
    assert told["sitl_apart_median_m"] < 3000.0
    assert abs(told["sitl_airspeed_error"]) < 0.5
    assert told["sitl_height_error_m"] < 150.0
    assert (flown / "figures" / "sitl.png").stat().st_size > 10_000
    assert "flights in the same independent winds" in (flown / "tables.md").read_text()
    assert len(read_orders(flown / "dead_reckoning.csv").heading) == told["steps"]


def test_what_cannot_be_flown_is_one_line(
    planned: tuple[Problem, Plan], flown: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem, plan = planned
    table = flown / "dead_reckoning.csv"

    def refused(kind: type[Exception], text: str) -> None:
        run = Run(Settings(sitl=SitlConfig(flights=1)), {"problem": problem, "plan": plan})
        with pytest.raises(kind, match=text) as caught:
            sitl.run_sitl(run.settings, run, tmp_path)
        assert "\n" not in str(caught.value)

    refused(DataError, "was not exported as dead_reckoning.csv")
    bad = tmp_path / "dead_reckoning.csv"
    for content in ("", "leg,lat_deg\n0,37\n", table.read_text().splitlines()[0] + "\n"):
        bad.write_text(content)
        refused(DataError, "is not a dead-reckoning table")
    slow = table.read_text().splitlines()
    column = slow[0].split(",").index("airspeed_cas_m_s")
    cells = slow[1].split(",")
    cells[column] = "9.0"  # far below its stall
    bad.write_text("\n".join([slow[0], ",".join(cells), slow[-1]]) + "\n")
    refused(DataError, r"level flight at 9 m/s: plan for its airspeeds, e\.g\. robot=light_aircraft")
    bad.write_bytes(table.read_bytes())
    monkeypatch.setitem(sys.modules, "jsbsim", None)
    refused(ConfigError, r'needs jsbsim: .*pip install "pareto-ltl\[sim\]"')
