"""Promises of rare failures: how many new flights it takes to contradict one that is told much lower."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pareto_ltl_verify.claims.containment import RUNS, left_areas
from pareto_ltl_verify.claims.flights import MAX_FLIGHTS, promised_rate
from pareto_ltl_verify.claims.plan import WEIGHTED
from pareto_ltl_verify.evidence import BATCH, open_evidence
from pareto_ltl_verify.flights import RARE, same_rate


class Counted:
    """Evidence whose new flights fail at a known ``rate``; it counts them."""

    def __init__(self, rate: float, low: float, high: float) -> None:
        self.rate, self.rng, self.flown = rate, np.random.default_rng(11), BATCH
        self.plan = {
            "promise": {"law": "coherent", "method": WEIGHTED, "failure": low, "low": low, "high": high}
        }
        self.new_flights: dict[str, Any] = {"coherent": ()}
        self.flights = {"coherent/x": np.zeros((0, 2, 2))}
        self.ground = SimpleNamespace(failed=lambda x: np.zeros(len(x), bool))

    def new_failures(self, _law: str) -> Any:
        return self.rng.random(BATCH) < self.rate

    def more_failures(self, _law: str, runs: int) -> Iterator[tuple[int, int]]:
        for first in range(0, runs, BATCH):
            few = min(BATCH, runs - first)
            self.flown += few
            yield int(self.rng.binomial(few, self.rate)), few


def judged(rate: float, low: float, high: float) -> tuple[bool, int]:
    """Whether a promise of ``low`` to ``high`` passes where flights fail at ``rate``; the flights flown."""
    evidence: Any = Counted(rate, low, high)
    verdict = promised_rate(evidence)
    assert verdict is not None
    return verdict.holds, evidence.flown


@pytest.mark.parametrize(("true", "told"), [(8.7e-5, 3.4e-7), (8.7e-5, 1e-10), (6e-4, 6e-6)])
def test_a_rare_promise_told_much_lower_is_contradicted(true: float, told: float) -> None:
    holds, flown = judged(true, 0.9 * told, 1.1 * told)
    assert not holds
    assert flown <= MAX_FLIGHTS


@pytest.mark.parametrize(
    ("true", "wanted"), [(8e-4, BATCH), (1.6e-4, 100_000), (3.4e-7, MAX_FLIGHTS), (0.0, MAX_FLIGHTS)]
)
def test_a_true_one_passes_with_as_many_flights_as_its_rate_asks_for(true: float, wanted: int) -> None:
    assert judged(true, 0.9 * true, true) == (True, wanted)


def test_a_rate_that_is_not_rare_takes_no_further_flights() -> None:
    assert judged(0.05, 0.045, 0.055) == (True, BATCH)


@pytest.mark.statistical
def test_further_flights_fail_as_often_as_the_first_ones(honest: dict[str, Path]) -> None:
    evidence = open_evidence(honest["full"])
    first = evidence.new_failures("coherent")
    batches = list(evidence.more_failures("coherent", BATCH + 1000))
    assert [runs for _, runs in batches] == [BATCH, 1000]
    failed, runs = (sum(column) for column in zip(*batches, strict=True))
    assert same_rate(int(first.sum()), len(first), failed, runs) > RARE
    assert failed != int(first.sum())  # other random numbers


class Leaving:
    """Evidence of a containment whose new flights leave the border at a known ``rate``."""

    planned_law, x, u = "coherent", np.zeros((2, 2)), np.zeros((1, 2))

    def __init__(self, rate: float, told: float) -> None:
        self.rate, self.rng, self.flown = rate, np.random.default_rng(12), 0
        self.scene, self.remembered = {"bounds": [[-1.0, -1.0], [1.0, 1.0]]}, dict[str, Any]()
        left = {"rate": told, "low": 0.8 * told, "high": 1.25 * told}
        self.stated = {"areas": [{"name": "border", "left": left}]}

    def document(self, _name: str) -> Any:
        return self.stated

    def fly(self, _law: str, _x: Any, _u: Any, runs: int, *_seed: int) -> Any:
        self.flown += runs
        places = np.zeros((runs, 2, 2))
        places[self.rng.random(runs) < self.rate, 1] = 2.0
        return places


def leaves_as_told(rate: float, told: float) -> tuple[bool, int]:
    evidence: Any = Leaving(rate, told)
    return left_areas(evidence).holds, evidence.flown


@pytest.mark.parametrize(("true", "told"), [(3e-4, 3e-6), (2e-3, 2e-5)])
def test_a_rare_containment_told_much_lower_is_contradicted(true: float, told: float) -> None:
    holds, flown = leaves_as_told(true, told)
    assert not holds
    assert flown <= MAX_FLIGHTS


@pytest.mark.parametrize(("true", "wanted"), [(8e-4, RUNS), (1e-6, MAX_FLIGHTS)])
def test_a_true_containment_passes_with_as_many_flights_as_its_rate_asks_for(
    true: float, wanted: int
) -> None:
    assert leaves_as_told(true, true) == (True, wanted)
