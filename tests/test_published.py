"""The benchmark for planners of others (benchmarks/published): its data, and what the scores mean."""

from __future__ import annotations

import csv
import json
import math
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from careful_io.times import seconds
from pareto_ltl.support.errors import DataError
from published import score
from published.dataset import FOLDER, missions, true_problem
from published.planners import PLANNERS
from published.plans import controls, read_orders

MISSIONS = {mission.name: mission for mission in missions()}
EASY = next(iter(MISSIONS.values()))
PLANS = [FOLDER / "plans" / name for name in PLANNERS]


def write_plan(path: Path, rows: list[tuple[object, object, object]]) -> Path:
    with path.open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow(["leg", "duration_s", "heading_true_deg", "airspeed_m_s"])
        table.writerows([[number, *row] for number, row in enumerate(rows)])
    return path


@pytest.mark.parametrize("name", MISSIONS)
def test_every_mission_has_a_map_and_winds_that_were_known_and_that_came(name: str) -> None:
    mission = MISSIONS[name]
    departure = seconds(mission.departure)
    with (FOLDER / mission.known).open() as file:
        rows = list(csv.DictReader(file))
    begun = {seconds(row["time"]) - 3600.0 * float(row["lead_hours"]) for row in rows}
    assert max(begun) <= departure - 10 * 3600.0  # no cycle that a planner could not have had
    with (FOLDER / mission.truth).open() as file:
        times = {seconds(row["time"]) for row in csv.DictReader(file)}
    assert min(times) <= departure
    assert max(times) >= departure + 3600.0 * mission.hours
    problem = true_problem(mission)
    assert set(problem.scene.regions) == {"a", "b", "c"}
    assert problem.horizon >= mission.most_steps
    assert not problem.wind.latent.any()


def test_there_are_forty_missions_in_twenty_situations_and_files_name_their_origin() -> None:
    counts = Counter(mission.situation for mission in MISSIONS.values())
    assert sum(counts.values()) == 40
    assert len(counts) >= 20
    origin = json.loads((FOLDER / "winds" / "origin.json").read_text())
    assert "public domain" in origin["source"]
    assert all("/" not in name and len(digest) == 64 for name, digest in origin["files"].items())
    assert sum(path.stat().st_size for path in FOLDER.rglob("*.*")) < 1_500_000


def test_orders_lead_where_the_wind_triangle_leads(tmp_path: Path) -> None:
    """North on the ground, not in the plane; the flight without gusts follows the controls."""
    path = write_plan(tmp_path / "north.csv", [(1200, 0, 30), (600, "", 0), ("", "", "")])
    problem, orders = true_problem(EASY), read_orders(path, EASY)
    assert orders.tolist() == [[0.0, 30.0], [0.0, 30.0], [0.0, 0.0]]
    u, x = controls(problem, orders)
    np.testing.assert_allclose(np.hypot(*u.T), [30.0, 30.0, 0.0])
    assert (u[:2, 1] > 29.9).all()  # the plane is turned by less than five degrees
    flown = score.fly_seeded(problem, u, 200, "independent", 0, x)
    assert np.linalg.norm(flown.x.mean(axis=0) - x, axis=1).max() < 500.0  # gusts of 0.3 m/s alone


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ((1000, 0, 20), "multiple of 600"),
        ((600, 0, 41), "airspeed_m_s must be between 0 and 40"),
        ((600, "north", 20), "row 1: expected numbers"),
        (("inf", 0, 20), "multiple of 600"),
        ((600 * 40, 0, 20), "40 steps"),
    ],
)
def test_orders_that_cannot_be_flown_are_refused(
    row: tuple[object, object, object], words: str, tmp_path: Path
) -> None:
    with pytest.raises(DataError, match=words):
        read_orders(write_plan(tmp_path / "p.csv", [row]), EASY)
    (tmp_path / "q.csv").write_text("a,b\n1,2\n")
    with pytest.raises(DataError, match="missing column"):
        read_orders(tmp_path / "q.csv", EASY)


def test_a_mission_without_a_plan_fails_and_promises_are_scored(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    names = list(MISSIONS)[:2]
    write_plan(tmp_path / f"{names[0]}.csv", [(600, 90, 0)])
    (tmp_path / "promises.json").write_text(json.dumps(dict.fromkeys(names, 0.9)))
    words = [str(tmp_path), "--runs", "50", "--only", ",".join(names)]
    assert score.main([*words, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert [row["failure"] for row in told["missions"]] == [1.0, 1.0]
    assert told["summary"]["brier"] == pytest.approx(0.01)
    assert told["summary"]["log_score"] == pytest.approx(-math.log(0.9))
    count = len({MISSIONS[name].situation for name in names})
    assert (told["summary"]["situations"], told["summary"]["floor"]) == (count, 1 / (count + 1))
    assert score.main(words) == 0
    assert max(map(len, capsys.readouterr().out.splitlines())) <= 80
    assert score.main([str(tmp_path / "none")]) == 2
    assert "no such folder" in capsys.readouterr().err


def row(name: str, situation: str, failure: float) -> score.Row:
    return score.Row(name, situation, failure, 0.0, 1.0, failure, 0.0, 1.0, 100.0, None)


def test_planners_are_ranked_with_a_situation_as_one_trial() -> None:
    """A planner that is better in every situation is first; one better in half of them cannot be told."""
    situations = [f"s{k // 2}" for k in range(24)]
    best = [row(f"m{k}", s, 0.1) for k, s in enumerate(situations)]
    worse = [row(f"m{k}", s, 0.3) for k, s in enumerate(situations)]
    mixed = [row(f"m{k}", s, 0.0 if k % 4 < 2 else 0.62) for k, s in enumerate(situations)]
    found = {each.planner: each for each in score.ranks({"worse": worse, "mixed": mixed, "best": best})}
    assert found["best"].rank == (1, 1)
    assert found["best"].behind_interval == (0.0, 0.0)
    assert found["worse"].behind_interval == pytest.approx((0.2, 0.2))
    assert found["worse"].rank == found["mixed"].rank == (2, 3)
    low, high = found["mixed"].failure_interval
    sd = 0.31 / math.sqrt(12)  # of the mean of twelve situations, half of which fail
    assert (low, high) == pytest.approx((0.31 - 1.96 * sd, 0.31 + 1.96 * sd), abs=0.05)


def test_the_published_plans_have_the_ranks_that_the_page_states(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert score.main([*map(str, PLANS), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    page = (FOLDER / "README.md").read_text(encoding="utf-8")
    for each in told["ranks"]:
        low, high = each["failure_interval"]
        first, last = each["rank"]
        rank = f"{first}" if first == last else f"{first} to {last}"
        cell = f"{100 * each['failure']:.1f} % ({100 * low:.1f} to {100 * high:.1f} %)"
        assert f"| `{each['planner']}` | {cell} | {rank} |" in page
    ours = told["planners"]["ours"]["summary"]
    assert f"promised {100 * ours['promised']:.1f} %" in page
    assert f"Brier score {ours['brier']:.3f}, log score {ours['log_score']:.3f}" in page
