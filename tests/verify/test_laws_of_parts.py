"""Plans in winds whose forecast errors are a sum of parts with tails pass the judge, in many fields."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.random import SeedSequence

import pareto_ltl
from careful_io.files import write_json
from lies.editing import holds, in_wind
from pareto_ltl.extend import simulate_flights
from pareto_ltl.wind.named_laws import law_of_parts_named
from pareto_ltl_verify.evidence import open_evidence
from pareto_ltl_verify.flights import RARE, fly, same_distribution
from pareto_ltl_verify.judge import Finding, verify
from pareto_ltl_verify.tails import drawn_scales, scaled_field
from pareto_ltl_verify.wind_tables import ENSEMBLE, FORECAST, HELD, LASTING, LOCAL, OF_FORECASTS, SLOW, TIME
from small_plans import COMMON
from wind_files import U10, V10, grib_message
from wind_laws.tails import draw_scales

LON, LAT = np.arange(-125.0, -60.0, 2.5), np.arange(22.5, 52.5, 2.5)
GRID = {
    "Ni": len(LON), "Nj": len(LAT), "jScansPositively": 1,
    "latitudeOfFirstGridPointInDegrees": LAT[0], "latitudeOfLastGridPointInDegrees": LAT[-1],
    "longitudeOfFirstGridPointInDegrees": LON[0] % 360, "longitudeOfLastGridPointInDegrees": LON[-1] % 360,
    "iDirectionIncrementInDegrees": 2.5, "jDirectionIncrementInDegrees": 2.5,
}  # fmt: skip
DEPARTURE, AGE = "2018-10-09T00:00:00Z", 72  # [h] lead of the forecast at departure
LAW, EXPECTED = "wind: law of forecast errors", "replan: expected wind given the fixes"
OLD_LAW = "replan: law of forecast errors"
MANY = 20_000


def forecast(place: Path, hours: int, member: int = 0, centre: str = "kwbc") -> Path:
    """A GRIB file of light winds every 6 h, of one member of the model of a centre."""
    place.mkdir(parents=True)
    lon, lat = np.meshgrid(np.deg2rad(LON), np.deg2rad(LAT))
    raw = []
    for hour in range(0, hours + 1, 6):
        phase = 0.05 * hour + 0.3 * member
        u, v = 2.0 * np.sin(6 * lat + phase), 1.5 * np.cos(5 * lon - phase) + 0.4 * np.sin(9 * lat)
        for values, what in ((u, U10), (v, V10)):
            run = {"dataDate": 20181006, "dataTime": 0, "centre": centre}
            raw.append(grib_message(values, what, AGE + hour, **run, **GRID))
    (place / "wind.grib2").write_bytes(b"".join(raw))
    return place / "wind.grib2"


def planned(place: Path, wind: dict[str, Any]) -> pareto_ltl.Run:
    """A small plan with its flights, in ``place``."""
    small = {"deployment": {"runs": 300}, "selection": {"draws": 20, "runs": 300}}
    mission = {"formula": "F a", "start_time": DEPARTURE}
    wind = {**COMMON["wind"], "modes_max": 64, "hold_last": True} | wind
    return pareto_ltl.plan("phi1", mission, **COMMON | small | {"wind": wind, "out": place})


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[pareto_ltl.Run, Path]:
    """A plan in a forecast, whose last field is held for the second half of the flight."""
    pytest.importorskip("eccodes")
    place = tmp_path_factory.mktemp("made")
    path = forecast(place / "winds", 6)
    return planned(place / "plan", {"source": "grib", "path": str(path)}), place / "plan"


def wrong(place: Path) -> list[Finding]:
    """The claims of a result that fail."""
    return [finding for finding in verify(place) if not finding.holds]


def parts(place: Path) -> set[int]:
    """The parts of the error that have modes."""
    return set(open_evidence(place).wind.modes.part.tolist()) - {-1}


# --- all claims -------------------------------------------------------------------------------


def test_all_claims_of_a_plan_under_a_law_of_parts_hold(made: tuple[pareto_ltl.Run, Path]) -> None:
    found = verify(made[1])
    assert [finding for finding in found if not finding.holds] == []
    named = {finding.claim for finding in found}
    assert {
        LAW,
        *(f"wind: modes of {name} part of the forecast" for name in ("lasting", "slow", "local")),
    } <= named
    assert {LASTING, SLOW} < parts(made[1])
    assert FORECAST not in parts(made[1])
    assert open_evidence(made[1]).wind.error.name == "gfs"


@pytest.mark.parametrize("late", [False, True])
def test_all_claims_of_a_plan_after_a_fix_hold(
    late: bool, made: tuple[pareto_ltl.Run, Path], tmp_path: Path
) -> None:
    """``late``: after the last field, from which on the change since then is a part of the error."""
    run, place = made
    dt, x = run.plan.dt, run.plan.path.x
    step = min(int(6 * 3600 / dt) + 1, len(x) - 3) if late else 2
    (lon,), (lat,) = run.scene.frame.to_geographic(x[step] + np.array([9000.0, -5000.0]))
    pareto_ltl.replan(place, step * dt, (lat, lon, 2000.0), out=tmp_path / "rest")
    found = verify(tmp_path / "rest")
    assert [finding for finding in found if not finding.holds] == []
    assert {EXPECTED, OLD_LAW} <= {finding.claim for finding in found}
    assert (HELD in parts(tmp_path / "rest")) == late
    assert {LASTING, SLOW} < parts(tmp_path / "rest")
    in_wind(_longer)(tmp_path / "rest")
    assert not holds(tmp_path / "rest", OLD_LAW)


def _longer(file: Any) -> None:
    """Memories in wind.nc that are ten times as long."""
    law = json.loads(file.attrs["forecast_error"])
    for part in law["parts"]:
        part["memory_hours"] = [hours and 10.0 * hours for hours in part["memory_hours"]]
    file.attrs["forecast_error"] = json.dumps(law)


def _other_winds(name: str, factor: float) -> Any:
    """Another spread or latitude in wind.nc, and the change of the wind that follows from it."""

    def edit(file: Any) -> None:
        law = json.loads(file.attrs["forecast_error"])
        stated, rule = law["variability"], law["change"]["winds"]
        was = stated[name]
        stated[name] = factor * was
        power = factor ** rule["power"] if name == "spread" else np.exp(rule["slope"] * (factor - 1.0) * was)
        stated["factor"] *= power
        law["change"]["sd"] = [np.sqrt(power) * value for value in law["change"]["sd"]]
        file.attrs["forecast_error"] = json.dumps(law)

    return in_wind(edit)


@pytest.mark.parametrize(("name", "factor"), [("spread", 0.8), ("latitude", 0.5)])
def test_another_spread_or_latitude_with_a_change_that_follows_is_found(
    name: str, factor: float, made: tuple[pareto_ltl.Run, Path], tmp_path: Path
) -> None:
    shutil.copytree(made[1], tmp_path / "plan")
    _other_winds(name, factor)(tmp_path / "plan")
    assert not holds(tmp_path / "plan", "wind: variability of the wind")


@pytest.mark.parametrize("name", ["gfs_one_part", "file"])
def test_all_claims_under_other_laws_hold(
    name: str, made: tuple[pareto_ltl.Run, Path], tmp_path: Path
) -> None:
    """A law of the first version; a law in a file, of another level, with a local part that is wide."""
    law = law_of_parts_named("icon_eu")
    wide = tuple(replace(part, length=3e5) if part.name == "local" else part for part in law.parts)
    write_json(tmp_path / "law.json", replace(law, name="wide", level="80m", parts=wide).document())
    path = made[1].parent / "winds" / "wind.grib2"
    law_name = str(tmp_path / "law.json") if name == "file" else name
    planned(tmp_path / "plan", {"source": "grib", "path": str(path), "forecast_error": law_name})
    assert wrong(tmp_path / "plan") == []
    assert (FORECAST if name != "file" else LOCAL) in parts(tmp_path / "plan")


def test_all_claims_of_a_plan_in_an_ensemble_hold(tmp_path: Path) -> None:
    """The law of their centre has the share of the variance that few members leave."""
    pytest.importorskip("eccodes")
    for member in range(4):
        forecast(tmp_path / "members" / f"m{member}", 12, member, "ecmf")
    planned(tmp_path / "plan", {"source": "ensemble", "path": str(tmp_path / "members")})
    assert wrong(tmp_path / "plan") == []
    assert {ENSEMBLE, LASTING} < parts(tmp_path / "plan")
    law = open_evidence(tmp_path / "plan").wind.error
    whole = law_of_parts_named("ecmwf_class").forecast_variance(np.array([3600.0 * AGE]))
    assert law.forecast_variance(np.array([3600.0 * AGE])) == pytest.approx(whole * 10 / 13, rel=1e-6)


# --- tails ------------------------------------------------------------------------------------


def test_the_judge_draws_the_scales_of_the_planner(made: tuple[pareto_ltl.Run, Path]) -> None:
    """Means and covariances of the logarithms in the slots, and their values in the law."""
    run, place = made
    law, tail = open_evidence(place).law("coherent"), run.problem.tail
    own = drawn_scales(law, 100_000, np.random.default_rng(5))
    slots = list(own.forecasts)
    assert len(slots) == 2
    stated = law.wind.error.tail
    moments = np.interp(law.wind.leads[slots], stated.leads, stated.moment)
    apart = np.abs(np.subtract.outer(law.wind.times[slots], law.wind.times[slots]))
    cov = stated.flight**2 + np.outer(moments, moments) * np.exp(-apart / stated.memory)
    epochs = len(tail.moment)
    planner = draw_scales(tail, epochs, 100_000, np.random.default_rng(6))
    rows = [int(np.flatnonzero(run.problem.modes.slot == k)[0]) for k in slots]
    for scales in (
        np.array([own.forecasts[k] for k in slots]),
        planner.forecasts[run.problem.modes.epoch[rows]],
    ):
        logs = np.log(scales)
        np.testing.assert_allclose(np.cov(logs), cov, atol=0.01)
        np.testing.assert_allclose(logs.mean(axis=1), -np.diag(cov), atol=0.015)
        np.testing.assert_allclose((scales**2).mean(axis=1), 1.0, atol=0.06)
    rule = law.wind.error.of_winds
    drawn = np.random.default_rng(7).chisquare(rule.freedom + 2.0, 100_000)
    for scale in (own.change, planner.change):
        assert np.log(scale).std() == pytest.approx(np.std(0.5 * np.log(drawn)), rel=0.03)
        assert np.mean(scale**2) == pytest.approx(1.0, abs=0.03)


def test_the_judge_flies_in_the_tails_of_the_planner(made: tuple[pareto_ltl.Run, Path]) -> None:
    """Positions of the planner's flights agree with those of the judge, and not with Gaussian ones.

    The scale spreads more than in the law, so that many flights are not necessary.
    """
    run, place = made
    result, path = open_evidence(place), run.plan.path
    law, problem = result.law("coherent"), run.problem
    problem = replace(problem, tail=problem.tail._replace(flight=1.1))
    error = law.wind.error
    wide = replace(law.wind, error=replace(error, tail=replace(error.tail, flight=1.1)))
    flown = simulate_flights(problem, path.u, MANY, "coherent", SeedSequence(3), path.x).x[:, -1:]
    own = fly(replace(law, wind=wide), path.x, path.u, MANY, np.random.default_rng(4))[:, -1:]
    assert same_distribution(own, flown, result.grain) >= RARE
    plain = replace(law, wind=replace(law.wind, error=replace(error, tail=None)))
    gaussian = fly(plain, path.x, path.u, MANY, np.random.default_rng(4))[:, -1:]
    assert same_distribution(gaussian, flown, result.grain) < RARE


def test_only_forecasts_and_changes_in_time_have_tails(made: tuple[pareto_ltl.Run, Path]) -> None:
    law = open_evidence(made[1]).law("coherent")
    scales = drawn_scales(law, 9, np.random.default_rng(1))
    found = scaled_field(law, 0, np.ones((9, law.coefficients)), scales)
    parts = np.concatenate([np.tile(law.wind.modes.part, 2), np.full(len(law.errors), -1)])
    ours, changes = np.isin(parts, list(OF_FORECASTS.values())), parts == TIME
    np.testing.assert_array_equal(found[:, ours], np.tile(scales.forecasts[0][:, None], (1, ours.sum())))
    np.testing.assert_array_equal(found[:, changes], np.tile(scales.change[:, None], (1, changes.sum())))
    np.testing.assert_array_equal(found[:, ~(ours | changes)], 1.0)
    assert 0 < ours.sum() < law.modes < law.coefficients
