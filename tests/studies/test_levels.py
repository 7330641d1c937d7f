"""Levels compared: which is recommended, when they cannot be told apart, and what a climb takes."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from careful_io.reading import read_json
from pareto_ltl.settings import PowerConfig, RobotConfig, Settings
from pareto_ltl.support.errors import ConfigError
from pareto_ltl_apps.cli.commands import run_command_line
from pareto_ltl_apps.studies.departure_fronts import compare_fronts
from pareto_ltl_apps.studies.departure_table import front_of
from pareto_ltl_apps.studies.levels import (
    Candidate,
    climb_energy,
    level_rows,
    level_settings,
    levels_study,
    median_ratio,
    recommendation,
)
from pareto_ltl_apps.studies.settings import LevelsConfig
from quick_wind import wind_words

GOOD, WORSE = {1000.0: 200, 1500.0: 60}, {1000.0: 800, 1500.0: 300}
NAMES = ("10m", "80m", "925hPa")


def result(counts: dict[float, int], n: int = 2000) -> dict[str, Any]:
    """What a level has whose paths of these lengths [m] fail so often."""
    paths = [
        {
            "length_m": length, "duration_s": 7200.0, "steps": 4, "order": "a", "origin": "tree",
            "failed": "1" * failures + "0" * (n - failures), "x": [[0.0, 0.0], [length, 1.0]],
        }
        for length, failures in counts.items()
    ]  # fmt: skip
    conditions = {"wind_speed": 3.0, "wind_sd": 1.0, "tail_wind": 0.5, "end_sd_m": 10.0}
    return {
        "planned": True, "law": "coherent", "plan": 0, "paths": paths, "metrics": {},
        "conditions": conditions, "height_m": 100.0,
    }  # fmt: skip


def compared(*counts: dict[float, int] | None) -> tuple[Settings, list[dict[str, Any]], Any, Any]:
    settings = replace(Settings(), levels=LevelsConfig(levels=list(NAMES), flights=2000))
    none = {"planned": False, "data": True, "reason": "no wind 80 m above ground"}
    found = {float(k): [result(c) if c else none] for k, c in enumerate(counts)}
    fronts = {k: [front_of(r[0]["paths"], 2000)] for k, r in found.items() if r[0]["planned"]}
    comparison = compare_fronts(fronts)
    candidates = [Candidate(name) for name in NAMES[: len(counts)]]
    return settings, level_rows(settings, candidates, found, comparison), comparison, found


def test_the_level_that_fails_less_is_recommended() -> None:
    _, rows, comparison, _ = compared(WORSE, None, GOOD)
    assert [row["recommended"] for row in rows] == [False, False, True]
    said = recommendation(rows, comparison)
    assert said.startswith("**Fly at 925hPa**")
    assert "10m 4." in said
    assert median_ratio(rows) == pytest.approx(0.5 * (1.0 + rows[0]["ratio"]))


def test_levels_that_do_not_differ_cannot_be_told_apart() -> None:
    _, rows, comparison, _ = compared({1000.0: 205, 1500.0: 62}, WORSE, GOOD)
    said = recommendation(rows, comparison)
    assert said.startswith("**Cannot tell between 10m, 925hPa**")
    assert "The others fail more often: 80m" in said


def test_the_study_names_the_reason_of_a_level_without_a_plan() -> None:
    settings, rows, comparison, found = compared(WORSE, None, GOOD)
    study = levels_study(settings, rows, comparison, found)
    assert "- 80m: no plan: no wind 80 m above ground" in study.text
    assert study.numbers["levels_planned"] == 2.0
    assert {row["name"] for row in study.tables["level_lengths"]} == {"10m", "925hPa"}


def test_the_energy_of_a_climb_is_the_height_energy_over_the_efficiency() -> None:
    power = PowerConfig(kind="body", base=1.0, drag=0.1)
    settings = replace(
        Settings(), robot=RobotConfig(power=power), levels=LevelsConfig(mass=2.0, climb_efficiency=0.5)
    )
    assert climb_energy(settings, 100.0) == pytest.approx(2.0 * 9.80665 * 100.0 / 0.5)
    assert climb_energy(settings, -5.0) == 0.0
    assert math.isnan(climb_energy(replace(settings, levels=LevelsConfig()), 100.0))
    assert math.isnan(climb_energy(replace(settings, robot=RobotConfig()), 100.0))


def test_a_candidate_is_a_run_at_its_level_and_departure() -> None:
    mine = level_settings(Settings(), Candidate("925hPa", 1539043200.0))
    assert mine.wind.level == mine.robot.level == "925hPa"
    assert mine.mission.start_time == "2018-10-09T00:00:00Z"
    assert Candidate("925hPa", 1539043200.0).name == "925hPa 2018-10-09T00:00:00Z"


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"levels": ["high"]}, "levels.levels 'high' is not a level"),
        ({"levels": ["925hPa", "92500Pa"]}, "lists a level twice"),
        ({"levels": ["10m"], "starts": [3]}, "levels.starts must be ISO 8601 times"),
        ({"mass": -1.0}, "levels.mass"),
    ],
)
def test_bad_settings_are_one_line(values: dict[str, Any], said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        LevelsConfig(**values)


# --- from end to end --------------------------------------------------------------------------


def forecast(path: Path) -> Path:
    """Winds at two pressures: light ones below, a strong head wind above."""
    xr = pytest.importorskip("xarray")
    lat, lon, hours = np.arange(32.0, 43.0), np.arange(-99.0, -84.0), np.arange(0.0, 40.0, 3.0)
    shape = (len(hours), 2, len(lat), len(lon))
    u = np.zeros(shape)
    u[:, 0], u[:, 1] = 1.0, -14.0
    v = 0.3 * np.ones(shape)
    dims = ("time", "level", "lat", "lon")
    data = {
        name: (dims, values, {"units": "m s-1", "standard_name": f"{way}ward_wind"})
        for name, values, way in (("u", u, "east"), ("v", v, "north"))
    }
    coords = {
        "time": ("time", hours, {"units": "hours since 2018-10-09 00:00:00", "standard_name": "time"}),
        "level": ("level", [1000.0, 850.0], {"units": "hPa", "standard_name": "air_pressure"}),
        "lat": ("lat", lat, {"units": "degrees_north", "standard_name": "latitude"}),
        "lon": ("lon", lon, {"units": "degrees_east", "standard_name": "longitude"}),
    }
    xr.Dataset(data, coords).to_netcdf(path)
    return path


SMALL = (
    "+experiment=phi2", "fidelity=paper", "planner.trees=2", "planner.n_max=1500", "levels.flights=400",
    "levels.seeds=1", "report.dpi=40", "evaluation.jobs=1", "wind=netcdf", *wind_words(),
)  # fmt: skip


def test_the_command_plans_each_level_of_a_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    words = [*SMALL, f"wind.path={forecast(tmp_path / 'two.nc')}"]
    listed = "levels.levels=[1000hPa,850hPa,700hPa]"
    assert run_command_line(["levels", *words, listed, "hydra.run.dir=out"]) == 0
    found = read_json(tmp_path / "out" / "levels.json")
    below, above, missing = found["levels"]
    assert found["schema"] == "pareto_ltl.levels/1"
    assert below["planned"]
    assert below["ratio"] <= (above["ratio"] or math.inf)
    assert not missing["planned"]
    assert "700hPa" in missing["reason"] or "700 hPa" in missing["reason"]
    figures = {path.name for path in (tmp_path / "out" / "figures").iterdir()}
    assert figures == {"levels.png", "levels_heat.png"}
    capsys.readouterr()
    assert run_command_line(["levels", *words, "levels.levels=[10m]", "hydra.run.dir=one"]) == 2
    assert run_command_line(["levels", *words, "levels.levels=[80m,10m]", "hydra.run.dir=none"]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 2
