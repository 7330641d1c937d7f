"""Promises held against what happened: bins, scores, and the verdict about each bin."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pareto_ltl.support.counts import clopper_pearson
from pareto_ltl_apps.studies import calibration


def plan(mission: int, promised: float, failure: float) -> dict[str, float | str]:
    return {
        "mission": mission, "fidelity": "full", "kind": "chosen", "simulated_coherent": promised,
        "failure": failure,
    }  # fmt: skip


def test_groups_are_of_equal_size_and_ordered_by_promise() -> None:
    rng = np.random.default_rng(3)
    rows = [plan(k, p, float(rng.uniform())) for k, p in enumerate(rng.uniform(size=20))]
    groups = calibration.reliability(rows, 4)
    assert [group["plans"] for group in groups] == [5, 5, 5, 5]
    ends = [(group["promised_least"], group["promised_most"]) for group in groups]
    assert all(a[1] <= b[0] for a, b in pairwise(ends))
    for group in groups:
        assert group["promised_least"] <= group["promised"] <= group["promised_most"]
    mean = np.mean([row["failure"] for row in rows])
    assert np.mean([group["realised"] for group in groups]) == pytest.approx(mean)


def test_a_mission_is_one_trial_however_many_plans_it_has() -> None:
    rows = [plan(0, 0.1, 1.0), plan(0, 0.1, 0.0), plan(0, 0.1, 0.5), plan(1, 0.1, 0.5)]
    (group,) = calibration.reliability(rows, 1)
    assert (group["plans"], group["missions"], group["realised"]) == (4, 2, 0.5)
    assert (group["realised_low"], group["realised_high"]) == clopper_pearson(1, 2)


def test_the_brier_score_is_least_for_the_true_probability() -> None:
    scores = {
        p: calibration.scorecard([plan(k, p, 0.3) for k in range(4)])[0]["brier"] for p in (0.1, 0.3, 0.5)
    }
    assert scores[0.3] == pytest.approx(0.3 * 0.7)
    assert scores[0.3] < min(scores[0.1], scores[0.5])


@given(truth=st.floats(0.05, 0.95), said=st.floats(0.0, 1.0))
def test_the_log_score_is_least_for_the_true_probability(truth: float, said: float) -> None:
    best, other = (calibration.log_score(np.array([p]), np.array([truth])) for p in (truth, said))
    assert best <= other + 1e-12
    assert math.isfinite(other)  # also for promises of 0 and 1


@pytest.mark.statistical
@pytest.mark.parametrize("seed", range(3))
def test_honest_promises_are_kept_and_false_ones_are_not(seed: int) -> None:
    rng = np.random.default_rng(seed)
    honest = rng.beta(0.6, 1.2, 400)
    failed = (rng.uniform(size=400) < honest).astype(float)  # all flights of a mission share its wind
    groups = calibration.reliability(
        [plan(k, p, f) for k, (p, f) in enumerate(zip(honest, failed, strict=True))], 5
    )
    # a bin of 80 is judged false by chance in 2.5 % of cases, three of five in 1.6e-4, and seeds are fixed
    assert sum(group["kept"] for group in groups) >= 3
    bold = [plan(k, 0.2 * p, f) for k, (p, f) in enumerate(zip(honest, failed, strict=True))]
    verdicts = [group["kept"] for group in calibration.reliability(bold, 5)]
    assert not any(verdicts[2:])
    (good,), (bad,) = (
        calibration.scorecard(rows)
        for rows in ([plan(k, p, f) for k, (p, f) in enumerate(zip(honest, failed, strict=True))], bold)
    )
    assert good["brier"] < bad["brier"]
    assert good["log_score"] < bad["log_score"]
    assert good["promised_sd"] == pytest.approx(honest.std())


def test_plans_of_different_kinds_and_unknown_promises_do_not_mix() -> None:
    rows = [plan(0, 0.1, 0.0), plan(1, 0.3, 1.0) | {"kind": "front"}, plan(2, math.nan, 1.0)]
    cards = calibration.scorecard(rows)
    assert [(card["kind"], card["missions"]) for card in cards] == [("chosen", 1), ("front", 1)]
    assert calibration.scorecard(rows, ("fidelity",))[0]["plans"] == 2
