"""A budget of time: what is left of it, and Ctrl-C as its end."""

from __future__ import annotations

import math
import os
import signal
import threading

import pytest

from pareto_ltl.support import budget as module
from pareto_ltl.support.budget import UNLIMITED, Budget


@pytest.fixture
def clock(monkeypatch):
    """A clock that the test sets: ``clock[0]`` [s]."""
    now = [100.0]
    monkeypatch.setattr(module.time, "perf_counter", lambda: now[0])
    return now


def test_a_share_is_over_when_it_is_spent(clock):
    budget = Budget(10.0)
    clock[0] += 50.0  # it begins when it is told to
    budget.begin()
    assert budget.left() == 10.0
    assert budget.left(0.2) == 2.0
    clock[0] += 3.0
    budget.begin()  # and once only
    assert budget.left() == 7.0
    assert budget.over(0.2)
    assert not budget.over()
    clock[0] += 7.0
    assert budget.over()


def test_a_part_has_shares_of_its_own(clock):
    budget = Budget(10.0)
    budget.begin()
    part = budget.until(0.6)
    clock[0] += 1.0
    assert part.left() == pytest.approx(5.0)
    assert part.left(0.5) == pytest.approx(2.0)
    clock[0] += 5.0
    assert part.over()
    assert not budget.over()
    assert UNLIMITED.until(0.6).left() == math.inf
    budget = Budget(10.0)
    budget.end()
    assert budget.until(0.6).over()


def test_without_seconds_there_is_no_end_and_no_clock(monkeypatch):
    monkeypatch.setattr(module.time, "perf_counter", None)
    assert UNLIMITED.left() == math.inf
    assert not UNLIMITED.over(0.01)


def test_asked_for_its_end_a_budget_is_over():
    for budget in (Budget(1e6), Budget()):
        budget.end()
        assert budget.over(0.01)


def test_the_first_key_ends_the_budget_and_the_second_the_run(caplog):
    before = signal.getsignal(signal.SIGINT)
    budget = Budget(1e6)
    with budget.ends_at_key():
        with pytest.raises(KeyboardInterrupt):  # its work has not begun
            os.kill(os.getpid(), signal.SIGINT)
        budget.heeded = True
        os.kill(os.getpid(), signal.SIGINT)
        assert budget.over()
        assert "Ctrl-C again ends the run" in caplog.text
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is before


def test_without_a_budget_or_outside_the_main_thread_the_key_is_left_alone():
    before = signal.getsignal(signal.SIGINT)
    seen = []

    def look():
        with Budget(1.0).ends_at_key():
            seen.append(signal.getsignal(signal.SIGINT))

    with UNLIMITED.ends_at_key():
        seen.append(signal.getsignal(signal.SIGINT))
    thread = threading.Thread(target=look)
    thread.start()
    thread.join()
    assert seen == [before, before]
