"""When a watch asks for a new plan: after a fix, and where the rest fails twice as often as it could."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.random import SeedSequence

from pareto_ltl_apps.flight.replans import APART, Replans, ReplanSettings
from pareto_ltl_apps.flight.rules import Event
from pareto_ltl_apps.flight.watch import Watch, WatchSettings
from watched import DT, PATH, PLAN, PROBLEM

PROMISED = 0.04


@pytest.fixture
def watch() -> Watch:
    """A watch at the second step, which knows the place better than the plan expected."""
    watch = Watch(PROBLEM, PLAN, WatchSettings(every=DT, members=50, alarm=1.0), SeedSequence(1))
    watch.belief.step = 2
    watch.belief.cov[:2, :2] = 0.1 * PATH.cov[2]
    return watch


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """The options of the processes that would be started."""
    found: list[list[str]] = []
    monkeypatch.setattr(Replans, "_start", lambda _replans, words: found.append(words))
    return found


def status(time: float, low: float, promised: float | None = PROMISED) -> Event:
    return {"event": "status", "time": time, "low": low, "promised": promised}


def test_a_new_plan_is_made_where_the_rest_fails_surely_twice_as_often_as_promised(
    watch: Watch, asked: list[list[str]], tmp_path: Path
) -> None:
    replans = Replans(Path("result"), tmp_path, ReplanSettings(enabled=True))
    for time, low in ((0.0, 0.5 * PROMISED), (60.0, 1.99 * PROMISED)):
        assert not list(replans.answers(watch, status(time, low)))
    assert asked == []
    list(replans.answers(watch, status(120.0, 2.01 * PROMISED)))
    (words,) = asked
    assert words[:2] == ["--time", f"{2 * DT:.17g}"]
    assert words[2].startswith("--fix=")
    list(replans.answers(watch, status(120.0 + APART, 0.9)))
    assert len(asked) == 1  # not again so soon
    list(replans.answers(watch, status(121.0 + APART, 0.9)))
    assert len(asked) == 2


def test_twice_what_the_last_new_plan_would_fail_counts_too(
    watch: Watch, asked: list[list[str]], tmp_path: Path
) -> None:
    replans = Replans(Path("result"), tmp_path, ReplanSettings(enabled=True))
    replans.least = 0.01  # of the last new plan
    list(replans.answers(watch, status(0.0, 0.021)))
    assert len(asked) == 1


@pytest.mark.parametrize("enabled", [True, False])
def test_no_new_plan_is_made_without_anything_to_learn_from(
    watch: Watch, asked: list[list[str]], tmp_path: Path, enabled: bool
) -> None:
    replans = Replans(Path("result"), tmp_path, ReplanSettings(enabled=enabled))
    if enabled:
        watch.belief.cov[:2, :2] = PATH.cov[2]  # the belief knows what the plan knows
    list(replans.answers(watch, status(0.0, 0.9)))
    assert asked == []


def test_a_fix_that_was_used_starts_a_new_plan_and_one_that_was_not_does_not(
    watch: Watch, asked: list[list[str]], tmp_path: Path
) -> None:
    replans = Replans(Path("result"), tmp_path, ReplanSettings(enabled=True))
    fix = {"event": "fix", "time": 2 * DT, "given": (1.0e3, 2.0e3), "sd": 50.0}
    list(replans.answers(watch, {**fix, "use": "refused"}))
    assert asked == []
    list(replans.answers(watch, {**fix, "use": "learnt"}))
    (words,) = asked
    assert words[0] == "--fixes"
    rows = Path(words[1]).read_text(encoding="utf-8").splitlines()
    assert rows[0] == "time,x,y,sd_m"
    assert [float(cell) for cell in rows[1].split(",")] == [2 * DT, 1.0e3, 2.0e3, 50.0]


def test_the_known_place_as_a_fix_leads_from_the_plan_to_the_belief(
    watch: Watch, asked: list[list[str]], tmp_path: Path
) -> None:
    list(Replans(Path("result"), tmp_path, ReplanSettings(enabled=True)).answers(watch, status(0.0, 0.9)))
    first, second, sd = (float(cell) for cell in asked[0][2].removeprefix("--fix=").split(","))
    planned = 0.5 * float(np.trace(PATH.cov[2]))
    variance = 1.0 / (1.0 / planned + 1.0 / sd**2)
    place = variance * (PATH.x[2] / planned + np.array([first, second]) / sd**2)
    assert variance == pytest.approx(
        0.5 * float(np.trace(watch.belief.cov[:2, :2])), rel=1e-5
    )  # written to 1 mm
    assert place == pytest.approx(watch.belief.x + watch.belief.z[:2], abs=1e-3)
