"""Deployment: the plan's controls flown many times through the wind (Section V).

A wind law says how the wind of a flight is drawn. Every law flies the same blocks of runs with the same
seeds, so two plans deployed with one seed meet the same winds (common random numbers): a block draws
step by step, and a longer plan only draws further.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator, SeedSequence

from pareto_ltl.kernels import flight as rollout
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.records import Plan
from pareto_ltl.settings import DeploymentConfig
from pareto_ltl.simulation.records import Deployment
from pareto_ltl.support.arrays import Float32Array, FloatArray
from pareto_ltl.support.cores import cores
from pareto_ltl.support.errors import InfeasibleError

BLOCK = 250  # runs that share a generator, whatever the number of threads

LAWS = ("independent", "coherent")


@dataclass(frozen=True, slots=True)
class Winds:
    """Draws of one block of flights: ``theta`` (n, K, 2, P) of the coherent field, ``white`` (T, n, 2)."""

    theta: Float32Array
    white: FloatArray


def draw(problem: Problem, law: str, runs: int, steps: int, rng: Generator) -> Winds:
    """Winds of ``runs`` flights. The field is drawn for all slots, so that it does not depend on ``steps``.

    θ_0 ~ N(0, I), θ_{k+1} = ρ_k θ_k + √(1 - ρ_k²) η: independent for ρ = 0, one frozen field for ρ = 1.
    """
    modes = problem.tables.modes
    slots, count = len(modes.psi), modes.psi.shape[-1]
    if law == "coherent":
        theta = rng.standard_normal((runs, slots, 2, count), np.float32)
        for k, rho in enumerate(persistence(problem), start=1):
            theta[:, k] = rho * theta[:, k - 1] + np.float32(np.sqrt(1.0 - rho**2)) * theta[:, k]
    else:
        theta = np.empty((runs, 0, 2, count), np.float32)
    return Winds(theta, rng.standard_normal((steps, runs, 2)))


def persistence(problem: Problem) -> Float32Array:
    """ρ from each slot to the next, as the planner's steps have it; 1 where no step falls between them."""
    modes = problem.tables.modes
    rho = np.ones(max(len(modes.psi) - 1, 0), np.float32)
    for step in range(1, len(modes.slot)):
        first, last = int(modes.slot[step - 1]), int(modes.slot[step])
        if last > first:
            rho[first:last] = modes.keep[step] ** (1.0 / (last - first))
    return rho


def deploy(cfg: DeploymentConfig, problem: Problem, plan: Plan, seeds: SeedSequence) -> dict[str, Deployment]:
    """Fly ``plan`` ``cfg.runs`` times under every law of ``cfg.laws``.

    Each law has its own child of ``seeds``, in the order of :data:`LAWS`, so that adding one law leaves the
    winds of the others alone.
    """
    children = dict(zip(LAWS, seeds.spawn(len(LAWS)), strict=True))
    return {law: fly(problem, plan.path.u, cfg.runs, law, children[law], plan.path.x) for law in cfg.laws}


def fly(
    problem: Problem, u: FloatArray, runs: int, law: str, seed: SeedSequence, mean: FloatArray | None = None
) -> Deployment:
    """Fly the controls ``u`` (T, 2) ``runs`` times under one law; feedback, if any, holds on to ``mean``
    (T+1, 2).

    Raises
    ------
    InfeasibleError
        Where the wind is not known for so long.
    """
    known, motion = len(problem.tables.wind.slot), problem.tables.motion
    if len(u) > known:
        raise InfeasibleError(
            f"a plan of {len(u)} steps outlasts the wind, which is known for {known}: give later fields, "
            "set wind.hold_last=true, or raise planner.max_steps"
        )
    if mean is None and motion.gain > 0.0:
        raise ValueError("feedback needs the planned positions to hold on to: give mean")
    held = np.zeros((len(u) + 1, 2)) if mean is None else np.ascontiguousarray(mean)
    b = np.asarray(np.linalg.inv(motion.b_inv), float)
    estimator = _estimator(problem, held, law) if mean is not None else None
    x = np.empty((runs, len(u) + 1, 2))
    accepted, collided = np.empty(runs, bool), np.empty(runs, bool)
    blocks = [slice(first, min(first + BLOCK, runs)) for first in range(0, runs, BLOCK)]
    rngs = [np.random.default_rng(child) for child in seed.spawn(len(blocks))]

    def one(block: slice, rng: Generator) -> None:
        start = rng.standard_normal((BLOCK, 2))[: block.stop - block.start]
        x[block, 0] = problem.scene.start + np.sqrt(problem.start_variance) * start
        winds = draw(problem, law, block.stop - block.start, len(u), rng)
        if estimator is not None:
            noise = np.sqrt(motion.fix_variance) * rng.standard_normal((len(u), block.stop - block.start, 2))
            rollout.fly_fixed(
                problem.tables, b, u, held, *estimator, noise, winds.white, winds.theta, law == "coherent",
                x[block], accepted[block], collided[block],
            )  # fmt: skip
            return
        rollout.fly(
            problem.tables, b, u, held, winds.white, winds.theta, law == "coherent", x[block],
            accepted[block], collided[block],
        )  # fmt: skip

    with ThreadPoolExecutor(cores()) as pool:
        list(pool.map(one, blocks, rngs))
    return Deployment(law, x, accepted, collided)


def _estimator(
    problem: Problem, mean: FloatArray, law: str
) -> tuple[FloatArray, Float32Array, FloatArray, Float32Array] | None:
    """F_t, ψ_t and the Kalman gains of a robot that takes fixes along ``mean`` (T+1, 2); None without
    fixes.
    """
    from pareto_ltl.kernels import path as kernel
    from pareto_ltl.planning.problem import linear_law, trail

    if len(problem.tables.landmarks.ptr) < 2:
        return None
    F, psi, _ = linear_law(problem, mean)
    gain, learnt = np.zeros((len(F), 2, 2)), np.zeros((len(F), 2, *psi.shape[1:]), np.float32)
    course = trail(problem, len(mean))
    kernel.estimator(problem.tables, mean, problem.start_variance, course, gain, learnt)
    if law == "independent":  # a wind that is new at every step tells nothing about the next one
        learnt[:] = 0.0
    return (F, psi, gain, learnt) if gain.any() else None


def clopper_pearson(failures: int, runs: int, confidence: float = 0.95) -> tuple[float, float]:
    """Exact confidence interval of a rate (Clopper and Pearson, Biometrika 26, 1934)."""
    from scipy.special import betaincinv

    tail = (1 - confidence) / 2
    low = 0.0 if failures == 0 else float(betaincinv(failures, runs - failures + 1, tail))
    high = 1.0 if failures == runs else float(betaincinv(failures + 1, runs - failures, 1 - tail))
    return low, high


def rates(deployment: Deployment) -> dict[str, float]:
    """The metrics of one law: a flight fails where the mission is not accepted or an obstacle was met."""
    failed = ~deployment.accepted | deployment.collided
    low, high = clopper_pearson(int(failed.sum()), len(failed))
    law = deployment.law
    return {
        f"runs_{law}": float(len(failed)),
        f"failure_{law}": float(failed.mean()),
        f"failure_{law}_low": low,
        f"failure_{law}_high": high,
        f"mission_failure_{law}": float((~deployment.accepted).mean()),
        f"collision_{law}": float(deployment.collided.mean()),
    }
