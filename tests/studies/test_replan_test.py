"""Random missions flown through later winds: what is known on the way, and what it changes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from careful_io.times import HOUR, seconds
from forecast_winds import calm, context_of, settings, snapshots
from pareto_ltl.settings import preset
from pareto_ltl.support.errors import InfeasibleError
from pareto_ltl_apps.studies import replanning as study
from pareto_ltl_apps.studies.forecast_test import mission_settings
from pareto_ltl_apps.studies.random_missions import mission
from pareto_ltl_apps.studies.settings import ReplanningConfig

WAYS = ("as planned", "position always known", "1 fix", "a forecast every 2 h", "1 fix, a forecast every 2 h")


def turning(hour: float) -> tuple[float, float]:
    """A wind that grows after every departure."""
    return 2.0 + 0.8 * hour, 1.0


def known_winds(wind: object = calm):
    cfg = replace(settings(hours=10.0), replanning=ReplanningConfig(fixes=[1], forecasts=2.0))
    return context_of(snapshots(wind), cfg)


def test_no_forecast_is_used_before_it_is_available() -> None:
    known = known_winds()
    task = mission(known.cfg, 0, 0, known.spells, "open")
    departure = seconds(str(task.scene.time_zero))
    newest = []
    for after in (0.0, 3.0, 6.0, 9.0):
        readings = known.readings(task, after * HOUR)
        cycles = readings.times - readings.leads
        assert cycles.max() <= departure + (after - known.cfg.delay) * HOUR
        newest.append(cycles.max())
    assert newest[-1] - newest[0] in (6.0 * HOUR, 12.0 * HOUR)


@pytest.mark.parametrize("wind", [turning, calm])
def test_a_mission_is_flown_once_in_each_way_in_the_same_wind(wind) -> None:
    known = known_winds(wind)
    result = study.mission_part(known, 0)
    assert not result["reason"]
    assert tuple(result["flown"]) == WAYS
    planned = result["flown"]["as planned"]
    assert planned["new_plans"] == 0
    for row in result["flown"].values():
        assert row["mission"] == 0
        assert row["failed"] in (True, False)
        assert row["situation"] == planned["situation"]
    assert result["flown"]["a forecast every 2 h"]["new_plans"] <= 4
    assert study.mission_part(known, 0) == result


def test_a_newer_forecast_is_that_of_the_files() -> None:
    """In a wind that grows, the forecast at a later step says more wind than the one at departure."""
    known = known_winds(turning)
    task = mission(known.cfg, 0, 0, known.spells, "open")
    run = known.run_of(task, mission_settings(known.settings, known.cfg, task, preset("full")))
    run.make("plan")
    dt = run.problem.motion.dt
    late = study.field_cycle(known, task, run, None, 0, round(9.0 * HOUR / dt))
    before = known.readings(task)
    assert late.times.max() > before.times.max()
    assert np.mean(late.winds[-1][:, 0]) > np.mean(before.winds[-1][:, 0]) + 2.0


def test_the_table_is_of_the_missions_that_have_a_plan() -> None:
    def result(failed: dict[str, bool]) -> dict[str, object]:
        about = {"new_plans": 0, "length_m": 1e5, "situation": "s"}
        return {"reason": "", "flown": {name: about | {"failed": bad} for name, bad in failed.items()}}

    none = {"reason": "no path", "flown": {}}
    told = [none, result({"as planned": True, "1 fix": False}), result({"as planned": True, "1 fix": True})]
    made = study.missions_study(told)
    first, second = made.tables["replanning"]
    assert (first["failure"], second["failure"]) == (1.0, 0.5)
    assert second["difference"] == -0.5
    assert first["law"] == "later"
    assert made.numbers["missions"] == 3.0
    assert made.numbers["missions_planned"] == 2.0
    assert "2 of 3 random missions" in made.text
    with pytest.raises(InfeasibleError, match="no path"):
        study.missions_study([none])
