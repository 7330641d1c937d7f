"""The benchmark for planners of others (benchmarks/published): its data, and what the scores mean."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path

import numpy as np
import pytest

from pareto_ltl.support.errors import DataError
from pareto_ltl.wind.readings import seconds
from published import score
from published.dataset import FOLDER, missions, true_problem
from published.plans import controls, read_orders

MISSIONS = {mission.name: mission for mission in missions()}
EASY = next(iter(MISSIONS.values()))


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
    assert max(begun) <= departure - 4 * 3600.0  # no cycle that a planner could not have had
    with (FOLDER / mission.truth).open() as file:
        times = {seconds(row["time"]) for row in csv.DictReader(file)}
    assert min(times) <= departure
    assert max(times) >= departure + 3600.0 * mission.hours
    problem = true_problem(mission)
    assert set(problem.scene.regions) == {"a", "b", "c"}
    assert problem.horizon >= mission.most_steps
    assert not problem.wind.latent.any()


def test_files_name_their_origin_and_no_place_of_a_machine() -> None:
    for path in (FOLDER / "winds").glob("*.json"):
        origin = json.loads(path.read_text())
        assert "NOAA" in origin["source"]
        assert all("/" not in name and len(digest) == 64 for name, digest in origin["files"].items())
    assert sum(path.stat().st_size for path in FOLDER.rglob("*.*")) < 600_000


def test_orders_lead_where_the_wind_triangle_leads(tmp_path: Path) -> None:
    """North on the ground, not in the plane; the flight without gusts follows the controls."""
    path = write_plan(tmp_path / "north.csv", [(3600, 0, 30), (1800, "", 0), ("", "", "")])
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
        ((1000, 0, 20), "multiple of 1800"),
        ((1800, 0, 31), "airspeed_m_s must be between 0 and 30"),
        ((1800, "north", 20), "row 1: expected numbers"),
        (("inf", 0, 20), "multiple of 1800"),
        ((1800 * 40, 0, 20), "40 steps"),
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
    write_plan(tmp_path / f"{names[0]}.csv", [(1800, 90, 0)])
    (tmp_path / "promises.json").write_text(json.dumps(dict.fromkeys(names, 0.9)))
    words = [str(tmp_path), "--runs", "50", "--only", ",".join(names)]
    assert score.main([*words, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert [row["failure"] for row in told["missions"]] == [1.0, 1.0]
    assert told["summary"]["brier"] == pytest.approx(0.01)
    assert told["summary"]["log_score"] == pytest.approx(-math.log(0.9))
    assert (told["summary"]["situations"], told["summary"]["floor"]) == (1.0, 0.5)
    assert score.main(words) == 0
    assert max(map(len, capsys.readouterr().out.splitlines())) <= 80
    assert score.main([str(tmp_path / "none")]) == 2
    assert "no such folder" in capsys.readouterr().err


def test_the_entry_of_this_planner_has_the_scores_that_the_page_states(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert score.main([str(FOLDER / "example"), "--runs", "300", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["summary"]["failure"] == pytest.approx(0.835, abs=0.01)
    assert told["summary"]["promised"] == pytest.approx(0.630, abs=0.001)
    assert told["summary"]["brier"] == pytest.approx(0.195, abs=0.01)
    page = (FOLDER / "README.md").read_text(encoding="utf-8")
    assert "| both | 12 | 63 % | 83 % | 10 |" in page
    assert "Brier score 0.195, log score 0.579" in page
    assert sum(row["failure"] > 0.5 for row in told["missions"]) == 10
