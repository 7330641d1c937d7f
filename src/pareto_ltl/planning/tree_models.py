"""The models in which trees of every preset grow: the models of the paper, in the mean wind of the plan.

Where the plan has other models, its paths are judged by other limits than vertices. Trees then leave airspeed
for what they do not compute, and may be closer to a barrier than Eq. (10) allows, as close as the start is.
"""

from __future__ import annotations

import logging
from itertools import pairwise

import numpy as np
from scipy.special import ndtri

from pareto_ltl.kernels import data as kd
from pareto_ltl.kernels.tree import TreeModels
from pareto_ltl.planning.pack import NO_LIMIT
from pareto_ltl.planning.problem import Problem, start_breach, start_risk
from pareto_ltl.support.errors import InfeasibleError
from plane_kernels.types import StepBound

LOG = logging.getLogger(__name__)
# Share of the airspeed that trees leave for the mean shift and for heading errors, which only other laws than
# theirs have: on tree paths of phi1, phi2 and five missions of the corpus they take up to 0.8 % of u_max.
LEFT = 0.02
ALMOST = 1.0 - 1e-9  # a quantile at which rounding does not exclude the start
MAX_LEFT = 0.25  # of the airspeeds between u_min and u_max: a robot with one airspeed leaves little


def tree_models(problem: Problem, *, strict: bool = False) -> TreeModels:
    """The models of the trees of ``problem``.

    Raises
    ------
    InfeasibleError
        If the start violates Eq. (9), in a plan that is judged by bounds or ``strict``.
    """
    if start_risk(problem) > problem.epsilon:
        if problem.fidelity.judge == "bound" or strict:
            raise InfeasibleError(start_breach(problem))
        LOG.warning("%s", start_breach(problem))
    law, collision = problem.laws["independent"], problem.world.collision
    assert isinstance(law, kd.IndependentLaw)
    if problem.world.law is not law:
        law = law._replace(motion=_with_airspeed_left(law.motion))
    if problem.fidelity.judge == "flights" or not isinstance(collision, StepBound):
        collision = _step_bound(problem)
    return TreeModels(law, problem.theorem2, collision)


def _with_airspeed_left(motion: kd.Motion) -> kd.Motion:
    left = min(LEFT * motion.u_max, MAX_LEFT * (motion.u_max - motion.u_min))
    least = motion.u_min + left if motion.u_min > 0.0 else 0.0
    return motion._replace(u_max=motion.u_max - left, u_min=least)


def _step_bound(problem: Problem) -> StepBound:
    """Eq. (10) for planner.epsilon, or for what the start satisfies where that is less.

    A plan that is judged by flights or by R has no share of epsilon for each barrier, and its start may be
    closer to one than Eq. (9) allows.
    """
    barriers, at, (xx, xy, yy) = problem.barriers, problem.scene.start, problem.start_cov
    parts = max(len(barriers.ptr) - 1, 1)
    z = -float(ndtri(problem.epsilon / parts)) if problem.epsilon < NO_LIMIT else 0.0
    (nx, ny), gap = barriers.normal.T, barriers.normal @ at - barriers.offset
    deviation = np.sqrt(nx * nx * xx + 2.0 * nx * ny * xy + ny * ny * yy)
    away = np.divide(gap, deviation, out=np.full(len(gap), np.inf), where=deviation > 0.0)
    closest = min((float(away[i:j].max()) for i, j in pairwise(barriers.ptr.tolist())), default=z)
    return StepBound(barriers, problem.world.collision.nearby, max(0.0, min(z, ALMOST * closest)))
