"""A wind file with temperatures: from the table to both airspeeds of the plan, and what verify finds out."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pareto_ltl
from lies.editing import holds
from pareto_ltl.run.plan_run import Run
from pareto_ltl_verify.judge import verify
from small_plans import COMMON

HOURS, WARMTH = (0, 6, 12, 18, 24), (20.0, 21.0, 24.0, 30.0, 20.0)  # [h], [deg C]
CLAIM = "height: air and calibrated airspeeds"


def table(path: Path, *, warm: bool) -> Path:
    """Winds about phi1, in air that warms during the flight."""
    titles = ",temperature_c,pressure_hpa" if warm else ""
    lines = [f"time,lat,lon,u,v{titles}"]
    for hour, celsius in zip(HOURS, WARMTH, strict=True):
        day, clock = divmod(18 + hour, 24)
        for lat in range(30, 46, 2):
            for lon in range(-104, -82, 3):
                air = f",{celsius + 0.1 * (lat - 38)},960" if warm else ""
                u, v = 0.5 * np.sin(lat), 0.5 * np.cos(lon)
                lines.append(f"2018-10-{9 + day:02d}T{clock:02d}:00Z,{lat},{lon},{u:.3f},{v:.3f}{air}")
    path.write_text("\n".join(lines) + "\n")
    return path


def planned(place: Path, *, warm: bool, **robot: Any) -> Path:
    path = table(place.with_suffix(".csv"), warm=warm)
    settings = COMMON | {"robot": COMMON["robot"] | {"level": "100m"} | robot}
    wind = COMMON["wind"] | {"source": "csv", "path": str(path), "level": "80m", "max_gap": 6.0}
    mission = {"start_time": "2018-10-09T18:00:00Z"}
    pareto_ltl.plan("phi1", "F a", **settings | {"wind": wind, "mission": mission, "out": place})
    return place


@pytest.fixture(scope="module")
def warm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return planned(tmp_path_factory.mktemp("made") / "warm", warm=True)


def test_the_plan_has_the_air_of_the_file_and_all_claims_hold(warm: Path) -> None:
    plan = json.loads((warm / "plan.json").read_text(encoding="utf-8"))
    hours = np.array(plan["t"]) / 3600.0
    celsius = float(np.interp(hours, HOURS, WARMTH).mean())
    assert plan["air"]["temperature"] - 273.15 == pytest.approx(celsius - 0.13, abs=0.6)  # 20 m higher
    assert plan["air"]["pressure"] == pytest.approx(96_000.0 * np.exp(-20.0 / 8600.0), rel=1e-3)
    assert "the temperature of the wind file" in plan["air"]["source"]
    factor = np.sqrt(plan["air"]["density_ratio"])
    np.testing.assert_allclose(plan["airspeed_calibrated"], factor * np.array(plan["airspeed"]), rtol=1e-6)
    assert not [finding for finding in verify(warm) if not finding.holds]
    assert Run.open(warm).plan.air is not None
    assert "the temperature of the wind file" in pareto_ltl.explain(warm)


@pytest.mark.parametrize("change", [{"temperature": 288.15}, {"pressure": 100_129.0}])
def test_another_air_is_found_out(warm: Path, tmp_path: Path, change: dict[str, float]) -> None:
    place = tmp_path / "lie"
    shutil.copytree(warm, place)
    path = place / "plan.json"
    plan = json.loads(path.read_text(encoding="utf-8"))
    air = plan["air"] | change
    air["density_ratio"] = air["pressure"] / air["temperature"] * 288.15 / 101_325.0
    calibrated = (np.sqrt(air["density_ratio"]) * np.array(plan["airspeed"])).tolist()
    path.write_text(json.dumps(plan | {"air": air, "airspeed_calibrated": calibrated}), encoding="utf-8")
    assert not holds(place, CLAIM)


def test_a_file_without_air_leaves_no_trace(tmp_path: Path) -> None:
    """The same winds: the same path, the standard atmosphere, and no variables of the air in wind.nc."""
    plain = Run.open(planned(tmp_path / "plain", warm=False))
    assert plain.wind.air is None
    assert plain.plan.air is not None
    assert plain.plan.air.source.startswith("the standard atmosphere")
    assert not [finding for finding in verify(tmp_path / "plain") if not finding.holds]


def test_a_contradiction_is_a_warning_and_the_settings_win(tmp_path: Path) -> None:
    place = planned(tmp_path / "cold", warm=True, air_temperature=-20.0)
    log = (place / "run.log").read_text(encoding="utf-8")
    assert "robot.air_temperature=-20 is used, but the wind file has 2" in log
    assert json.loads((place / "plan.json").read_text())["air"]["temperature"] == pytest.approx(253.15)
    assert not [finding for finding in verify(place) if not finding.holds]
