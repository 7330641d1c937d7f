"""Flights that run out of energy: flights of the checker against flights of the planner."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.random import SeedSequence

from desk import SMALL
from pareto_ltl.extend import simulate_flights
from pareto_ltl.planning.power import EnergyModel
from pareto_ltl.run.results import planned_run
from pareto_ltl_apps.cli.commands import run_command_line
from pareto_ltl_verify.evidence import open_evidence
from pareto_ltl_verify.flights import RARE, fly, same_rate

RUNS = 2000


@pytest.mark.statistical
def test_the_checker_lands_as_many_robots_as_the_planner(tmp_path: Path) -> None:
    words = ["plan", "+experiment=hop", *SMALL, "robot.feedback_time=300", "exports=none"]
    assert run_command_line([*words, f"hydra.run.dir={tmp_path}"]) == 0
    run = planned_run(tmp_path)
    problem, path = run.problem, run.plan.path
    assert problem.energy is not None
    evidence, told = open_evidence(tmp_path), {}
    law = evidence.law("coherent")
    for share in (0.99, 0.995, 1.0, 1.02):
        capacity = share * problem.energy.of(path.u, problem.motion.dt)
        limited = replace(problem, energy=EnergyModel(problem.energy.curve, capacity))
        ours = simulate_flights(limited, path.u, RUNS, "coherent", SeedSequence(1), path.x).failed.sum()
        held = replace(law, robot=replace(law.robot, capacity=capacity))
        theirs = fly(held, evidence.x, evidence.u, RUNS, np.random.default_rng(2), law.landmarks)
        failed = evidence.ground.failed(theirs).sum()
        assert same_rate(int(ours), RUNS, int(failed), RUNS) > RARE
        told[share] = float(ours) / RUNS
    assert told[0.99] > told[1.02]
    assert any(0.02 < rate < 0.98 for rate in told.values()), told
