"""A convex programme that is stated once in cvxpy and solved many times by Clarabel."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from pareto_ltl.support.arrays import FloatArray

if TYPE_CHECKING:
    import cvxpy as cp

TOLERANCE = 1e-6  # of the gap between primal and dual


@dataclass(frozen=True, slots=True)
class ParametrisedProgramme:
    """One problem, parametrised in a disciplined way, and the solver that keeps its symbolic factors.

    cvxpy canonicalises once (40 ms for 48 steps); then its tensors turn parameters into Clarabel's matrices
    (0.6 ms), and the solver keeps its symbolic factorisation (1 ms a solve). ``problem.solve`` takes 12.5 ms
    at 132 steps, this 11.

    Attributes
    ----------
    problem : cvxpy.Problem
    given : mapping of str to cvxpy.Parameter
    variables : tuple of cvxpy.Variable
        Whose values :meth:`solve` returns.
    feasibility : float
        Tolerance of the constraints.
    scaled : bool
        Whether Clarabel scales the problem. The scales are those of the first data: without them an answer
        does not depend on what was solved before.
    """

    problem: cp.Problem
    given: Mapping[str, Any]
    variables: tuple[Any, ...]
    feasibility: float = TOLERANCE
    scaled: bool = False
    _engine: dict[str, Any] = field(default_factory=dict)

    def give(self, **values: Any) -> None:
        """Set parameters. ``save_value`` leaves out the checks of ``value``, a sixth of a solve's time."""
        for name, value in values.items():
            self.given[name].save_value(np.asarray(value, float))

    def solve(self, curvature: FloatArray | None = None) -> list[FloatArray] | None:
        """The values of ``variables``, or None where the solver found none.

        ``curvature`` (n, 3) adds ½ Σ_k (xx_k a_k² + 2 xy_k a_k b_k + yy_k b_k²) to the objective, a and b
        the first two variables, each of length n. A quadratic form whose matrix is a parameter is outside of
        cvxpy's rules.
        """
        import clarabel

        if not self._engine:
            self._start()
        engine, form = self._engine, self._engine["form"]
        q, _, A, b = form.apply_parameters()
        P = engine["P"] if curvature is None else self._with_curvature(curvature)
        solver = engine.get("solver")
        if solver is None:
            solver = clarabel.DefaultSolver(P, q, -A, b, engine["cones"], engine["settings"])
            engine["solver"] = solver
        elif curvature is None:
            solver.update(q=q, A=-A, b=b)
        else:
            solver.update(P=P, q=q, A=-A, b=b)
        answer = solver.solve()
        if answer.status not in (clarabel.SolverStatus.Solved, clarabel.SolverStatus.AlmostSolved):
            return None
        z = np.array(answer.x)
        if not np.isfinite(z).all():
            return None
        starts = [form.var_id_to_col[variable.id] for variable in self.variables]
        return [z[k : k + v.size] for k, v in zip(starts, self.variables, strict=True)]

    def _start(self) -> None:
        import clarabel
        import cvxpy as cp
        from cvxpy.reductions.solvers.conic_solvers.clarabel_conif import dims_to_solver_cones
        from scipy.sparse import csc_array

        data, _, _ = self.problem.get_problem_data(cp.CLARABEL)
        settings = clarabel.DefaultSettings()
        settings.verbose, settings.presolve_enable, settings.max_threads = False, False, 1
        settings.tol_gap_abs = settings.tol_gap_rel = TOLERANCE
        settings.tol_feas, settings.equilibrate_enable = self.feasibility, self.scaled
        settings.iterative_refinement_enable = False  # it doubles the time
        n = len(data["c"])
        self._engine.update(
            form=data[cp.settings.PARAM_PROB],
            cones=dims_to_solver_cones(data["dims"]),
            settings=settings,
            P=csc_array((n, n)),
        )

    def _with_curvature(self, curvature: FloatArray) -> Any:
        """The upper triangle of the quadratic form; its pattern is the same at every solve."""
        from scipy.sparse import csc_array

        form, n = self._engine["form"], len(curvature)
        a, b = (form.var_id_to_col[variable.id] + np.arange(n) for variable in self.variables[:2])
        rows, columns = np.concatenate([a, np.minimum(a, b), b]), np.concatenate([a, np.maximum(a, b), b])
        P = csc_array((curvature.T.ravel(), (rows, columns)), shape=self._engine["P"].shape)
        P.sort_indices()
        return P
