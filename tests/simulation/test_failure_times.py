"""When flights fail: the same flights as the verdict, at the first step at which a prefix has failed."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.random import SeedSequence

import pareto_ltl
from exported_plans import SMALL
from pareto_ltl.extend import simulate_flights
from pareto_ltl.planning.problem import Problem
from pareto_ltl.simulation.records import BROKEN, COLLIDED, MISSED, OFF_MAP, Deployment


@pytest.fixture(scope="module", params=["F(a & F b & F c)", "!c U b"])
def flown(request: pytest.FixtureRequest) -> tuple[Problem, Deployment]:
    result = pareto_ltl.plan("phi1", request.param, **SMALL)
    path = result.plan.path
    poor = 1.3 * path.u  # so that flights fail of all causes
    return result.problem, simulate_flights(result.problem, poor, 300, "coherent", SeedSequence(7), path.x)


def test_flights_that_fail_are_those_of_the_verdict(flown: tuple[Problem, Deployment]) -> None:
    problem, deployment = flown
    times = deployment.failure_times(problem)
    assert deployment.failed.any()
    assert ((times.step >= 0) == deployment.failed).all()
    assert ((times.cause >= 0) == deployment.failed).all()
    assert times.counts()[:, -1].sum() == deployment.failed.sum()


def test_a_flight_fails_at_the_first_prefix_that_has_failed(flown: tuple[Problem, Deployment]) -> None:
    problem, deployment = flown
    times, last = deployment.failure_times(problem), deployment.x.shape[1] - 1
    for k in range(1, last + 1):
        prefix = Deployment.judged(problem, deployment.law, np.ascontiguousarray(deployment.x[:, : k + 1]))
        met = prefix.collided | (prefix.off_map & prefix.walled)
        known = (times.step >= 0) & (times.step <= k) & np.isin(times.cause, (COLLIDED, OFF_MAP))
        assert (met >= known).all()
        early = met & ~known  # failed of the mission before
        assert np.isin(times.cause[early], (BROKEN, MISSED)).all()
        assert (times.step[early] <= k).all()
    missed = times.cause == MISSED
    assert (times.step[missed] == last).all()
    assert (~deployment.accepted[np.isin(times.cause, (BROKEN, MISSED))]).all()
