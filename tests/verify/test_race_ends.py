"""The flights that rank a front may end before all are flown, but only once every path has failed often."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pareto_ltl.simulation import judging
from pareto_ltl_verify.claims import front


def evidence(flights: int, failures: tuple[int, ...], draws: int) -> Any:
    failed = np.arange(flights) < np.array(failures)[:, None]
    return SimpleNamespace(front_arrays={"failed": failed}, settings={"selection": {"draws": draws}})


@pytest.mark.parametrize(("flights", "failures", "draws", "fault"), [
    (16_000, (900, 3), 16_000, ""),
    (4000, (900, 200), 16_000, ""),
    (4000, (900, 199), 16_000, "4000 flights of 16000, of which 199 of one path fail"),
    (3000, (900, 200), 16_000, "3000 flights of 16000"),
    (500, (300, 200), 16_000, "500 flights of 16000"),
    (16_000, (900, 300), 8000, "16000 flights of 8000"),
    (300, (20, 3), 300, ""),
    (250, (220, 210), 300, "250 flights of 300"),
])  # fmt: skip
def test_fewer_flights_than_the_settings_ask_for_need_enough_failures(
    flights: int, failures: tuple[int, ...], draws: int, fault: str
) -> None:
    assert "".join(front.ended_too_early(evidence(flights, failures, draws))) == fault


def test_the_planner_ends_where_the_checker_lets_it() -> None:
    assert (front.ENOUGH, front.LEAST_FLIGHTS) == (judging.ENOUGH, judging.LEAST_FLIGHTS)
