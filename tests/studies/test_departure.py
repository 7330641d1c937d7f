"""Starts compared: which are planned, which is recommended, and what is said of the others."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import pytest

from careful_io.times import iso, seconds
from pareto_ltl.run.choosing import choose
from pareto_ltl.run.plan_run import Run
from pareto_ltl.settings import Settings
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import ConfigError
from pareto_ltl.support.schemas import read_document
from pareto_ltl.wind.readings import CALM, Readings
from pareto_ltl_apps.cli.commands import run_command_line
from pareto_ltl_apps.studies.departure import candidate_starts, repeated
from pareto_ltl_apps.studies.departure_fronts import Comparison, compare_fronts, flown_front
from pareto_ltl_apps.studies.departure_table import (
    Delivered,
    Found,
    compared_paths,
    delivered_text,
    folder_name,
    fronts_in_time,
    noise_text,
    recommendation_text,
    start_rows,
)
from pareto_ltl_apps.studies.settings import DepartureConfig
from pareto_ltl_verify.judge import verify
from quick_wind import wind_words

if TYPE_CHECKING:
    from pareto_ltl.planning.records import Plan

SMALL = (
    "+experiment=phi2", "fidelity=paper", "planner.trees=3", "planner.n_max=1500", "deployment.runs=20",
    "departure.flights=400", "departure.seeds=2", "report.dpi=40", "evaluation.jobs=1", *wind_words(),
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


def path(failures: int, length: float, n: int = 2000, **more: object) -> dict[str, object]:
    """A path of which the first ``failures`` of ``n`` flights fail."""
    return {
        "length_m": length, "duration_s": 7200.0, "steps": 4, "order": "a", "origin": f"tree {length:.0f}",
        "failed": "1" * failures + "0" * (n - failures), "x": [[0.0, 0.0], [length, 1.0]],
    } | more  # fmt: skip


def result(counts: dict[float, int], **more: object) -> dict[str, object]:
    """What a start has whose paths of these lengths [m] fail so often."""
    conditions = {"wind_speed": 3.0, "wind_sd": 1.0, "tail_wind": 0.5, "end_sd_m": 10.0}
    paths = [path(failures, length) for length, failures in counts.items()]
    return {
        "planned": True, "law": "coherent", "plan": 0, "paths": paths, "metrics": {}, "conditions": conditions
    } | more  # fmt: skip


def compared(found: Found, cfg: DepartureConfig | None = None) -> tuple[list[dict[str, Any]], Comparison]:
    settings = replace(Settings(), departure=cfg or DepartureConfig(flights=2000))
    comparison = compare_fronts(fronts_in_time(settings.departure, found))
    return start_rows(settings, found, comparison), comparison


GOOD, WORSE = {1000.0: 200, 1500.0: 60}, {1000.0: 800, 1500.0: 300}


def test_the_start_that_fails_less_is_recommended_and_the_others_say_why_not() -> None:
    windy = {"wind_speed": 5.0, "wind_sd": 2.0, "tail_wind": -2.0, "end_sd_m": 3e4}
    found: Found = {
        0.0: [result(WORSE, conditions=windy)] * 2,
        3600.0: [result(GOOD)] * 2,
        7200.0: [{"planned": False, "reason": "no flight fits"}],
    }
    rows, comparison = compared(found)
    assert [row["recommended"] for row in rows] == [False, True, False]
    assert [row["as_good"] for row in rows] == [False, True, False]
    for words in ("fails 4.", "times as often at equal length", "2.0 m/s of head wind instead of 0.5 m/s",
                  "sd 2.00 instead of 1.00 m/s", "spread wider"):  # fmt: skip
        assert words in rows[0]["verdict"]
    assert rows[2]["verdict"] == "no plan: no flight fits"
    assert rows[1]["arrival"] == "1970-01-01T03:00:00Z"
    said = recommendation_text(rows, comparison)
    assert "Leave at 1970-01-01T01:00:00Z" in said
    assert "every other start fails more often; the nearest one, 1970-01-01T00:00:00Z" in said


def test_starts_that_do_not_differ_are_named_and_the_earliest_is_recommended() -> None:
    found: Found = {0.0: [result({1000.0: 205, 1500.0: 62})], 3600.0: [result(GOOD)], 7200.0: [result(WORSE)]}
    rows, comparison = compared(found)
    assert recommendation_text(rows, comparison) == (
        "**Leave at 1970-01-01T00:00:00Z**. 2 starts do not differ beyond the noise at equal length (1 to 2 "
        "km): 1970-01-01T00:00:00Z, 1970-01-01T01:00:00Z. Of these, it is the earliest of those that fail at "
        "most 1.1 times as often as the best one (1.03 [0.98, 1.08] times as often as 1970-01-01T01:00:00Z). "
        "All others fail more often at equal length (1 to 2 km)."
    )
    assert "no difference beyond the noise" in rows[0]["verdict"]
    assert "not the spread between seeds" in noise_text(DepartureConfig(), comparison)


def test_paths_and_starts_that_arrive_late_are_not_compared() -> None:
    cfg = DepartureConfig(arrive_by="1970-01-01T02:30:00Z", flights=2000)
    slow = path(1, 2000.0, duration_s=9200.0)  # arrives 200 s late
    first = result(WORSE)
    found: Found = {0.0: [first | {"paths": [*first["paths"], slow]}], 3600.0: [result(GOOD)]}
    rows, _ = compared(found, cfg)
    assert [row["recommended"] for row in rows] == [True, False]
    assert "after departure.arrive_by" in rows[1]["verdict"]
    assert rows[0]["paths"] == 2
    assert [len(x) for _, x in compared_paths(cfg, 0.0, found)] == [2, 2]


def test_a_start_may_have_no_plan_with_a_further_seed() -> None:
    none = {"planned": False, "reason": "no path completes the mission"}
    rows, _ = compared({0.0: [result(GOOD), none], 3600.0: [result(WORSE), result(WORSE)]})
    assert [(row["recommended"], row["seeds"], row["paths"]) for row in rows] == [(True, 2, 2), (False, 2, 2)]


def test_the_paths_for_the_full_plan_are_the_best_of_all_seeds() -> None:
    found: Found = {0.0: [result({1000.0: 200, 1500.0: 60}), result({1100.0: 150, 1400.0: 70, 1600.0: 61})]}
    kept = compared_paths(DepartureConfig(flights=2000), 0.0, found)
    assert [origin for origin, _ in kept] == [
        f"compared start, tree {length}" for length in (1000, 1100, 1400, 1500)
    ]
    np.testing.assert_array_equal(kept[2][1], [[0.0, 0.0], [1400.0, 1.0]])


def test_the_full_plan_is_set_against_the_compared_front_and_the_latest_arrival() -> None:
    compared = flown_front(np.array([1e6, 2e6]), np.arange(2000) < np.array([[200], [50]]))
    full = flown_front(np.array([1e6, 2e6]), np.arange(2000) < np.array([[100], [25]]))
    path = SimpleNamespace(objectives=SimpleNamespace(length=2e6), t=np.array([0.0, 9000.0]))
    delivered = Delivered(cast("Plan", SimpleNamespace(path=path, promise=None)), full, compared)
    assert delivered.ratio[0] == pytest.approx(0.5, rel=0.02)
    cfg = DepartureConfig(arrive_by="1970-01-01T02:30:00Z")
    said = delivered_text(cfg, 0.0, delivered)
    assert "a path of 2,000 km is chosen; the safest compared path that is no longer has 2.5 %" in said
    assert "after departure.arrive_by" not in said
    assert "it arrives at 1970-01-01T02:30:01Z, after" in delivered_text(cfg, 1.0, delivered)


def test_the_first_seed_is_that_of_the_run_and_the_others_differ() -> None:
    settings = Settings(seed=5)
    repeats = [repeated(settings, k) for k in range(4)]
    assert repeats[0] == settings
    assert len({repeat.search_seed for repeat in repeats}) == 4
    assert all(repeat.seed == repeat.search_seed for repeat in repeats[1:])
    assert repeats == [repeated(settings, k) for k in range(4)]


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
    assert (place / "figures" / "departures_heat.png").is_file()
    assert [row["seeds"] for row in rows] == [2, 2, 1]
    assert "Why, and why not at" in (place / "tables.md").read_text(encoding="utf-8")


def test_each_start_is_a_result_that_can_be_used(place: Path) -> None:
    document = json.loads((place / "departures.json").read_text())
    for row in document["starts"][:2]:
        results = Run.open(place / row["directory"])
        assert results.provenance["status"] == "ok"
        assert results.plan.path.objectives.length == row["length_m"]
        assert results.scene.time_zero == row["departure"]
        assert choose(results, point=0).plan.path.objectives.length > 0


def front_rows(folder: Path) -> FloatArray:
    """Mission risk, collision risk and length of each path of ``front.csv``."""
    with (folder / "front.csv").open(encoding="utf-8") as file:
        names = "mission_risk", "collision_risk", "length_m"
        return np.array([[float(row[name]) for name in names] for row in csv.DictReader(file)])


def test_the_delivered_front_is_nowhere_worse_than_the_compared_one(place: Path) -> None:
    """Bounds judge here: no path of the compared start is better than all of the full front."""
    recommended = json.loads((place / "departures.json").read_text())["recommended"]
    start = folder_name(seconds(recommended["departure"]))
    full, coarse = front_rows(place / recommended["directory"]), front_rows(place / "starts" / start)
    for row in coarse:
        assert (full <= row * (1 + 1e-9)).all(axis=1).any()
    assert recommended["ratio_to_compared"]["ratio"] < 1.0 + 1e-9


def test_the_recommended_plan_can_be_made_again(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command_line(["rerun", str(place / "recommended")]) == 0
    assert "the same, byte for byte" in capsys.readouterr().out


def test_the_recommended_result_holds_before_the_judge(place: Path) -> None:
    assert not [finding for finding in verify(place / "recommended") if not finding.holds]


def test_a_study_that_goes_on_has_the_same_bytes(place: Path, tmp_path: Path) -> None:
    words = ("departure", *SMALL, f"departure.starts=[{MIDNIGHT},{NOON},2018-10-10T09:00:00Z]")
    more = (f"evaluation.resume={place}", f"hydra.run.dir={tmp_path / 'again'}")
    assert run_command_line([*words, *more]) == 0
    for name in (
        "departures.csv",
        "departure_lengths.csv",
        "departures.json",
        f"starts/{folder_name(seconds(NOON))}/plan.json",
    ):
        assert (tmp_path / "again" / name).read_bytes() == (place / name).read_bytes()


def test_an_arrival_too_early_names_the_earliest_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("departure", *SMALL, "departure.arrive_by=2018-10-09T05:00:00Z", "departure.keep=recommended")
    assert run_command_line([*words, f"hydra.run.dir={tmp_path / 'run'}"]) == 2
    said = capsys.readouterr().err
    assert "the earliest arrival found is 2018-10-09T" in said
    assert not (tmp_path / "run" / "starts").exists()
