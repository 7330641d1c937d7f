"""GO and NO-GO: every limit decides, reasons have an order, and bad input is one line."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import pareto_ltl
from careful_io.reading import read_json
from pareto_ltl.support.errors import ConfigError
from pareto_ltl.support.resources import SAMPLE_WINDS
from pareto_ltl_apps.cli.commands import run_command_line
from pareto_ltl_apps.preflight.check import wind_at
from quick_plan import QUICK_PLAN
from quick_wind import QUICK_WIND

Row = dict[str, float | str]
SMALL = {
    **QUICK_PLAN,
    "exports": {"files": False},
    "report": {"figures": False, "page": False},
}
NO_GO = 3


def written(path: Path, change: Callable[[Row], None] = lambda _row: None, hours: float = 99.0) -> Path:
    """The packaged winds with leads, changed, for so many hours."""
    with SAMPLE_WINDS.open(newline="") as file:
        rows: list[Row] = [dict(row) for row in csv.DictReader(line for line in file if line[0] != "#")]
    times = sorted({str(row["time"]) for row in rows})
    kept = [time for k, time in enumerate(times) if 3.0 * k <= hours]
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, [*rows[0], "lead_hours"])
        writer.writeheader()
        for row in rows:
            if row["time"] in kept:
                change(row)
                writer.writerow(row | {"lead_hours": 3 * kept.index(str(row["time"]))})
    return path


def blowing(u: float, v: float) -> Callable[[Row], None]:
    def change(row: Row) -> None:
        row["u"], row["v"] = float(row["u"]) + u, float(row["v"]) + v

    return change


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small result in a forecast."""
    folder = tmp_path_factory.mktemp("check")
    wind = {**QUICK_WIND, "modes_max": 8, "source": "csv", "path": str(written(folder / "old.csv"))}
    pareto_ltl.plan("phi1", "F(a & F b & F c)", out=folder / "made", wind=wind, **SMALL)
    return folder / "made"


def checked(made: Path, out: Path, wind: Path, *words: str) -> tuple[int, dict]:
    line = ["check", str(made), "--wind", str(wind), *words, "--flights", "1000", "--out", str(out)]
    return run_command_line(line), read_json(out / "check.json")


def test_the_same_forecast_changes_nothing(made: Path, tmp_path: Path) -> None:
    code, found = checked(made, tmp_path / "out", written(tmp_path / "same.csv"), "limits.failure=0.99")
    assert code == 0
    assert found["go"]
    assert found["reasons"] == []
    old, new = found["planned"]["failure"], found["failure"]
    assert old["low"] <= new["high"]
    assert new["low"] <= old["high"]
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"check.json", "check.txt", "check.png"}


def test_a_wind_that_turned_is_no_go_with_its_reasons_in_order(
    made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    newer = written(tmp_path / "newer.csv", blowing(2.5, -2.0))
    limits = ("robot.wind_limit=1", "limits.failure=0.01", "limits.containment=1e-6")
    code, found = checked(made, tmp_path / "out", newer, *limits)
    assert code == NO_GO
    failed = [item["name"] for item in found["items"] if not item["passed"]]
    assert failed[-3:] == ["wind", "failure", "containment"]
    assert found["failure"]["rate"] > found["planned"]["failure"]["rate"]
    out = capsys.readouterr().out.splitlines()
    place = out.index("NO-GO")
    assert out[place + 1].startswith("1. ")


@pytest.mark.parametrize(
    ("limit", "name"),
    [
        ("limits.failure=1e-6", "failure"),
        ("limits.containment=1e-9", "containment"),
        ("limits.takeoff_wind=0.01", "takeoff_wind"),
        ("robot.wind_limit=0.01", "wind"),
    ],
)
def test_each_limit_decides_alone(limit: str, name: str, made: Path, tmp_path: Path) -> None:
    code, found = checked(made, tmp_path / "out", written(tmp_path / "same.csv"), limit)
    assert code == NO_GO
    assert [item["name"] for item in found["items"] if not item["passed"]] == [name]


def test_a_forecast_that_ends_early_is_no_go(made: Path, tmp_path: Path) -> None:
    newer = written(tmp_path / "short.csv", hours=9.0)
    code, found = checked(made, tmp_path / "out", newer, "limits.failure=0.99")
    assert code == NO_GO
    assert "ends" in found["reasons"][0]
    assert found["failure"] is None


def test_the_answer_for_programs_is_the_file(
    made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    wind = written(tmp_path / "same.csv")
    words = ["check", str(made), "--wind", str(wind), "limits.failure=0.99", "--flights", "1000", "--json"]
    assert run_command_line([*words, "--out", str(tmp_path / "out")]) == 0
    document = json.loads(capsys.readouterr().out)
    found = read_json(tmp_path / "out" / "check.json")
    assert {key: document[key] for key in found} == found


def test_the_largest_likely_wind_has_the_quantile_of_its_law(made: Path) -> None:
    """Of one component with a mean far above its deviation, 95 % are below the mean and 1.64 deviations."""
    run = pareto_ltl.load_results(made)
    problem, x = run.problem, run.plan.path.x
    wind = problem.wind
    level = np.zeros_like(wind.mean)
    level[..., 0] = 40.0
    strong = wind._replace(
        mean=level, latent=np.ones_like(wind.latent), gust=0.0 * wind.gust, between=0.0 * wind.between
    )
    law = problem.world.law._replace(wind=strong)
    middle, high = wind_at(replace(problem, world=problem.world._replace(law=law)), x, 3)
    assert middle == pytest.approx(40.0)
    assert high == pytest.approx(40.0 + 1.645, abs=0.12)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ([], "GO needs a limit of your own"),
        (["limits.failure=2"], "limits.failure must lie between 0 and 1"),
        (["limits.failure=often"], "limits.failure must be a number"),
        (["limits.height=3"], "limits has no height"),
        (["planner.trees=3"], "expected limits.KEY=VALUE"),
        (["robot.wind_limit=-1"], "robot.wind_limit must be"),
        (["limits.failure=0.1", "--flights", "3"], "flights must be 1,000"),
        (["limits.failure=0.1", "--wind", "absent.csv"], "no such file"),
        (["limits.failure=0.1", "--wind", "AWAY"], "the newer forecast cannot be used"),
    ],
)
def test_bad_input_is_one_line(
    words: list[str], said: str, made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    def away(row: Row) -> None:
        row["lat"], row["lon"] = float(row["lat"]) - 60.0, float(row["lon"]) + 100.0

    monkeypatch.chdir(tmp_path)
    written(tmp_path / "AWAY", away)
    wind = [] if "--wind" in words else ["--wind", str(written(tmp_path / "same.csv"))]
    assert run_command_line(["check", str(made), *wind, *words]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert said in lines[0]


def test_limits_of_the_plan_are_used(made: Path, tmp_path: Path) -> None:
    wind = written(tmp_path / "same.csv")
    with pytest.raises(ConfigError, match="a limit of your own"):
        pareto_ltl.check(made, wind, flights=1000)
    found = pareto_ltl.check(made, wind, limits={"failure": 0.99}, flights=1000)
    assert found.go
    assert "GO" in repr(found)
