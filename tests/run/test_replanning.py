"""The rest of a flight planned again: from a fix, or unchanged without one."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

import pareto_ltl
from pareto_ltl.run.plan_run import Run
from pareto_ltl.settings import SelectionConfig
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl_apps.cli.arguments import read_fix
from pareto_ltl_apps.cli.commands import run_command_line
from pareto_ltl_apps.cli.result_commands import default_place
from pareto_ltl_apps.flight.replanning import comparison_lines
from pareto_ltl_verify.judge import verify

SMALL: dict[str, Any] = {
    "robot": {"dt": 1800.0},
    "planner": {"trees": 3, "n_max": 1500, "max_steps": 80},
    "smoothing": {"candidates": 1, "weights": [10.0]},
    "refine": {"flights": 60, "sweep_flights": 20, "classes": 1, "points": 5},
    "selection": {"draws": 300, "runs": 800},
    "deployment": {"runs": 40},
    "report": "none",
}
STEP = 10


@pytest.fixture(scope="module", params=["full", "paper"])
def made(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("made") / request.param
    pareto_ltl.plan("phi2", "F(a & F b)", fidelity=request.param, out=place, **SMALL)
    return place


def fix_near(results: Run, off: tuple[float, float] = (6e3, -4e3), sd: float = 400.0) -> tuple[float, ...]:
    """A fix that far from the expected position."""
    lon, lat = results.scene.frame.to_geographic(results.plan.path.x[STEP] + np.array(off))
    return float(lat[0]), float(lon[0]), sd


@pytest.fixture(scope="module")
def anew(made: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A directory of the rest, planned from a fix by the command line."""
    place = tmp_path_factory.mktemp("anew") / "run"
    told = ",".join(map(repr, fix_near(Run.open(made))))
    assert run_command_line(["replan", str(made), "--time", "5h", f"--fix={told}", "--out", str(place)]) == 0
    return place


def test_without_a_fix_the_rest_of_the_plan_stays_to_the_bit(made: Path, tmp_path: Path) -> None:
    old = Run.open(made).plan.path
    done = pareto_ltl.replan(made, "5h", out=tmp_path / "rest")
    written = json.loads((tmp_path / "rest" / "plan.json").read_text())
    for u, x in ((done.plan.path.u, done.plan.path.x), (written["u"], written["x"])):
        np.testing.assert_array_equal(u, old.u[STEP:])
        np.testing.assert_array_equal(x, old.x[STEP:])
    assert done.plan.limits is not None
    assert len(done.plan.limits.nearest) == len(old.u) - STEP
    assert done.plan.prices == ()
    assert done.old == done.new
    assert "there is no new information" in comparison_lines(done)[1]


def test_the_new_plan_starts_at_the_fix_and_at_its_time(made: Path, anew: Path) -> None:
    old, new = Run.open(made), Run.open(anew)
    aim = old.plan.path.x[STEP] + np.array([6e3, -4e3])
    assert np.linalg.norm(new.plan.path.x[0] - aim) < 1500.0
    assert new.scene.time_zero == "2018-10-09T05:00:00Z"
    assert new.settings.robot.start_sd < 450.0
    assert new.plan.formula == "the rest of F(a & F b)"
    assert new.wind.times[0] <= 0.0
    document = json.loads((anew / "replan.json").read_text())
    assert (document["step"], document["source"]) == (STEP, str(made))
    assert 0.0 < document["certainty"] <= 1.0
    assert {"law", "failure", "low", "high"} <= set(document["old"]) & set(document["new"])


def test_only_the_coherent_law_learns_of_the_wind(made: Path, anew: Path) -> None:
    old, new = Run.open(made), Run.open(anew)
    kept = old.wind.mean[-len(new.wind.times) :]
    learnt = np.abs(new.wind.mean - kept).max()
    assert (learnt > 0.0) == (old.settings.fidelity.law == "coherent")


def test_claims_of_the_new_result_hold(anew: Path) -> None:
    found = verify(anew)
    assert not [finding.claim for finding in found if not finding.holds]
    assert len(found) > 60


def test_the_new_result_can_be_chosen_from_exported_and_flown(anew: Path, tmp_path: Path) -> None:
    assert pareto_ltl.choose(anew, point=0).plan.path.objectives.length > 0
    assert pareto_ltl.export(anew, tmp_path, ["kml"])
    assert len(pareto_ltl.simulate(anew, runs=30).failed) == 30


def test_a_plan_in_memory_gives_the_same_plan(made: Path, anew: Path) -> None:
    result = pareto_ltl.plan("phi2", "F(a & F b)", fidelity=made.name, **SMALL)
    done = pareto_ltl.replan(result, 5 * 3600.0, fix_near(Run.open(made)))
    np.testing.assert_allclose(done.plan.path.x, Run.open(anew).plan.path.x, atol=1e-6)
    ax = Figure().add_subplot()
    assert done.plot(ax=ax) is ax
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["rest of the old plan"]


@pytest.mark.parametrize(
    ("time", "fix", "said"),
    [
        ("90h", None, "name a time after its first and before its last step"),
        ("0s", None, "name a time after its first"),
        ("noon", None, "expected an ISO 8601 time"),
        ("2018-10-08T00:00:00Z", None, "before the first step of the plan"),
        ("5h", (37.0, -94.0, 0.0), "must be at least 0.01 m"),
        (None, (37.0, -94.0, 500.0), "a fix needs its time"),
        (None, None, "needs a time"),
        ("5h", (37.0, -94.0, float("nan")), "three numbers"),
        ("5h", (37.0, -94.0), "three numbers LAT,LON,SD"),
        ("5h", (-94.0, 37.0, 500.0), "is it LAT,LON,SD"),
        ("5h", (37.0, 94.0, 500.0), "lies outside the map"),
    ],
)
def test_a_time_or_a_fix_that_cannot_be_is_refused(
    made: Path, time: str | None, fix: tuple[float, ...] | None, said: str
) -> None:
    with pytest.raises(ConfigError, match=said):
        pareto_ltl.replan(made, time, fix)


def test_a_folder_without_a_result_and_words_that_are_no_fix_are_refused(
    made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(DataError):
        pareto_ltl.replan(tmp_path, "5h")
    with pytest.raises(ConfigError, match="would overwrite its source"):
        pareto_ltl.replan(made, "5h", out=made)
    with pytest.raises(ConfigError, match="LAT,LON,SD"):
        read_fix("37.5,-93.2")
    assert run_command_line(["replan", str(made), "--time", "5h", "--fix", "here"]) == 2
    assert "--fix must be LAT,LON,SD" in capsys.readouterr().err
    assert default_place(tmp_path / "run", "2018-10-09T06:00:00Z").name == "run_replanned_20181009T060000Z"


def test_a_time_between_two_steps_is_rounded(made: Path) -> None:
    assert pareto_ltl.replan(made, "4h").situation.step == 8
    assert pareto_ltl.replan(made, 5 * 3600.0 + 400.0).situation.step == STEP


def test_the_rule_of_the_rest_has_the_length_that_is_left(made: Path) -> None:
    from pareto_ltl_apps.flight.rest_of_flight import rule_of_the_rest

    path = Run.open(made).plan.path
    cfg = SelectionConfig(rule="length", length=path.objectives.length)
    flown = np.linalg.norm(np.diff(path.x[: STEP + 1], axis=0), axis=1).sum()
    assert rule_of_the_rest(cfg, path, STEP).length == pytest.approx(path.objectives.length - flown)
    assert rule_of_the_rest(SelectionConfig(rule="point", point=3), path, STEP).rule == "worth"


def test_a_newer_forecast_is_the_wind_of_the_rest(made: Path, tmp_path: Path, caplog: Any) -> None:
    """Here the forecast of the plan itself, which is not newer: the position is taken from the plan."""
    old = Run.open(made)
    source = Path(pareto_ltl.__file__).parent / "support" / "data" / "gfs_conus_20181009.csv"
    place = tmp_path / "newer"
    assert (
        run_command_line(["replan", str(made), "--time", "5h", "--wind", str(source), "--out", str(place)])
        == 0
    )
    new = Run.open(place)
    np.testing.assert_allclose(new.plan.path.x[0], old.plan.path.x[STEP], atol=1.0)
    document = json.loads((place / "replan.json").read_text())
    assert document["wind"] == str(source)
    assert document["fixes"] == []
    assert document["position"] is not None
    assert new.settings.wind.path == str(source)


def test_a_forecast_that_does_not_exist_is_named(made: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no such file; give a newer forecast"):
        pareto_ltl.replan(made, "5h", wind=tmp_path / "none.grib2")


def test_the_new_plan_is_not_worse_than_the_rest_of_the_old_one(made: Path) -> None:
    done = pareto_ltl.replan(made, "5h", fix_near(Run.open(made), (0.0, 0.0)))
    assert done.advice != "old"
