"""Whole missions in live forecasts, planned and verified on the command line, from a local archive."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

pytest.importorskip("pyproj")  # before ecCodes
pytest.importorskip("eccodes", reason="the extra `grib` is not installed")

from careful_io.times import seconds
from live_archives import nbm, rtofs
from noaa_server import NoaaServer, serving
from pareto_ltl_apps.cli.commands import run_command_line
from pareto_ltl_apps.formats import live
from quick_wind import wind_words


@pytest.fixture(autouse=True)
def fresh(monkeypatch, tmp_path):
    for name in ("http_proxy", "https_proxy", "HTTP_PROXY", "HTTPS_PROXY", "all_proxy", "ALL_PROXY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("PARETO_LTL_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(live, "_FETCHED", {})
    monkeypatch.setattr(live, "_now", lambda: seconds("2026-06-01T08:00:00Z"))


SMALL = [
    "planner.trees=2", "planner.n_max=800", "refine.flights=20", "refine.sweep_flights=10",
    "refine.classes=1", "refine.points=2", "selection.draws=20", "selection.runs=20",
    "deployment.runs=50", "report=none", "exports=none", "smoothing.candidates=1", *wind_words(),
]  # fmt: skip


def planned(place: Path, server: NoaaServer, *words: str) -> dict:
    """The plan of a small mission that is planned on the command line and verified."""
    words = [*words, f"wind.base_url={server.address}", *SMALL, f"hydra.run.dir={place}"]
    assert run_command_line(["plan", *words]) == 0
    assert run_command_line(["verify", str(place)]) == 0
    return json.loads((place / "plan.json").read_text())


def test_a_mission_is_planned_in_the_blend(tmp_path):
    with serving(NoaaServer(nbm("2026060106", range(1, 9)))) as server:
        plan = planned(
            tmp_path / "hop", server, "+experiment=hop", "selection.alpha=0.6", "wind=nbm", "wind.hours=5",
            "wind.level=10m", "mission.start_time=2026-06-01T07:00:00Z",
        )  # fmt: skip
    assert "nbm forecast of 2026-06-01T06:00:00Z" in (tmp_path / "hop" / "run.log").read_text()
    assert plan["promise"]["failure"] < 0.6  # what selection.alpha asks for


def test_a_glider_is_planned_in_the_surface_current_of_rtofs(tmp_path):
    shore = Path(__file__).parents[2] / "examples" / "glider_current" / "map.geojson"
    with serving(NoaaServer(rtofs("2026060100", (24, 48, 72)))) as server:
        planned(
            tmp_path / "glider", server, f"scene.file={shore}", "mission.formula='F mooring'",
            "robot=underwater_glider", "robot.level='30m depth'", "wind=rtofs", "wind.level=0m",
            "wind.hours=60", "mission.start_time=2026-06-01T07:00:00Z", "name=glider",
        )  # fmt: skip
    assert "rtofs forecast of 2026-06-01T00:00:00Z" in (tmp_path / "glider" / "run.log").read_text()
