"""Questions before a flight, from a result of phi2: containment and the check of a newer forecast within 5 s.

python -m pytest benchmarks/bench_preflight.py
"""

from __future__ import annotations

import pytest

import pareto_ltl
from pareto_ltl.support.resources import SAMPLE_WINDS
from problems import MISSIONS


@pytest.fixture(scope="module")
def planned():
    """A plan of phi2 in the winds of the sample with default settings."""
    return pareto_ltl.plan("phi2", MISSIONS["phi2"], robot={"dt": 1800.0})


def test_the_containment_of_a_plan(benchmark, planned):
    """Border, one corridor, and the volumes of three levels."""
    benchmark.extra_info["budget"] = 5.0
    found = benchmark.pedantic(lambda: pareto_ltl.contain(planned, corridor=100e3), rounds=3, warmup_rounds=1)
    assert len(found.levels) == 3


def test_the_check_of_a_plan_in_a_newer_forecast(benchmark, planned):
    benchmark.extra_info["budget"] = 5.0
    limits = {"failure": 0.5}
    found = benchmark.pedantic(
        lambda: pareto_ltl.check(planned, SAMPLE_WINDS, limits=limits), rounds=3, warmup_rounds=1
    )
    assert found.items
