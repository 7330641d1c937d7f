"""The error of a price: what flights near a limit allow, and what they do not."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pareto_ltl_verify.claims import limits

RUNS, WIDTH = 20_000, 100.0  # of a map of 100 km


def fault(monkeypatch: pytest.MonkeyPatch, price: float, error: float, near: int) -> str:
    """What is said of a price [1/m] and its error, if ``near`` of the flights come near the limit."""
    monkeypatch.setitem(limits.COUNTS, "obstacle", lambda *_: ([3, 3 + near], RUNS))
    result: Any = SimpleNamespace(
        ground=SimpleNamespace(bounds=np.array([[0.0, 0.0], [1e5, 1e5]])), barriers=[], epsilon=0.05
    )
    return limits.error_fault(result, {"kind": "obstacle", "saving": price, "error": error})


def even(price: float) -> float:
    """The error of a price for which flights are as frequent at any distance from the limit."""
    return float(np.sqrt(price / (6.0 * limits.PRICED * WIDTH)))


def soft(seed: int, count: int) -> tuple[float, float]:
    """Price and error of ``PRICED`` flights, of which ``count`` stay 7.8 to 8 τ away from the limit."""
    margin = np.random.default_rng(seed).uniform(7.8, 8.0, count)
    s = 1.0 / (1.0 + np.exp(margin))
    each = s * (1.0 - s) / WIDTH
    n = limits.PRICED
    return float(each.sum() / n), float(np.sqrt((each**2).sum() / n**2))


def test_the_error_of_an_even_density_is_right(monkeypatch: pytest.MonkeyPatch) -> None:
    assert not fault(monkeypatch, 1e-6, even(1e-6), 400)


def test_a_price_of_many_flights_at_some_distance_is_more_certain(monkeypatch: pytest.MonkeyPatch) -> None:
    price, error = soft(1, 10_000)
    assert error < even(price) / limits.SMALLER
    assert not fault(monkeypatch, price, error, 10_000 * RUNS // limits.PRICED)


@pytest.mark.parametrize("near", [0, 100])
def test_one_that_is_more_certain_than_its_flights_allow_is_not(
    monkeypatch: pytest.MonkeyPatch, near: int
) -> None:
    assert fault(monkeypatch, 1e-6, even(1e-6) / 50, near).startswith("error ")


def test_a_price_without_flights_is_not_certain(monkeypatch: pytest.MonkeyPatch) -> None:
    rare = 1e-9
    assert even(rare) > rare
    assert not fault(monkeypatch, rare, rare, 0)
    assert fault(monkeypatch, rare, rare / 10, 0)


def test_an_error_that_is_much_too_large_is_not_right(monkeypatch: pytest.MonkeyPatch) -> None:
    assert fault(monkeypatch, 1e-6, 10 * even(1e-6), 400)
