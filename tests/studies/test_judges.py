"""The forecast test on forecasts at places and on fields of the whole Earth, and its groups of missions."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from careful_io.times import HOUR, seconds
from forecast_winds import settings
from pareto_ltl.settings import Settings
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl.wind.area import GeoBox
from pareto_ltl.wind.named_laws import read_law
from pareto_ltl_apps.studies import forecast_test as study
from pareto_ltl_apps.studies import strata
from pareto_ltl_apps.studies.point_winds import LAW_FILE, PointWinds
from pareto_ltl_apps.studies.random_missions import situation_of
from pareto_ltl_apps.studies.settings import ForecastTestConfig
from pareto_ltl_apps.wind_errors.full_winds import full_winds
from wind_laws.error_law import LASTING
from wind_laws.law_of_parts import LawOfParts

START_HOUR = 420_000.0  # [h since 1970]
PLACES = np.array([[57.0, 12.0], [58.5, 14.0], [59.0, 17.5], [60.5, 15.5], [57.2, 16.5], [56.0, 14.2]])


def write_table(path: Path, worse: float = 0.0, runs: int = 30) -> Path:
    """Runs every 3 h with leads to 30 h; a forecast is wrong by ``worse`` [m/s] for each hour of lead."""
    starts, leads = START_HOUR + 3.0 * np.arange(runs), np.arange(31.0)
    valid = starts[:, None, None] + leads
    u = 4.0 + np.sin(valid / 20.0) + 0.3 * np.arange(len(PLACES))[:, None] + worse * leads
    np.savez(
        path,
        init_hours_since_1970=starts,
        lead_hours=leads,
        latlon=PLACES,
        uv=np.stack([u, 0.5 * u], axis=-1),
    )
    return path


def network(folder: Path, worse: float = 0.0, **changes: object) -> PointWinds:
    table = write_table(folder / "table.npz", worse)
    cfg = settings(
        truth=str(table), side=[200e3, 500e3], points=120, hours=10.0, delay=6.0, delay_most=18.0, **changes
    )
    known = study.known_of_files(cfg, cfg.forecast_test, folder)
    assert isinstance(known, PointWinds)
    known.prepare()
    return known


# --- forecasts at places ------------------------------------------------------------------------


def test_the_start_and_two_regions_lie_at_places_and_planning_knows_no_younger_run(tmp_path: Path) -> None:
    known = network(tmp_path)
    delays = []
    for number in range(8):
        task = known.task(number)
        scene = task.scene
        at = scene.frame.to_plane(*PLACES[:, ::-1].T)
        assert np.linalg.norm(at - scene.start, axis=1).min() < 1.0
        for name in ("a", "b"):
            middle = scene.regions[name][0].mean(axis=0)
            assert np.linalg.norm(at - middle, axis=1).min() < 0.11 * np.ptp(scene.bounds[:, 0])
        departure = seconds(str(scene.time_zero))
        readings = known.readings(task)
        assert (readings.times - readings.leads).max() <= departure - task.delay * HOUR
        assert (readings.times - readings.leads).max() > departure - (task.delay + 3) * HOUR
        assert readings.times[-1] >= departure + 10 * HOUR
        delays.append(task.delay)
        assert 0 <= departure - seconds(task.situation + "T00:00:00Z") < 48 * HOUR
    assert 6.0 <= min(delays) < max(delays) <= 18.0
    assert known.truth.leads.max() <= 12 * HOUR


def test_plans_promise_under_the_law_without_what_newer_runs_cannot_show(tmp_path: Path) -> None:
    known = network(tmp_path)
    law = read_law(tmp_path / LAW_FILE)
    assert isinstance(law, LawOfParts)
    assert law.part(LASTING) is None
    assert law.parts
    task = known.task(0)
    run = known.run_of(task, study.mission_settings(known.settings, known.cfg, task, known.settings.fidelity))
    assert run.settings.wind.forecast_error == str(tmp_path / LAW_FILE)


def test_right_forecasts_keep_the_promise_and_wrong_ones_break_it(tmp_path: Path) -> None:
    outcomes = {}
    for name, worse in (("right", 0.0), ("wrong", 0.6)):
        folder = tmp_path / name
        folder.mkdir()
        result = study.mission_part(network(folder, worse), 1)
        (outcomes[name],) = result["plans"]
    right, wrong = outcomes["right"], outcomes["wrong"]
    assert right["failure"] <= right["promised"]["simulated_coherent"] + 0.05
    assert wrong["failure"] > 0.9
    assert right["miss_m"] < right["sd_m"] < wrong["miss_m"]


@pytest.mark.parametrize(
    ("changes", "hours"),
    [
        ({"delay": 6.0, "known": "departure"}, 6.0),
        ({"delay": 6.0, "delay_most": 18.0, "known": "departure"}, 18.0),
        ({"delay": 6.0, "delay_most": 18.0, "known": "all"}, 0.0),
    ],
)
def test_a_departure_waits_for_the_latest_forecast_that_can_be_known(
    changes: dict[str, Any], hours: float
) -> None:
    assert ForecastTestConfig(**changes).wait == hours


def test_a_table_without_positions_or_for_interpolation_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"table of forecasts at places, which tests forecasts only"):
        network(tmp_path, known="all")
    np.savez(
        tmp_path / "bare.npz", init_hours_since_1970=[0.0], lead_hours=[0.0, 6.0], uv=np.zeros((1, 6, 2, 2))
    )
    cfg = settings(truth=str(tmp_path / "bare.npz"))
    with pytest.raises(DataError, match=r"needs forecasts at 5 places or more, with latitude and longitude"):
        study.known_of_files(cfg, cfg.forecast_test, tmp_path)
    with pytest.raises(ConfigError, match=r"delay_most must be at least delay = 6"):
        Settings(forecast_test=ForecastTestConfig(delay=6.0, delay_most=3.0))


# --- fields of the whole Earth ------------------------------------------------------------------


def write_fields(path: Path) -> Path:
    lat, lon = np.arange(-90.0, 91.0, 10.0), np.arange(0.0, 360.0, 10.0)
    hours = START_HOUR + 6.0 * np.arange(6)
    u = hours[:, None, None] - START_HOUR + 0.0 * lat[:, None] + 0.01 * lon
    uv = np.round(np.stack([u, -u], axis=1) / 0.01).astype(np.int16)
    uv[2, :, 3, 4] = -32768
    np.savez(path, hours_since_1970=hours, lat=lat, lon=lon, uv_int16=uv, scale=0.01, missing=-32768)
    return path


def test_a_table_of_fields_is_read_as_analyses_without_its_gaps(tmp_path: Path) -> None:
    full = full_winds((write_fields(tmp_path / "earth.npz"),), settings().wind, GeoBox(0, 0, 1, 1))
    assert [snap.lead for snap in full.winds] == [0.0] * 6
    assert [len(snap.points) for snap in full.winds] == [684, 684, 683, 684, 684, 684]
    last = full.winds[-1]
    at = int(np.flatnonzero((last.points == [-10.0, 40.0]).all(axis=1))[0])  # 350 E is 10 W
    np.testing.assert_allclose(last.winds[at], [33.5, -33.5])
    assert full.places is None


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"uv_int16": np.zeros((6, 2, 3, 4), np.int16)}, r"winds have the shape \(6, 2, 3, 4\); expected"),
        ({"hours_since_1970": np.zeros(6)}, r"each time once"),
        ({"scale": 100.0}, r"wind speed .* m/s is not plausible"),
    ],
)
def test_a_damaged_table_of_fields_is_one_message(
    tmp_path: Path, change: dict[str, object], message: str
) -> None:
    path = write_fields(tmp_path / "earth.npz")
    with np.load(path) as file:
        arrays = dict(file)
    np.savez(path, **(arrays | change))  # type: ignore[arg-type]
    with pytest.raises(DataError, match=message):
        full_winds((path,), settings().wind, GeoBox(0, 0, 1, 1))


def test_one_map_is_moved_over_the_earth_in_the_same_kilometres(tmp_path: Path) -> None:
    cfg = settings(
        truth=str(write_fields(tmp_path / "earth.npz")), same_map=True, situations="boxes", points=None,
        area=[[-180, -60], [180, -60], [180, 60], [-180, 60]], hours=6.0, delay=0.0,
    )  # fmt: skip
    known = study.known_of_files(cfg, cfg.forecast_test, tmp_path)
    tasks = [known.task(number) for number in range(12)]
    for task in tasks[1:]:
        np.testing.assert_array_equal(task.scene.regions["a"][0], tasks[0].scene.regions["a"][0])
        np.testing.assert_array_equal(task.scene.start, tasks[0].scene.start)
        assert task.formula == tasks[0].formula
    assert len({task.scene.crs for task in tasks}) == len(tasks)
    assert len({task.situation for task in tasks}) > 6


def test_situations_are_periods_days_or_boxes_in_them() -> None:
    cfg = settings().forecast_test
    spell = type("Spell", (), {"name": "20181009T00"})()
    departure = seconds("2018-10-10T05:00:00Z")
    named = {
        kind: situation_of(replace(cfg, situations=kind), spell, departure, -100.0, 47.0)
        for kind in ("auto", "period", "days", "boxes")
    }
    assert named["auto"] == named["period"] == "20181009T00"
    assert named["boxes"] == f"{named['days']} +36 -120"
    assert 0 <= departure - seconds(named["days"] + "T00:00:00Z") < 48 * HOUR


# --- groups -------------------------------------------------------------------------------------


def test_missions_are_on_land_on_sea_or_at_the_coast() -> None:
    places = {"land": (25.0, 52.0), "sea": (-150.0, 0.0), "coast": (-9.0, 39.0)}
    assert {name: strata.surface_of(*place, 3e5) for name, place in places.items()} == {
        name: name for name in places
    }
    assert (
        0.28
        < (strata.land_cells() * np.cos(np.deg2rad(np.arange(-89.5, 90)))[:, None]).sum()
        / (360 * np.cos(np.deg2rad(np.arange(-89.5, 90))).sum())
        < 0.31
    )  # the land of the Earth is 29 %


def test_regions_are_longitudes_in_america_and_latitudes_elsewhere() -> None:
    cfg = ForecastTestConfig()
    assert strata.region_of(cfg, -100.0, 40.0) == "105 to 90 W"
    assert strata.region_of(cfg, 15.0, 60.0) == "50 to 90 degrees"  # a table of places elsewhere
    world = replace(cfg, area=[[-180, -60], [180, -60], [180, 60], [-180, 60]])
    assert strata.region_of(world, -100.0, -40.0) == "25 to 50 degrees"
    assert strata.region_order("105 to 90 W") < strata.region_order("25 to 50 degrees")


def test_the_level_of_a_promise_is_the_nearest_one() -> None:
    named = [strata.level_of(p) for p in (0.0, 0.0057, 0.006, 0.0174, 0.05, 0.055, 0.2, 0.5, 0.53, 1.0)]
    assert named == [
        "below 0.6 %", "below 0.6 %", "1 %", "3 %", "3 %", "10 %", "30 %", "30 %", "above 52 %", "above 52 %",
    ]  # fmt: skip


def test_conformal_limits_hold_the_next_mission_as_often_as_they_say() -> None:
    """Whatever the distribution of z: by exchangeability, tested with one of heavy tails."""
    rng = np.random.default_rng(4)
    held, rounds, n = np.zeros(len(strata.LIMITS)), 2000, 19
    for _ in range(rounds):
        z = rng.standard_t(2, n + 1) ** 2
        rows = [
            {
                "fidelity": "full",
                "mission": k,
                "situation": f"s{k}",
                "miss_m": z[k],
                "sd_m": 1.0,
                "spread_m": 0.0,
            }
            for k in range(n)
        ]
        limits = np.array([card["limit"] for card in strata.limit_table(rows)])
        held += z[n] <= limits
    shares = held / rounds
    assert (shares >= np.array(strata.LIMITS) - 5 * np.sqrt(0.25 / rounds)).all()
    np.testing.assert_allclose(shares[:4], strata.LIMITS[:4], atol=5 * np.sqrt(0.25 / rounds))
    assert shares[4] == 1.0  # of 19 situations there is no limit of 99 %


def test_a_second_mission_of_a_situation_does_not_count_in_limits() -> None:
    row = {"fidelity": "full", "situation": "s", "sd_m": 5.0, "spread_m": 3.0}
    cards = strata.limit_table([row | {"mission": 1, "miss_m": 99.0}, row | {"mission": 0, "miss_m": 8.0}])
    assert cards[0] == {
        "fidelity": "full",
        "share": 0.5,
        "situations": 1,
        "limit": 2.0,
        "law": cards[0]["law"],
    }
