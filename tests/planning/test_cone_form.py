"""What Clarabel is given, against the matrices that cvxpy gives it."""

from __future__ import annotations

import tracemalloc
from functools import partial

import cvxpy as cp
import numpy as np
import pytest

from pareto_ltl.planning.refine.cone_form import Statement, cone_form, solver_rows
from pareto_ltl.planning.refine.convex import SmoothingShape, state_smoothing
from pareto_ltl.planning.refine.risk_sharing import AllocatedRisk, EqualShares

TURNED = ((0.8, 0.6), (-0.6, 0.8))
STATEMENTS = {
    "equal shares": partial(state_smoothing, SmoothingShape(8, 2, 4, TURNED, False, EqualShares(2.5))),
    "allocated": partial(state_smoothing, SmoothingShape(8, 2, 4, TURNED, True, AllocatedRisk(0.05))),
}


@pytest.mark.parametrize("name", STATEMENTS)
def test_the_form_gives_the_matrices_that_cvxpy_gives(name: str) -> None:
    stated: Statement = STATEMENTS[name]()
    form, rng = cone_form(stated), np.random.default_rng(5)
    for key, parameter in stated.given.items():
        parameter.value = rng.uniform(0.1, 2.0, parameter.shape)
        form.parameters[form.places[key]] = parameter.value.ravel(order="F")
    theirs, _, _ = stated.problem.get_problem_data(cp.CLARABEL)
    ours = form.matrix(form.entries @ form.parameters)
    np.testing.assert_allclose(ours.toarray(), theirs["A"].toarray(), rtol=1e-14)
    np.testing.assert_allclose(form.right_hand_side(), theirs["b"], rtol=1e-14)
    np.testing.assert_allclose(form.cost @ form.parameters, theirs["c"], rtol=1e-14)
    assert [cone.dim for cone in form.cones if type(cone).__name__ == "SecondOrderConeT"] == theirs[
        "dims"
    ].soc


def test_equations_have_a_form_too() -> None:
    x, y, b = cp.Variable(3), cp.Variable(), cp.Parameter(3)
    problem = cp.Problem(cp.Minimize(cp.sum(x)), [cp.norm(x - b) <= 2.0, x[0] + y == 1.0, y >= 0.25])
    form = cone_form(Statement(problem, {"b": b}, (x,)))
    b.value = form.parameters[form.places["b"]] = np.array([1.0, -2.0, 3.0])
    theirs, _, _ = problem.get_problem_data(cp.CLARABEL)
    np.testing.assert_array_equal(
        form.matrix(form.entries @ form.parameters).toarray(), theirs["A"].toarray()
    )
    np.testing.assert_array_equal(form.right_hand_side(), theirs["b"])


def test_cones_without_known_rows_are_refused() -> None:
    with pytest.raises(TypeError, match=r"constraints must be NonNeg, Zero or SOC .* got ExpCone"):
        solver_rows([cp.ExpCone(cp.Variable(), cp.Variable(), cp.Variable())])


def test_memory_of_a_form_does_not_grow_as_the_tensor_of_all_entries() -> None:
    """800 steps have 17,000 rows and 4,000 columns: 540 MB for one number an entry."""
    stated = state_smoothing(SmoothingShape(800, 4, 6, TURNED, False, EqualShares(2.5)))
    tracemalloc.start()
    try:
        form = cone_form(stated)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert form.height * form.cost.shape[0] > 6e7
    assert peak < 1.5e8, peak
