"""The room around a drawing without a border: five standard deviations of the position, computed twice."""

from __future__ import annotations

import json
import logging
import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from careful_io.times import HOUR
from map_files import DRAWN, collection, written
from pareto_ltl.planning import open_sky
from pareto_ltl.planning.open_sky import sky_room
from pareto_ltl.settings import RobotConfig, SceneConfig, Settings, WindConfig
from pareto_ltl.wind.displacement import SPACE_SHARE, displacement_variance
from pareto_ltl.wind.named_laws import law_named
from pareto_ltl.wind.readings import CALM, Readings
from pareto_ltl.world.scene_files import scene_from_dict, scene_to_dict
from pareto_ltl.world.scene_settings import scene_from_settings
from pareto_ltl.world.scene_sketch import SkyRoom
from pareto_ltl.world.time_step import fitting_step

EXACT = {"airspeed_sd": None, "heading_sd": None, "clock_sd": None, "u_max": 20.0}
TOUR = 60e3  # [m]
SLOW_FLIGHT = 1.5 * TOUR / (0.6 * 20.0)  # [s]


def readings(
    lead_hours: float, hours: Any = (0, 3, 6, 9, 12), level: str = "10m", spread: float = 3.2
) -> Readings:
    """A forecast of ``hours`` from one whose first field has the lead ``lead_hours``."""
    hours = np.asarray(hours, float)
    winds = spread * np.array([[1.0, 1.0], [-1.0, -1.0]] * 8)
    places = np.random.default_rng(0).uniform(0, 1e5, (16, 2))
    count = len(hours)
    return Readings(
        times=1.6e9 + HOUR * hours, points=(places,) * count, winds=(winds,) * count, geographic=False,
        files=(), remarks=("",) * count, origins=((),) * count, leads=HOUR * (lead_hours + hours),
        level=level,
    )  # fmt: skip


def room(found: Readings = CALM, wind: Any = "calm", planner: Any = None, **robot: Any) -> SkyRoom:
    settings = Settings.of({"wind": wind, "robot": EXACT | robot, "planner": planner or {}})
    return sky_room(settings, found, None)(TOUR)


TABLE = {"source": "csv", "path": "w.csv", "noise_min": 1e-6}


def test_forecast_errors_displace_a_flight_as_far_as_sampled_ones() -> None:
    """Errors of a flight of 6 h from the lead of 24 h on, drawn minute by minute."""
    law, found = law_named("gfs"), readings(24.0, hours=np.arange(0, 13, 1e-3 * 12), spread=1e-6)
    cfg = WindConfig(**TABLE, forecast_error="gfs")
    found = replace(found, winds=tuple(winds * 3.2e6 for winds in found.winds))  # the spread of the law
    lasting = (SPACE_SHARE * 3.2 * 6 * HOUR) ** 2
    computed = displacement_variance(cfg, found, None, 6 * HOUR) - lasting
    rng, steps, flights = np.random.default_rng(1), 360, 20_000
    moved = np.zeros(flights)
    for part in law.parts:
        z = rng.standard_normal(flights)
        for step in range(steps):
            lead = np.array(24 * HOUR + 60.0 * (step + 0.5))
            moved += 60.0 * math.sqrt(float(part.variance(lead))) * z
            kept = float(part.persistence(lead, np.array(60.0)))
            z = kept * z + math.sqrt(1 - kept**2) * rng.standard_normal(flights)
    assert computed == pytest.approx(float(moved.var()), rel=0.06)  # 5 sd of the variance of 20,000 flights


def test_the_room_is_five_standard_deviations_after_a_slow_flight() -> None:
    assert room().margin == 0.0
    own = {"airspeed_sd": 0.03, "heading_sd": math.degrees(0.04), "clock_sd": 60.0, "start_sd": 300.0}
    sd = math.sqrt((0.05 * 20 * SLOW_FLIGHT) ** 2 + (60 * 20) ** 2 + 300**2)
    assert room(**own).margin == pytest.approx(5 * sd)
    assert (
        room(**own).reason
        == "5 standard deviations of the position after a slow flight to all regions, 2.08 h"
    )
    known = room(**own, feedback_time=600.0).margin
    assert known == pytest.approx(5 * math.sqrt((0.05 * 20 * 600) ** 2 + (60 * 20) ** 2 + 300**2))


@pytest.mark.parametrize(
    ("changes", "duration", "reason"),
    [
        ({"dt": 60.0, "planner": {"max_steps": 50}}, 3000.0, "a flight of planner.max_steps"),
        (
            {"power": {"kind": "body", "base": 90.0, "drag": 0.0, "capacity": 50.0}}, 2000.0,
            "a flight on all of the energy",
        ),
    ],
)  # fmt: skip
def test_steps_and_energy_limit_the_flight(changes: dict[str, Any], duration: float, reason: str) -> None:
    found = room(**changes, airspeed_sd=0.01)
    assert found.margin == pytest.approx(5 * 0.01 * 20 * duration)
    assert reason in found.reason
    assert room(**changes, airspeed_sd=0.5).margin == pytest.approx(0.6 * 20 * duration / 2)  # and back


def test_a_wind_that_is_less_certain_needs_more_room() -> None:
    def margin(found: Readings, **wind: Any) -> float:
        return room(found, TABLE | wind, u_max=60.0).margin

    fresh, old = margin(readings(0.0)), margin(readings(48.0))
    assert 5 * SPACE_SHARE * 3.2 * SLOW_FLIGHT / 3 < fresh < old
    assert old < margin(readings(48.0), noise_min=5.0)
    sparse = readings(0.0, hours=(0, 6, 12))
    assert fresh < margin(sparse) < margin(readings(0.0, hours=(-6, 6)))
    assert margin(replace(sparse, leads=np.full(3, np.nan))) > margin(sparse)  # published 4 h after its start
    shown = readings(0.0)
    spread = tuple(np.full((16, 2, 2), 2.0) for _ in shown.times)
    assert margin(replace(shown, members=spread)) > fresh
    held = margin(readings(0.0, hours=(0,)), hold_last=True)
    assert held > margin(readings(0.0, hours=np.arange(0, 12, 0.1)))
    assert "a flight to the end of the wind" in room(readings(0.0, hours=(0, 1)), TABLE).reason


def test_a_map_has_at_least_room_to_pass_around_it_and_no_more_than_its_plane_shows(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    cfg = SceneConfig(file=str(written(tmp_path / "m.geojson", collection(*DRAWN))))
    caplog.set_level(logging.INFO)
    least = scene_from_settings(cfg, border="wall", room=lambda _tour: SkyRoom(1.0, "x"))
    np.testing.assert_array_equal(least.bounds, scene_from_settings(cfg).bounds)
    assert caplog.text.count("of the drawing (7 % of its longer side)") == 2
    tours = list[float]()

    def wide(tour: float) -> SkyRoom:
        tours.append(tour)
        return SkyRoom(40e3, "five of them")

    scene = scene_from_settings(cfg, border="wall", room=wide)
    assert scene.border == "open"
    assert tours == [
        pytest.approx(float(np.linalg.norm(scene.regions["a"][0].mean(axis=0) - scene.start)), rel=1e-3)
    ]
    drawn = np.concatenate([scene.start[None], *scene.regions["a"]])
    np.testing.assert_allclose(scene.bounds, [drawn.min(axis=0) - 40e3, drawn.max(axis=0) + 40e3])
    assert caplog.text.count("plans lie within 40.0 km of the drawing (five of them); draw a border") == 1
    again = scene_from_dict(json.loads(json.dumps(scene_to_dict(scene))))
    for one in (scene, again):
        assert fitting_step(RobotConfig(), one, 200) == fitting_step(RobotConfig(), least, 200)
    assert np.ptp(scene.bounds, axis=0).max() > 2.0 * np.ptp(least.bounds, axis=0).max()
    huge = scene_from_settings(cfg, border="wall", room=lambda _tour: SkyRoom(1e7, "x"))
    assert 0.008 < huge.frame.scale_error(huge.bounds) <= 0.01
    assert "as far as lengths in the plane of the map are right to 1 %" in caplog.text
    caplog.clear()
    walls = scene_from_settings(replace(cfg, border="wall"), border="wall", room=wide)
    assert walls.border == "wall"
    assert "open" not in caplog.text


def test_the_energy_lasts_longest_at_the_airspeed_of_least_power(monkeypatch: pytest.MonkeyPatch) -> None:
    """Power (v - 10)² + 50 W on 1 MJ; each other limit of a flight alone where it is the least."""

    def limits(capacity: float | None, base: float = 50.0, **robot: Any) -> dict[str, float]:
        model = SimpleNamespace(
            curve=SimpleNamespace(watts=lambda v: (np.asarray(v) - 10.0) ** 2 + base), capacity=capacity
        )
        monkeypatch.setattr(open_sky, "energy_model", lambda power: model)
        monkeypatch.setattr(open_sky, "known_for", lambda *_: 7000.0)
        settings = Settings.of({"wind": "calm", "robot": EXACT | robot, "planner": {"max_steps": 90}})
        return {one.reason: one.seconds for one in open_sky._limits(settings, CALM, None, TOUR)}  # noqa: SLF001

    found = limits(1e6, u_min=5.0, dt=60.0)
    assert found["a flight on all of the energy"] == pytest.approx(1e6 / 50.0, rel=1e-3)
    assert found["a flight of planner.max_steps"] == 5400.0
    assert found["a flight to the end of the wind"] == 7000.0
    assert found["a slow flight to all regions"] == SLOW_FLIGHT
    assert list(limits(None, dt="auto")) == [
        "a slow flight to all regions",
        "a flight to the end of the wind",
    ]
    assert "a flight on all of the energy" not in limits(1e6, base=-1.0, u_min=5.0)
