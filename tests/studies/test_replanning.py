"""A plan flown with and without new plans at fixes: same winds, and only safer plans are taken."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.random import SeedSequence

from coherent import LOOSE, SCENE
from pareto_ltl.extend import draw_flights
from pareto_ltl.settings import RobotConfig
from pareto_ltl_apps.cli.commands import run_command_line
from pareto_ltl_apps.studies.replanning import newer_forecast
from problems import QUICK_ERROR, make_problem, smooth_wind
from quick_wind import wind_words
from wind_laws.records import FORECAST

SMALL = (
    "+experiment=phi2", "planner.trees=3", "planner.n_max=1000", "selection.draws=300", "selection.runs=500",
    "refine.flights=100", "refine.sweep_flights=60", "refine.points=4", "evaluation.jobs=1",
    "deployment.runs=50", "exports=none", *wind_words(),
)  # fmt: skip

LEAST = (  # where only the names of the ways and equal plans are compared
    "+experiment=phi1_landmarks", "planner.trees=2", "planner.n_max=1000", "selection.draws=100",
    "selection.runs=200", "refine.flights=40", "refine.sweep_flights=20", "refine.classes=1",
    "refine.points=2", "evaluation.jobs=1", "deployment.runs=20", "report=none",
    "exports=none", *wind_words(),
)  # fmt: skip


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("replanning") / "run"
    words = ("replanning", *SMALL, "replanning.flights=2", "replanning.fixes=[1,2]")
    assert run_command_line([*words, f"hydra.run.dir={folder}"]) == 0
    return folder


def test_every_way_is_told_flight_by_flight(place: Path) -> None:
    with (place / "replanning_flights.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(row["flight"], row["way"]) for row in rows] == [
        (flight, way)
        for way in ("as planned", "position always known", "1 fix", "2 fixes")
        for flight in "01"
    ]
    assert all(row["failed"] in "01" for row in rows)
    assert all(int(row["new_plans"]) <= ("fix" in row["way"]) * 2 for row in rows)
    with (place / "replanning.csv").open(newline="") as file:
        found = list(csv.DictReader(file))
    for k, row in enumerate(found):
        assert float(row["failure"]) == sum(int(r["failed"]) for r in rows[2 * k : 2 * k + 2]) / 2
        assert float(row["difference_low"]) <= float(row["difference"]) <= float(row["difference_high"])
    assert "true winds" in (place / "tables.md").read_text(encoding="utf-8")
    assert (place / "figures" / "replanning.png").is_file()


def test_on_a_map_with_landmarks_the_plan_made_without_them_is_flown_too(tmp_path: Path) -> None:
    words = ("replanning", *LEAST, "replanning.flights=1", "replanning.fixes=[1]")
    assert run_command_line([*words, f"hydra.run.dir={tmp_path}"]) == 0
    with (tmp_path / "replanning.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    names = [row["way"] for row in rows]
    assert names[:4] == ["no fixes", "fixes by chance", "as planned", "position always known"]
    bare, chance, aware, known = (float(row["length_m"]) for row in rows[:4])
    assert bare == chance  # one plan
    assert aware == known
    assert aware != bare
    assert float(rows[0]["difference"]) == 0.0
    with (tmp_path / "replanning_flights.csv").open(newline="") as file:
        flights = [row for row in csv.DictReader(file) if row["way"] in ("no fixes", "fixes by chance")]
    assert len(flights) == 2


def test_newer_forecasts_of_a_field_without_forecast_errors_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("replanning", *SMALL, "replanning.flights=1", "replanning.forecasts=6")
    assert run_command_line([*words, f"hydra.run.dir={tmp_path}"]) == 2
    assert "not a forecast with known leads" in capsys.readouterr().err


def test_a_newer_forecast_has_the_error_of_its_lead_and_tends_to_the_truth() -> None:
    """Over many flights the error of the new mean, given the true field, has the variance of its modes."""
    error = replace(QUICK_ERROR, forecast_sd=np.array([0.0, 0.7]), leads=np.array([0.0, 3600.0]))
    wind = smooth_wind(SCENE, error=error)
    wind = replace(wind, leads=wind.times.copy())
    problem = make_problem("F a", SCENE, wind, RobotConfig(dt=100.0, u_max=20.0), LOOSE, fidelity="full")
    drawn = draw_flights(problem, "coherent", 400, SeedSequence(3))
    assert wind.modes is not None
    own, since, slot = wind.modes.part == FORECAST, 1800.0, 2
    step = int(np.flatnonzero(problem.modes.slot == slot)[0])
    truth = drawn.draws.theta[problem.modes.epoch[step]].astype(float)
    node = wind.modes.psi[slot, 7, 7, 0].astype(float)
    gaps = []
    for i in range(400):
        newer = newer_forecast(
            wind, problem.modes, drawn.draws.theta[:, i], since, np.random.default_rng([4, i])
        )
        assert newer.modes is not None
        said = newer.mean[slot, 7, 7, 0] - wind.mean[slot, 7, 7, 0]
        gaps.append(node[own] @ truth[i, 0, own] - said)
        left = (newer.modes.psi[slot, 7, 7, 0, own] ** 2).sum()
    before = (node[own] ** 2).sum()
    assert left == pytest.approx(0.75 * before, rel=1e-5)
    assert np.mean(gaps) == pytest.approx(0.0, abs=5.5 * float(np.sqrt(left / 400)))
    assert np.var(gaps) == pytest.approx(float(left), rel=5.5 * np.sqrt(2 / 400))
