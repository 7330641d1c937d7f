"""Ranking and final acceptance of paths by simulation (``fidelity.judge=flights``).

Bounds hold but are loose; rates are close but have sampling error. The front is therefore ranked by Monte
Carlo over the linearised coherent law, which costs little and meets the same winds for every path, and the
path that is chosen flies through the nonlinear law before it becomes the plan.
"""

from __future__ import annotations

import logging
import math
from dataclasses import replace

import numpy as np
from numpy.random import SeedSequence

from pareto_ltl.kernels import flight as rollout
from pareto_ltl.planning.evaluate import propagate
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.records import Acceptance, Front, PlannedPath
from pareto_ltl.planning.selection_rules import choose_path
from pareto_ltl.settings import SelectionConfig
from pareto_ltl.simulation.flights import (
    clopper_pearson,
    draw_coherent,
    flight_judge,
    simulate_flights,
    unspawned,
)
from pareto_ltl.simulation.records import Deployment
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.display import interval_text, probability_text
from pareto_ltl.support.memory import require_memory
from pareto_ltl.wind.records import WindField

LOG = logging.getLogger(__name__)
LINEAR = 0.35  # standard deviation over length scale: beyond it the linearised law is unreliable


def rank_front(problem: Problem, front: Front, draws: int, seed: SeedSequence) -> Front:
    """``front`` with the failure rate of every path in ``draws`` flights of the linearised coherent law.

    All paths meet the same winds (common random numbers), so that their rates compare better than each is
    known.
    """
    rng = np.random.default_rng(unspawned(seed))
    steps = max(len(path.u) for path in front.paths)
    fields = (
        8 * (int(problem.modes.epoch[-1]) + 1) * problem.modes.psi.shape[-1]
    )  # bytes of the winds of a flight
    require_memory(fields + 48 * steps, "selection.draws", draws, "flights that rank the front")
    winds = draw_coherent(problem, draws, steps, rng)
    start = math.sqrt(problem.start_variance) * rng.standard_normal((draws, 2))
    estimates = []
    for path in front.paths:
        if path.fixes:  # after a fix the robot is not linear: it keeps within u_max, or misses the landmark
            flights = simulate_flights(problem, path.u, draws, "coherent", seed, path.x)
            estimates.append(float(flights.failed.mean()))
        else:
            estimates.append(linear_failure_rate(problem, path, winds, start))
    return replace(front, estimates=tuple(estimates))


def linear_failure_rate(
    problem: Problem, path: PlannedPath, winds: rollout.CoherentDraws, start: FloatArray
) -> float:
    """Share of flights that fail in winds linearised about ``path``; ``start`` (n, 2) = e_0 [m]."""
    flight, motion = propagate(problem, path.x, winds.law), problem.motion
    mean = (flight.free - flight.x[:-1] @ motion.a.T) / motion.dt
    slope = (flight.F - motion.closed) / motion.dt
    draws = rollout.LinearisedDraws(winds.law, winds.white, winds.theta, flight, mean, slope)
    n = len(start)
    flags = (np.empty(n, bool) for _ in range(3))
    outcome = rollout.Outcome(np.empty((n, len(path.x), 2)), *flags)
    outcome.x[:, 0] = path.x[0] + start
    rollout.fly_batch(flight_judge(problem), draws, rollout.Autopilot(path.u, flight.x), outcome)
    return float(Deployment("coherent", *outcome, problem.scene.walled).failed.mean())


def accept_path(
    cfg: SelectionConfig, problem: Problem, wind: WindField, front: Front, seed: SeedSequence
) -> tuple[PlannedPath, Acceptance]:
    """The path that the rule picks, once the simulation does not contradict its bound.

    A path whose simulated failure rate lies above V + R, with 95 % confidence, is passed over for the
    rule's next choice; where all are, the one with the least rate is flown, and a warning says so.
    """
    left, seen = front, []
    for _ in range(cfg.examined):
        path = choose_path(cfg, left)
        k = next(i for i, other in enumerate(left.paths) if other is path)
        verdict = examine_path(
            problem, wind, path, cfg.runs, seed, left.estimates[k] if left.estimates else math.nan
        )
        seen.append((path, verdict))
        if verdict.passed:
            break
        LOG.warning(
            "%s: %s of the flights simulated in coherent winds fail (95 %% interval), more than its bound "
            "%s + R in %s winds, %s; the next choice is taken",
            path.origin, interval_text(verdict.low, verdict.high), problem.fidelity.mission_symbol,
            problem.fidelity.law, probability_text(verdict.bound),
        )  # fmt: skip
        if len(left.paths) == 1:
            break
        left = front_without(left, k)
    path, verdict = seen[-1] if seen[-1][1].passed else min(seen, key=lambda s: s[1].failures)
    if verdict.linearity > LINEAR:
        LOG.warning(
            "the position's standard deviation reaches %.2f of the wind's length scale (%.2f is safe): "
            "bounds and estimates, which linearise the wind, are unreliable; go by the rate simulated in "
            "coherent winds, %s",
            verdict.linearity, LINEAR, interval_text(verdict.low, verdict.high),
        )  # fmt: skip
    return path, verdict


def front_without(front: Front, k: int) -> Front:
    """The front less its path number ``k``."""
    paths = front.paths[:k] + front.paths[k + 1 :]
    return replace(front, paths=paths, estimates=front.estimates[:k] + front.estimates[k + 1 :])


def examine_path(
    problem: Problem, wind: WindField, path: PlannedPath, runs: int, seed: SeedSequence, estimate: float
) -> Acceptance:
    """Fly ``path`` ``runs`` times through coherent winds."""
    require_memory(path.x.nbytes, "selection.runs", runs, "flights that examine a path")
    flights = simulate_flights(problem, path.u, runs, "coherent", seed, path.x)
    failures = int(flights.failed.sum())
    low, high = clopper_pearson(failures, runs)
    bound = min(1.0, path.objectives.mission_risk + path.objectives.collision_risk)
    return Acceptance(
        bound, estimate, runs, failures, low, high, low <= bound, linearity(problem, wind, path.cov)
    )


def linearity(problem: Problem, wind: WindField, cov: FloatArray) -> float:
    """Largest standard deviation of the position over the shorter length scale of its slot."""
    if wind.modes is None or len(cov) < 2:
        return 0.0
    widest = np.sqrt(np.linalg.eigvalsh(cov[:-1])[:, 1])
    scale = wind.modes.length.min(axis=1)[problem.modes.slot[: len(cov) - 1]]
    return float((widest / scale).max())
