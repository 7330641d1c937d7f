"""The ordered bound: the kernel against the reference, the recursion against random automata."""

from __future__ import annotations

import numpy as np
import pytest

from coherent import STEPS, coherent_problem
from oracle import path_risk as risk
from pareto_ltl.planning.evaluate import evaluate_path
from problems import box, make_scene


def test_the_mission_bound_of_the_kernel_is_the_references():
    scene = make_scene(
        {"a": box(14, 14, 18, 18), "b": box(4, 6, 8, 10), "c": box(6, 8, 10, 12)}, start=(2.0, 2.0)
    )
    for formula in ("F(b & F a)", "!c U a", "F(b & c & F a)", "(!a U b) & F a"):
        p = coherent_problem(scene, formula=formula, sd=2.0)
        path = evaluate_path(p, STEPS, "")
        expected = risk.ordered_bound(p, path.x, path.cov)
        assert path.objectives.mission_risk == pytest.approx(expected, abs=1e-12)
        assert path.objectives.mission_risk_ordered == path.objectives.mission_risk


def test_the_ordered_bound_is_never_below_the_truth_of_random_automata_and_correlated_labels():
    """3,000 complete DFAs on labels that form a hidden Markov chain; the truth by dynamic programming."""
    rng = np.random.default_rng(0)
    for _ in range(3000):
        states, letters, hidden, steps = rng.integers(2, 6), rng.integers(2, 4), 3, rng.integers(1, 8)
        delta = rng.integers(0, states, (states, letters))
        goal = states - 1
        delta[goal] = goal
        covers = _preorder(delta, goal)
        move = rng.dirichlet(np.full(hidden, 0.3), hidden)
        show = rng.dirichlet(np.full(letters, 0.3), (steps, hidden))
        start = rng.dirichlet(np.ones(hidden))
        truth = np.zeros((hidden, states))
        truth[:, 0] = start
        V, now = np.where(covers[0], 0.0, 1.0), start
        spoils = ~covers[delta]
        for t in range(steps):
            if t > 0:
                truth, now = move.T @ truth, now @ move
            P = now @ show[t]
            V = np.minimum(1.0, (V[:, None] + np.einsum("qsp,s->qp", spoils, P)).min(axis=0))
            after = np.zeros_like(truth)
            for s in range(letters):
                np.add.at(after.T, delta[:, s], (truth * show[t][:, [s]]).T)
            truth = after
        assert 1.0 - truth[:, goal].sum() <= V[goal] + 1e-12


def _preorder(delta, goal):
    """covers[q, p]: q accepts all that p accepts; the greatest simulation by fixed point."""
    n = len(delta)
    covers = np.ones((n, n), bool)
    covers[:, goal] = np.arange(n) == goal
    while True:
        then = covers & covers[delta[:, None], delta[None, :]].all(axis=2)
        if (then == covers).all():
            return covers
        covers = then
