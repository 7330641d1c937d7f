"""Every ready vehicle plans: its airspeeds, its energy and its level hold in what a run writes."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pareto_ltl
from pareto_ltl.run.plan_run import Run
from pareto_ltl.settings import Settings, WindConfig
from pareto_ltl.support.errors import ConfigError, DataError, InfeasibleError
from pareto_ltl.support.levels import level_mismatch
from pareto_ltl.support.resources import CONF
from pareto_ltl_apps.cli.commands import run_command_line
from pareto_ltl_verify.judge import verify
from quick_wind import QUICK_WIND

pytestmark = pytest.mark.no_cover  # other tests run the same lines, and coverage is slow

VEHICLES = sorted(set(CONF.names("robot")) - {"airframe"})
IN_AIR = ("fixed_wing", "long_endurance", "multirotor")  # fast enough for the packaged winds
SMALL: dict[str, Any] = {
    "planner": {"trees": 2, "n_max": 500, "threads": 1},
    "smoothing": {"candidates": 1, "weights": [10.0]},
    "refine": {"flights": 200, "sweep_flights": 60, "points": 5, "classes": 1},
    "selection": {"draws": 300, "runs": 600},
    "deployment": {"runs": 50},
    "report": "none",
}


def site(name: str) -> dict[str, Any]:
    """A map of 40 minutes of flight a side, for a vehicle of any speed."""
    robot = Settings.of_section("robot", name)
    return {
        "unit": 40.0 * robot.u_max, "centre": [37.0, -92.0], "bounds": [[0, 0], [40, 40]], "start": [5, 5],
        "regions": {"a": [[26, 6], [34, 6], [34, 14], [26, 14]], "b": [[6, 26], [14, 26], [14, 34], [6, 34]]},
        "obstacles": [[[16, 15], [21, 15], [21, 20], [16, 20]]],
    }  # fmt: skip


def robot_of(name: str, wind: str) -> dict[str, Any]:
    """The vehicle with all the energy it needs, and at the level of the packaged winds where they blow."""
    from careful_io.yaml_files import read_yaml
    from pareto_ltl.support.resources import CONF

    told: dict[str, Any] = read_yaml(CONF.file("robot", name))
    told["power"]["capacity"] = 1e6
    return told | ({"level": "10m"} if wind == "sample" else {})


@pytest.mark.parametrize("fidelity", ["paper", "full"])
@pytest.mark.parametrize(
    ("name", "wind"), [*((name, "calm") for name in VEHICLES), *((name, "sample") for name in IN_AIR)]
)
def test_all_paths_of_a_vehicle_keep_its_airspeeds_and_tell_its_energy(
    name: str, wind: str, fidelity: str, tmp_path: Path
) -> None:
    robot = robot_of(name, wind)
    found = pareto_ltl.plan(
        site(name), "F(a & F b)", robot=robot, wind=wind, fidelity=fidelity, out=tmp_path, **SMALL
    )
    curve = Settings.of_section("robot", robot)
    for path in found.front.paths:
        speed = np.linalg.norm(path.u, axis=1)
        assert speed.min() >= robot["u_min"] * (1 - 1e-6)
        assert speed.max() <= robot["u_max"] * (1 + 1e-6)
        assert found.problem.energy is not None
        watts = found.problem.energy.curve.watts(speed)
        brute = sum(float(p) * found.plan.dt for p in watts)
        assert path.objectives.costs["energy"] == pytest.approx(brute, rel=1e-12)
    with (tmp_path / "front.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["energy_j"]) for row in rows] == [
        p.objectives.costs["energy"] for p in found.front.paths
    ]
    told, metrics = (json.loads((tmp_path / f"{name}.json").read_text()) for name in ("plan", "metrics"))
    assert told["objectives"]["energy"] == metrics["energy_j"] == found.plan.path.objectives.costs["energy"]
    assert told["capacity"] == 3600.0 * curve.power.capacity
    assert metrics["energy_share"] == metrics["energy_j"] / told["capacity"]
    kept = Run.open(tmp_path)
    assert kept.front.raw == found.front.raw
    assert kept.plan.capacity == told["capacity"]
    assert all(finding.holds for finding in verify(tmp_path))


def test_a_choice_by_energy_is_cheaper_and_can_be_made_later(tmp_path: Path) -> None:
    place = tmp_path / "first"
    robot = robot_of("fixed_wing", "sample")
    first = pareto_ltl.plan(
        site("fixed_wing"), "F(a & F b)", robot=robot, fidelity="full", out=place, **SMALL
    )
    rates = [rate.high for rate in first.front.rates]
    limit = 0.5 * (min(rates) + 1.0)
    slower = [path for path in first.front.paths if "slower" in path.origin]
    assert slower  # of plans that take less energy than those that fail least
    other = pareto_ltl.choose(Run.open(place), energy=limit, out=tmp_path / "second")
    allowed = [
        p.objectives.costs["energy"]
        for p, high in zip(first.front.paths, rates, strict=True)
        if high <= limit
    ]
    assert other.plan.rule == "energy"
    assert other.plan.path.objectives.costs["energy"] == min(allowed)
    assert other.plan.path.objectives.costs["energy"] < first.plan.path.objectives.costs["energy"]


def test_a_battery_that_no_path_keeps_to_ends_the_run_with_a_cure(tmp_path: Path) -> None:
    robot = robot_of("fixed_wing", "calm")
    robot["power"]["capacity"] = 1.0
    with pytest.raises(
        InfeasibleError, match=r"every path of the front needs more than robot\.power\.capacity"
    ):
        pareto_ltl.plan(
            site("fixed_wing"),
            "F(a & F b)",
            robot=robot,
            wind="calm",
            fidelity="paper",
            out=tmp_path,
            **SMALL,
        )
    assert (tmp_path / "front.csv").is_file()
    assert all(finding.holds for finding in verify(tmp_path))


# --- levels ---------------------------------------------------------------------------------------


def test_the_wind_is_taken_where_the_robot_flies_unless_told_otherwise() -> None:
    assert Settings().wind.level == "10m"
    wing = Settings.of_section("robot", "fixed_wing")
    assert Settings(robot=wing).wind.level == "100m"
    assert Settings(robot=wing, wind=WindConfig(level="80m")).wind.level == "80m"
    currents = WindConfig(source="currents", path="x")
    assert Settings(wind=currents).wind.level == "0m"
    assert (
        Settings(wind=currents, robot=Settings.of_section("robot", "underwater_glider")).wind.level
        == "100m depth"
    )
    assert currents.level == "auto"  # of others who hold it
    for source, in_air, in_water in (
        ("csv", "10m", "100m depth"),
        ("stations", "10m", "100m depth"),
        ("netcdf", "100m", "100m depth"),
    ):
        table = WindConfig(source=source, path="x")
        assert Settings(robot=wing, wind=table).wind.level == in_air
        glider = Settings.of_section("robot", "underwater_glider")
        assert Settings(robot=glider, wind=table).wind.level == in_water
        assert Settings(robot=wing, wind=replace(table, level="80m")).wind.level == "80m"


def test_a_wind_of_another_level_is_told_and_that_of_another_medium_refused(
    caplog: pytest.LogCaptureFixture,
) -> None:
    assert level_mismatch("100m", "80m") == level_mismatch("0m depth", "0m depth") == ""
    assert "925 hPa, and the wind used is 10 m" in level_mismatch("925hPa", "10m")
    for one, other in (("100m depth", "10m"), ("100m", "0.5m depth")):
        with pytest.raises(ConfigError, match=r"what is known is a (wind|current)"):
            level_mismatch(one, other)
    with pytest.raises(ConfigError, match=r"robot\.level=100m depth is a depth, and what is known is a wind"):
        pareto_ltl.plan(site("underwater_glider"), "F(a & F b)", robot="underwater_glider", **SMALL)
    small = SMALL | {"fidelity": "paper", "robot": "fixed_wing"}
    result = pareto_ltl.plan(site("fixed_wing"), "F(a & F b)", **small)
    gap = "the robot flies 100 m above ground, and the wind used is 10 m above ground"
    assert gap in caplog.text
    assert gap in result.plan.not_covered


def write_table(path: Path, hours: Iterable[int], northwards: float, eastwards: float) -> None:
    """A table of flows that grow by ``northwards`` and ``eastwards`` [m/s] a degree."""
    rows = [
        f"2018-10-09T{hour:02d}:00:00Z,{lat},{lon},{northwards * (lat - 30)},{eastwards * (lon + 80)}"
        for hour in hours for lat in (34, 36, 38, 40) for lon in (-96, -92, -88)
    ]  # fmt: skip
    path.write_text("\n".join(["time,lat,lon,u,v", *rows]) + "\n")


def test_the_stated_level_of_a_table_stands_in_all_that_a_run_writes(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    write_table(tmp_path / "w.csv", (0, 3, 6), 0.1, 0.02)
    small = SMALL | {"fidelity": "paper", "robot": "fixed_wing", "report": {"formats": ["png"], "page": True}}
    wind = QUICK_WIND | {"source": str(tmp_path / "w.csv"), "forecast_error": "none"}
    gap = "the robot flies 100 m above ground, and the wind used is 10 m above ground"
    for level, used, mismatch in (({}, "10m", True), ({"level": "100m"}, "100m", False)):
        out = tmp_path / used
        pareto_ltl.plan(site("fixed_wing"), "F(a & F b)", wind=wind | level, out=out, **small)
        plan = json.loads((out / "plan.json").read_text())
        assert f"wind at {used} of csv" in plan["covered"]
        assert (gap in plan["not_covered"]) == mismatch == (gap in (out / "run.log").read_text())
        page = (out / "report.html").read_text()
        assert f"wind at {used}" in page
        assert (gap in page) == mismatch
        assert run_command_line(["verify", str(out), "--json"]) == 0
        assert run_command_line(["explain", str(out)]) == 0
        told = " ".join(capsys.readouterr().out.split())
        assert f"wind at {used} of csv" in told
        assert ("the wind used is 10 m" in told) == mismatch


def test_a_mission_in_the_water_is_told_in_words_of_the_water_and_verified(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """A table for a glider has its current; everything that states a rate or a speed says so."""
    write_table(tmp_path / "w.csv", (0, 6, 12), 0.002, 0.0005)
    small = SMALL | {"robot": "underwater_glider", "report": {"formats": ["png"], "page": True}}
    wind = QUICK_WIND | {"source": str(tmp_path / "w.csv"), "forecast_error": "none", "noise_min": 0.01}
    out = tmp_path / "g"
    pareto_ltl.plan(site("underwater_glider"), "F(a & F b)", wind=wind, out=out, **small)
    assert json.loads((out / "plan.json").read_text())["covered"].startswith("current at 100m depth of csv")
    page = (out / "report.html").read_text()
    assert "coherent currents" in page.partition("<script")[0]
    assert 'id="layer-wind" checked> current</label>' in page
    assert run_command_line(["verify", str(out)]) == 0
    assert "FAILS" not in capsys.readouterr().out
    for words in ([], ["--limits"]):
        assert run_command_line(["explain", str(out), *words]) == 0
        told = capsys.readouterr().out.replace("w.csv", "")
        assert "current" in told
        assert not any(word in told for word in ("wind", "airspeed", "flies"))


def test_what_no_vehicle_is_gets_one_line(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    for words, text in (
        (["robot=multirotr"], "multirotor"),
        (["selection=energy"], "selection.rule=energy needs the power curve of the robot"),
        (["selection.rule=weighted", "selection.weights=[1,1,1,1]"], "the fourth of selection.weights needs"),
        (["selection.rule=least"], "selection.least=energy needs the power curve of the robot"),
        (["selection.rule=least", "selection.least=turns"], "selection.least=turns is none of the costs"),
        (["selection.costs=[turns]", "selection.weights=[1,1,1,1,1]"], "has more numbers than the costs"),
        (["selection.costs=[turn]"], "selection.costs"),
        (["wind.level=80m"], "wind.level=80m: the packaged sample has winds 10 m above ground only"),
        (["robot=fixed_wing", "robot.u_min=21"], "robot.u_min = 21 m/s is above robot.u_max = 20 m/s"),
    ):
        assert run_command_line(["+experiment=phi1", *words, f"hydra.run.dir={tmp_path}"]) == 2
        told = capsys.readouterr().err
        assert text in told
        assert told.count("\n") == 1


def test_a_vehicle_slower_than_the_flow_is_told_so() -> None:
    robot = Settings.of_section("robot", "underwater_glider")
    robot.level = None
    with pytest.raises((DataError, InfeasibleError)) as caught:
        pareto_ltl.plan(site("underwater_glider"), "F(a & F b)", robot=robot, wind="sample", **SMALL)
    assert "\n" not in str(caught.value)
    assert "robot.u_max" in str(caught.value)
