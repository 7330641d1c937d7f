"""Starts compared: which are planned, which is recommended, and what is said of the others."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pareto_ltl.cli.commands import run_command_line
from pareto_ltl.run.interface import choose
from pareto_ltl.run.results import Results
from pareto_ltl.settings import DepartureConfig, Settings
from pareto_ltl.studies.departure_starts import candidate_starts, folder_name
from pareto_ltl.studies.departure_table import same_length_columns, start_rows
from pareto_ltl.support.counts import paired_difference
from pareto_ltl.support.errors import ConfigError
from pareto_ltl.support.schemas import read_document
from pareto_ltl.verify.judge import judge_results
from pareto_ltl.wind.readings import CALM, Readings, iso, seconds

SMALL = (
    "+experiment=phi2", "fidelity=paper", "planner.trees=3", "planner.n_max=1500", "deployment.runs=20",
    "departure.flights=400", "report.dpi=40", "evaluation.jobs=1",
)  # fmt: skip
MIDNIGHT, NOON = "2018-10-09T00:00:00Z", "2018-10-09T12:00:00Z"


def readings(hours: list[float]) -> Readings:
    """Readings at some hours after midnight of 9 October 2018."""
    times = seconds(MIDNIGHT) + 3600.0 * np.array(hours)
    nothing = (np.empty((0, 2)),) * len(hours)
    return Readings(
        times, nothing, nothing, geographic=True, files=(), remarks=("",) * len(hours),
        origins=((),) * len(hours), leads=np.zeros(len(hours)),
    )  # fmt: skip


def starts(cfg: DepartureConfig, departure: str | None = None) -> list[str]:
    return [iso(time) for time in candidate_starts(cfg, readings([0, 3, 6, 12]), departure)]


# --- which starts ------------------------------------------------------------------------------


def test_every_wind_time_but_the_last_is_a_start() -> None:
    assert starts(DepartureConfig()) == [MIDNIGHT, "2018-10-09T03:00:00Z", "2018-10-09T06:00:00Z"]


def test_starts_keep_between_first_and_last_and_at_their_distance() -> None:
    cfg = DepartureConfig(first="2018-10-09T02:00:00Z", last="2018-10-09T07:00:00Z", every=2.5)
    assert starts(cfg) == ["2018-10-09T02:00:00Z", "2018-10-09T04:30:00Z", "2018-10-09T07:00:00Z"]
    assert starts(DepartureConfig(), "2018-10-09T04:00:00Z") == ["2018-10-09T06:00:00Z"]


def test_listed_starts_are_taken_once_and_in_order() -> None:
    cfg = DepartureConfig(starts=["2018-10-09T05:00:00Z", MIDNIGHT, "2018-10-09T02:00:00-03:00"])
    assert starts(cfg) == [MIDNIGHT, "2018-10-09T05:00:00Z"]


def test_a_calm_has_the_starts_that_are_named() -> None:
    cfg = DepartureConfig(first=MIDNIGHT, every=6.0, last=NOON)
    assert len(candidate_starts(cfg, CALM, None)) == 3
    with pytest.raises(ConfigError, match="calm wind has no times"):
        candidate_starts(DepartureConfig(), CALM, None)


@pytest.mark.parametrize(
    ("cfg", "said"),
    [
        (
            DepartureConfig(starts=["2018-10-08T00:00:00Z"]),
            "departure.starts: departure 2018-10-08T00:00:00Z",
        ),
        (DepartureConfig(first="2018-10-10T00:00:00Z"), "lies outside the wind"),
        (DepartureConfig(first="2018-10-09T07:00:00Z", last="2018-10-09T08:00:00Z"), "no start lies between"),
        (DepartureConfig(arrive_by=MIDNIGHT), "before departure.arrive_by"),
        (DepartureConfig(every=0.001), "expected at most 1,000"),
    ],
)
def test_a_window_without_starts_is_refused_in_one_line(cfg: DepartureConfig, said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        starts(cfg)


@pytest.mark.parametrize(
    "values", [{"starts": ["noon"]}, {"starts": [3]}, {"first": "9 October"}, {"every": 0.0}]
)
def test_settings_that_are_no_times_are_refused(values: dict[str, object]) -> None:
    with pytest.raises(ConfigError, match="departure"):
        DepartureConfig(**values)


def test_a_list_and_a_grid_of_starts_exclude_each_other() -> None:
    with pytest.raises(ConfigError, match="lists the starts itself"):
        DepartureConfig(starts=[NOON], every=3.0)


# --- the comparison ----------------------------------------------------------------------------


def result(failed: list[int], length: float = 1000.0, **more: object) -> dict[str, object]:
    """What a start with these flights has."""
    conditions = {"wind_speed": 3.0, "wind_sd": 1.0, "tail_wind": 0.5, "end_sd_m": 10.0}
    return {
        "planned": True, "failed": "".join(map(str, failed)), "law": "coherent", "length_m": length,
        "duration_s": 7200.0, "steps": 4, "order": "a", "x": [[0, 0], [1, 1]], "metrics": {},
        "conditions": conditions, "front": [], "fastest_s": 7200.0,
    } | more  # fmt: skip


def test_the_difference_of_pairs_has_an_interval_that_covers() -> None:
    """The true difference is 0.1; of 400 studies at least 355 cover it (chance of fewer at 95 %: 1e-7)."""
    rng = np.random.default_rng(0)
    covered = 0
    for _ in range(400):
        draws = rng.random(300)
        others = np.where(rng.random(300) < 0.5, draws, rng.random(300))  # half of the pairs share their draw
        _, low, high = paired_difference(draws < 0.1, others < 0.2)
        covered += low <= 0.1 <= high
    assert covered >= 355
    assert paired_difference(np.zeros(50, bool), np.zeros(50, bool))[0] == 0.0


def test_the_least_failure_is_recommended_and_ties_are_as_good() -> None:
    worse, equal = [1] * 60 + [0] * 140, [0] * 199 + [1]
    windy = {"wind_speed": 5.0, "wind_sd": 2.0, "tail_wind": -2.0, "end_sd_m": 30.0}
    found = {
        0.0: result(worse, 1500.0, conditions=windy),
        3600.0: result([0] * 200),
        7200.0: result(equal),
        10800.0: {"planned": False, "reason": "no flight fits"},
    }
    rows = start_rows(Settings(), found)
    assert [row["recommended"] for row in rows] == [False, True, False, False]
    assert [row["as_good"] for row in rows] == [False, True, True, False]
    assert rows[0]["difference"] == pytest.approx(0.3)
    for words in ("30.00 points", "0 km longer", "2.0 m/s of head wind instead of 0.5 m/s of tail wind",
                  "sd 2.00 instead of 1.00 m/s", "spread wider"):  # fmt: skip
        assert words in rows[0]["verdict"]
    assert rows[3]["verdict"] == "no plan: no flight fits"
    assert rows[1]["arrival"] == "1970-01-01T03:00:00Z"


def test_a_start_that_arrives_late_is_not_recommended() -> None:
    settings = replace(Settings(), departure=DepartureConfig(arrive_by="1970-01-01T02:30:00Z"))
    rows = start_rows(settings, {0.0: result([1, 0, 0, 0]), 3600.0: result([0] * 4)})
    assert [row["recommended"] for row in rows] == [True, False]
    assert "after departure.arrive_by" in rows[1]["verdict"]


def test_failure_at_one_length_lies_between_the_points_of_the_front() -> None:
    front = [[100.0, 0.1, 0.05, 0.2], [200.0, 0.001, 0.0005, 0.002]]
    at = same_length_columns(front, 150.0)
    assert at["failure_same_length"] == pytest.approx(0.01)  # half way in the logarithm
    assert same_length_columns(front, 300.0)["failure_same_length"] == pytest.approx(0.001)
    assert math.isnan(same_length_columns(front, 99.0)["failure_same_length"])
    assert math.isnan(same_length_columns([], 150.0)["failure_same_length"])


# --- whole studies -----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("departure") / "run"
    words = ("departure", *SMALL, f"departure.starts=[{MIDNIGHT},{NOON},2018-10-10T09:00:00Z]")
    assert run_command_line([*words, f"hydra.run.dir={folder}"]) == 0
    return folder


def test_the_files_of_a_departure_study_fit_their_schema(place: Path) -> None:
    document = read_document(place / "departures.json", "departures")
    rows = document["starts"]
    assert [row["departure"] for row in rows] == [MIDNIGHT, NOON, "2018-10-10T09:00:00Z"]
    assert not rows[2]["planned"]
    assert "the wind is known for 6.5 h from there" in rows[2]["verdict"]
    assert sum(row["recommended"] for row in rows) == 1
    assert (place / document["recommended"]["plan"]).is_file()
    assert (place / "figures" / "departures.png").is_file()
    assert "Why, and why not at" in (place / "tables.md").read_text(encoding="utf-8")


def test_each_start_is_a_result_that_can_be_used(place: Path) -> None:
    document = json.loads((place / "departures.json").read_text())
    for row in document["starts"][:2]:
        results = Results(place / row["directory"])
        assert results.run["status"] == "ok"
        assert results.plan.path.objectives.length == row["length_m"]
        assert results.scene.time_zero == row["departure"]
        assert choose(results, point=0).plan.path.objectives.length > 0


def test_the_recommended_plan_is_that_of_a_run_with_its_departure(place: Path, tmp_path: Path) -> None:
    document = json.loads((place / "departures.json").read_text())
    best = document["recommended"]["departure"]
    words = [*SMALL, f"mission.start_time={best}", f"hydra.run.dir={tmp_path}"]
    assert run_command_line([word for word in words if not word.startswith("departure")]) == 0
    for name in ("plan.json", "front.csv", "trees.npz"):
        assert (tmp_path / name).read_bytes() == (place / "recommended" / name).read_bytes()


def test_the_recommended_result_holds_before_the_judge(place: Path) -> None:
    assert not [finding for finding in judge_results(place / "recommended") if not finding.holds]


def test_a_study_that_goes_on_has_the_same_bytes(place: Path, tmp_path: Path) -> None:
    words = ("departure", *SMALL, f"departure.starts=[{MIDNIGHT},{NOON},2018-10-10T09:00:00Z]")
    more = (f"evaluation.resume={place}", f"hydra.run.dir={tmp_path / 'again'}")
    assert run_command_line([*words, *more]) == 0
    for name in ("departures.csv", "departures.json", f"starts/{folder_name(seconds(NOON))}/plan.json"):
        assert (tmp_path / "again" / name).read_bytes() == (place / name).read_bytes()


def test_an_arrival_too_early_names_the_earliest_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("departure", *SMALL, "departure.arrive_by=2018-10-09T05:00:00Z", "departure.keep=recommended")
    assert run_command_line([*words, f"hydra.run.dir={tmp_path / 'run'}"]) == 2
    said = capsys.readouterr().err
    assert "the earliest arrival found is 2018-10-09T" in said
    assert not (tmp_path / "run" / "starts").exists()
