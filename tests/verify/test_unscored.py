"""A wind with too few readings to hold some of them out has no score: the claims hold, and a lie does not."""

from __future__ import annotations

import json
from itertools import product
from pathlib import Path

import pytest

import pareto_ltl
from pareto_ltl_apps.cli.commands import run_command_line
from problems import box, make_scene

SCORES = ("gp_coverage_90", "gp_z_sd", "gp_nlpd")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("unscored") / "run"
    points = [[1e4 * x, 1e4 * y] for x, y in product((-1.0, 1.0, 3.0), repeat=2)]
    winds = [[[2.0 + 0.1 * k, 1.0 - 0.1 * k] for k in range(9)]] * 2
    readings = pareto_ltl.Readings.of_arrays(
        ["2026-01-01T00:00Z", "2026-01-01T06:00Z"], points, winds, geographic=False
    )
    pareto_ltl.plan(
        scene=make_scene({"a": box(13, 2, 17, 6)}, start=(2.0, 3.0)), formula="F a", out=place,
        wind={"source": readings, "forecast_error": "none"}, planner={"trees": 2, "n_max": 300},
        refine={"points": 3}, deployment={"runs": 50}, robot={"dt": 100.0, "u_max": 12.0},
    )  # fmt: skip
    return place


def test_a_wind_without_a_score_is_verified(made: Path, capsys: pytest.CaptureFixture[str]) -> None:
    metrics = json.loads((made / "metrics.json").read_text())
    assert {metrics[name] for name in SCORES} == {None}
    assert run_command_line(["verify", str(made), "--failed-only"]) == 0, capsys.readouterr().out


def test_a_score_that_the_wind_does_not_have_is_a_fault(
    made: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    metrics = json.loads((made / "metrics.json").read_text())
    (made / "metrics.json").write_text(json.dumps(metrics | {"gp_coverage_90": 0.9}))
    try:
        assert run_command_line(["verify", str(made), "--failed-only"]) == 3
    finally:
        (made / "metrics.json").write_text(json.dumps(metrics))
    told = capsys.readouterr().out
    assert "FAILS  wind: metrics" in told
    assert "gp_coverage_90" in told
