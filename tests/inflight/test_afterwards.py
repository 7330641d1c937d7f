"""After flights: how often the ellipses held the truth, and the ranks of position fixes."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from numpy.random import SeedSequence

from levels import AT_NIGHT
from pareto_ltl.extend import simulate_flights
from pareto_ltl.support.errors import DataError
from pareto_ltl_apps.flight.afterwards import fix_ranks, true_distances, truth_summary
from pareto_ltl_apps.flight.rules import Event
from pareto_ltl_apps.flight.telemetry import Reading
from pareto_ltl_apps.flight.watch import Watch, WatchSettings
from watched import DT, PATH, PLAN, PROBLEM, heading_of

TRUTHS = 60 if AT_NIGHT else 12


def journal(x: np.ndarray, folder: Path, seed: int) -> list[Event]:
    """The events of a watched flight whose true positions are ``x`` (T+1, 2), with a fix after 15 steps."""
    watch = Watch(PROBLEM, PLAN, WatchSettings(every=5 * DT, members=50, alarm=1.0), SeedSequence(seed))
    rng, readings = np.random.default_rng(seed), []
    for k, u in enumerate(PATH.u):
        place = tuple((x[k] + 100.0 * rng.standard_normal(2)).tolist()) if k == 15 else None
        readings.append(Reading(k * DT, *heading_of(u), place, 100.0))
    folder.mkdir()
    events = list(watch.events(readings))
    (folder / "follow.jsonl").write_text("".join(json.dumps(event) + "\n" for event in events))
    return events


def test_flights_of_the_law_have_uniform_ranks_and_ellipses_that_hold_them(tmp_path: Path) -> None:
    truths = simulate_flights(PROBLEM, PATH.u, TRUTHS, "coherent", SeedSequence(9), PATH.x).x
    times, far = DT * np.arange(len(PATH.u) + 1), []
    folders = [tmp_path / str(k) for k in range(TRUTHS)]
    for k, (x, folder) in enumerate(zip(truths, folders, strict=True)):
        events = [event for event in journal(x, folder, k) if event["time"] > 0.0]
        far.append(true_distances(events, times, x))
    ranks = fix_ranks(folders)
    assert ranks["fixes"] == TRUTHS == sum(ranks["counts"])
    last = np.array([row[-1] for row in far])  # one estimate of a flight: they are not independent
    uniform = 1.0 - np.exp(-0.5 * last**2)
    assert abs(uniform.mean() - 0.5) < 5.0 / np.sqrt(12 * TRUTHS)


def test_the_summary_counts_what_is_inside(tmp_path: Path) -> None:
    events = journal(PATH.x, tmp_path / "f", 1)
    table = tmp_path / "truth.csv"
    rows = [f"{k * DT},{x},{y}" for k, (x, y) in enumerate(PATH.x)]
    table.write_text("\n".join(["time,x,y", *rows]) + "\n")
    found = truth_summary(tmp_path / "f", table, PROBLEM.scene)
    count = sum(event["event"] == "status" for event in events)
    assert found["estimates"] == count
    assert found["inside"]["50"] <= found["inside"]["90"] <= found["inside"]["99"] <= count
    far = true_distances(events, DT * np.arange(len(PATH.x)), PATH.x + np.array([1e6, 0.0]))
    assert far.min() > 10.0


@pytest.mark.parametrize(
    ("text", "message"),
    [("time,x\n1,2\n", "expected a CSV file time,x,y"), ("time,x,y\n1,2,3\n1,2,3\n", "times that increase"),
     ("time,x,y\n1,nan,3\n", "finite"), ("", "finite"), ("time,x,y\n1e9,2,3\n2e9,2,3\n", "no estimate")],
)  # fmt: skip
def test_a_truth_that_cannot_be_used_is_one_line(text: str, message: str, tmp_path: Path) -> None:
    journal(PATH.x, tmp_path / "f", 1)
    table = tmp_path / "truth.csv"
    table.write_text(text)
    with pytest.raises(DataError, match=message):
        truth_summary(tmp_path / "f", table, PROBLEM.scene)
