"""Promises of rare failures: how many new flights it takes to contradict one that is told much lower."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.stats import binom

from pareto_ltl_apps.cli.commands import run_command_line
from pareto_ltl_verify.claims.containment import RUNS, left_areas
from pareto_ltl_verify.claims.flights import MAX_FLIGHTS, promised_rate
from pareto_ltl_verify.claims.plan import WEIGHTED
from pareto_ltl_verify.evidence import BATCH, Evidence, open_evidence
from pareto_ltl_verify.flights import RARE, fly, same_rate
from pareto_ltl_verify.laws import fly_means
from pareto_ltl_verify.rare import (
    LARGEST,
    PLAIN,
    Barrier,
    Mixture,
    Stored,
    direction,
    least_rate,
    pushed,
)
from pareto_ltl_verify.tails import UnitScales


class Counted:
    """Evidence whose new flights fail at a known ``rate``; it counts them."""

    def __init__(self, rate: float, low: float, high: float) -> None:
        self.rate, self.rng, self.flown = rate, np.random.default_rng(11), BATCH
        self.plan = {
            "promise": {"law": "coherent", "method": WEIGHTED, "failure": low, "low": low, "high": high}
        }
        self.new_flights: dict[str, Any] = {"coherent": ()}
        self.flights = {"coherent/x": np.zeros((0, 2, 2))}
        self.rare_failures = np.empty(0)
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


# --- weighted flights ------------------------------------------------------------------------------


def rare_plan(folder: Path, feedback: float | None = 1000.0) -> Evidence:
    """The result of a plan whose flights seldom fail: a robot that corrects its course."""
    rule = ["selection.rule=threshold", "selection.alpha=0.0015"]  # one that fails, though seldom
    words = [
        "+experiment=phi1",
        f"robot.feedback_time={feedback}",
        "planner=quick",
        "refine.points=12",
        *rule,
    ]
    run_command_line([*words, "report=none", "exports=none", "deployment.runs=50", f"hydra.run.dir={folder}"])
    return open_evidence(folder)


@pytest.fixture(scope="module")
def rare(tmp_path_factory: pytest.TempPathFactory) -> Evidence:
    """Such a plan with a rate that is far enough from 1e-6, below which rates are not distinguished.

    Plans differ between processors, as do the eigenvectors of the wind's covariance.
    """
    folder = tmp_path_factory.mktemp("rare")
    plans = (rare_plan(folder / f"{time:g}", time) for time in (1000.0, 1500.0, 2000.0, 3000.0))
    return next(found for found in plans if 5e-5 < found.plan["promise"]["failure"] < 1e-3)


@pytest.mark.statistical
def test_the_promise_of_rare_failures_has_the_rate_of_other_weighted_flights(rare: Evidence) -> None:
    promise, weights = rare.plan["promise"], rare.rare_failures
    assert promise["method"] == WEIGHTED
    error = 6.0 * weights.std() / math.sqrt(len(weights)) + 2.0 * (promise["high"] - promise["low"])
    assert weights.mean() == pytest.approx(promise["failure"], abs=error)
    assert weights.max() <= LARGEST
    assert (weights > 0.0).sum() > 500  # most are drawn where flights fail
    plain = rare.fly("coherent", rare.x, rare.u, 20_000, 5)
    failed = int(rare.ground.failed(plain).sum())
    assert binom.cdf(failed, 20_000, weights.mean()) > RARE
    assert binom.sf(failed - 1, 20_000, weights.mean()) > RARE


@pytest.mark.parametrize("factor", [1e-6, 0.3])  # of a rate of about 2e-4
def test_a_rare_promise_told_lower_is_contradicted_by_weighted_flights(rare: Evidence, factor: float) -> None:
    """By weighted flights alone: plain ones, far too few here, would not see it."""
    told: Any = Counted(0.0, factor * rare.plan["promise"]["low"], factor * rare.plan["promise"]["high"])
    assert promised_rate(told).holds
    told.rare_failures = rare.rare_failures
    assert not promised_rate(told).holds
    true: Any = Counted(0.0, rare.plan["promise"]["low"] / 1e3, rare.plan["promise"]["high"])
    true.rare_failures = rare.rare_failures
    assert promised_rate(true).holds


@pytest.mark.parametrize("held", [True, False])
def test_directions_have_the_deviations_of_the_course(rare: Evidence, held: bool) -> None:
    """|ω|² is a' Cov(e_t) a, and what flights along ω do is what the linear law says."""
    law = rare.law("coherent")
    robot = law.robot if held else replace(law.robot, feedback_time=None)
    law = replace(law, robot=robot)
    course = fly_means(law, rare.x)
    for t in (1, 7, len(course.u)):
        a = np.array([0.6, -0.8])
        omega = direction(law, course, Barrier(0.0, {t: a}), robot)
        assert omega @ omega == pytest.approx(a @ course.cov[t] @ a, rel=1e-9)
        little = np.stack([1e-3 * omega / np.linalg.norm(omega), np.zeros(len(omega))])
        x = fly(law, rare.x, course.u, 2, Stored(little, UnitScales()))
        assert (x[0, t] - x[1, t]) @ a == pytest.approx(1e-3 * np.linalg.norm(omega), rel=0.35)


def test_least_rates_are_the_lower_ends_of_intervals() -> None:
    hits = np.zeros(1000)
    hits[:9] = 1.0
    assert least_rate(hits, 0.025) == pytest.approx(4.12e-3, rel=0.02)  # Clopper-Pearson
    assert least_rate(np.zeros(10), 0.025) == 0.0
    assert least_rate(0.1 * hits, 0.025) == pytest.approx(0.1 * least_rate(hits, 0.025))


@pytest.mark.parametrize("scale", [3.0, 1.0, 0.3, 0.02])
def test_the_weights_of_all_pushed_flights_have_the_mean_one(scale: float) -> None:
    """Also where errors are so small that the probability of a half-space is no float any more."""
    n, omega = 40_000, np.array([[1.0, 0.0, 0.0], [0.6, 0.8, 0.0]])
    which, reach = np.array([0, 1, 1]), np.array([2.0, 3.0, 1.5])
    mixture = Mixture(omega, which, reach, np.full(3, (1.0 - PLAIN) / 3.0))
    rng = np.random.default_rng(4)
    z = rng.standard_normal((n, 3))
    weight = 1.0 / (PLAIN + pushed(mixture, z, np.full(n, scale), rng).sum(axis=1))
    assert weight.max() <= 1.0 / PLAIN
    assert weight.mean() == pytest.approx(1.0, abs=5.0 * weight.std() / math.sqrt(n))
    off = z * weight[:, None]
    assert (np.abs(off.mean(axis=0)) <= 5.0 * off.std(axis=0) / math.sqrt(n)).all()


def test_stored_numbers_are_given_in_order_and_once() -> None:
    source = Stored(np.arange(12.0).reshape(2, 6), UnitScales())
    np.testing.assert_array_equal(source.standard_normal((2, 2)), [[0, 1], [6, 7]])
    np.testing.assert_array_equal(source.standard_normal((2, 4)), [[2, 3, 4, 5], [8, 9, 10, 11]])
    with pytest.raises(IndexError, match="6 numbers"):
        source.standard_normal((2, 1))
    with pytest.raises(ValueError, match="one source"):
        source.spawn(2)


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
