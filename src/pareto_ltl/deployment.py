"""Deployment: the plan's controls flown many times through the wind (Section V).

A wind law says how the wind of a flight is drawn. Every law flies the same blocks of runs with the same
seeds, so two plans deployed with one seed meet the same winds (common random numbers): a block draws
step by step, and a longer plan only draws further.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.random import Generator, SeedSequence

from pareto_ltl.arrays import BoolArray, FloatArray
from pareto_ltl.config import DeploymentConfig
from pareto_ltl.cores import cores
from pareto_ltl.errors import InfeasibleError
from pareto_ltl.kernels import rollout
from pareto_ltl.problem import Problem
from pareto_ltl.records import Deployment, Plan

BLOCK = 250  # runs that share a generator, whatever the number of threads

Law = Callable[[Problem, FloatArray, FloatArray, Generator], tuple[BoolArray, BoolArray]]


def independent(
    problem: Problem, u: FloatArray, x: FloatArray, rng: Generator
) -> tuple[BoolArray, BoolArray]:
    """The paper's law: every step draws its wind anew, w ~ N(μ, Σ_w). Fills ``x`` (n, T+1, 2)."""
    draws = rng.standard_normal((len(u), len(x), 2))
    accepted, collided = np.empty(len(x), bool), np.empty(len(x), bool)
    b = np.asarray(np.linalg.inv(problem.tables.motion.b_inv), float)
    rollout.fly(problem.tables, b, u, draws, x, accepted, collided)
    return accepted, collided


LAWS: Mapping[str, Law] = {"independent": independent}


def deploy(cfg: DeploymentConfig, problem: Problem, plan: Plan, seeds: SeedSequence) -> dict[str, Deployment]:
    """Fly ``plan`` ``cfg.runs`` times under every law of ``cfg.laws``.

    Each law has its own child of ``seeds``, in the order of :data:`LAWS`, so that adding one law leaves the
    winds of the others alone.
    """
    children = dict(zip(LAWS, seeds.spawn(len(LAWS)), strict=True))
    return {law: fly(problem, plan.path.u, cfg.runs, law, children[law]) for law in cfg.laws}


def fly(problem: Problem, u: FloatArray, runs: int, law: str, seed: SeedSequence) -> Deployment:
    """Fly the controls ``u`` (T, 2) ``runs`` times under one law.

    Raises
    ------
    InfeasibleError
        Where the wind is not known for so long.
    """
    known = len(problem.tables.wind.slot)
    if len(u) > known:
        raise InfeasibleError(
            f"a plan of {len(u)} steps outlasts the wind, which is known for {known}: give later fields, "
            "set wind.hold_last=true, or raise planner.max_steps"
        )
    x = np.empty((runs, len(u) + 1, 2))
    blocks = [slice(first, min(first + BLOCK, runs)) for first in range(0, runs, BLOCK)]
    rngs = [np.random.default_rng(child) for child in seed.spawn(len(blocks))]

    def one(block: slice, rng: Generator) -> tuple[BoolArray, BoolArray]:
        start = rng.standard_normal((BLOCK, 2))[: block.stop - block.start]
        x[block, 0] = problem.scene.start + np.sqrt(problem.start_variance) * start
        return LAWS[law](problem, u, x[block], rng)

    with ThreadPoolExecutor(cores()) as pool:
        outcomes = list(pool.map(one, blocks, rngs))
    return Deployment(
        law,
        x,
        np.concatenate([accepted for accepted, _ in outcomes]),
        np.concatenate([hit for _, hit in outcomes]),
    )


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
