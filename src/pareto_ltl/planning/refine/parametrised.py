"""A convex programme that is stated once in cvxpy and solved many times by Clarabel."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from threading import Thread
from typing import TYPE_CHECKING, Any

import numpy as np

from pareto_ltl.support.arrays import FloatArray, IntArray

if TYPE_CHECKING:
    import cvxpy as cp

TOLERANCE = 1e-6  # of the gap between primal and dual


def import_early() -> None:
    """Import cvxpy in a thread: its 0.7 s pass while kernels run without the interpreter's lock."""
    Thread(target=import_module, args=("cvxpy",)).start()


@dataclass(slots=True)
class ParametrisedProgramme:
    """One problem, parametrised in a disciplined way, and the solver that keeps its symbolic factors.

    cvxpy canonicalises once (40 ms for 48 steps). Its tensors then take the parameters to the entries of
    Clarabel's matrices in one sparse product (0.05 ms; ``apply_parameters``, which makes new matrices each
    time, takes 0.6), and the solver keeps its symbolic factorisation (1 ms a solve).

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
    _form: ConeForm | None = None
    _solver: Any = None
    _order: Any = None

    @property
    def form(self) -> ConeForm:
        """The problem as Clarabel takes it; made at first use."""
        if self._form is None:
            self._form = cone_form(self.problem, self.given)
        return self._form

    def give(self, **values: Any) -> None:
        """Set parameters."""
        form = self.form
        for name, value in values.items():
            place = form.places[name]
            form.parameters[place] = np.asarray(value, float).ravel(order="F")

    def solve(self, curvature: FloatArray | None = None) -> list[FloatArray] | None:
        """The values of ``variables``, or None where the solver found none.

        ``curvature`` (n, 3) adds ½ Σ_k (xx_k a_k² + 2 xy_k a_k b_k + yy_k b_k²) to the objective, a and b
        the first two variables, each of length n. A quadratic form whose matrix is a parameter is outside of
        cvxpy's rules.
        """
        import clarabel
        from scipy.sparse import csc_array

        form = self.form
        columns = [form.columns[variable.id] + np.arange(variable.size) for variable in self.variables]
        q, A, b = form.cost @ form.parameters, form.entries @ form.parameters, form.right_hand_side()
        if self._solver is None:
            P = csc_array((len(q), len(q)))
            if curvature is not None:
                P, self._order = curvature_pattern(len(q), columns)
                P.data = curvature.T.ravel()[self._order]
            self._solver = clarabel.DefaultSolver(P, q, form.matrix(A), b, form.cones, self._settings())
        elif curvature is None:
            self._solver.update(q=q, A=A, b=b)
        else:
            self._solver.update(P=curvature.T.ravel()[self._order], q=q, A=A, b=b)
        answer = self._solver.solve()
        if answer.status not in (clarabel.SolverStatus.Solved, clarabel.SolverStatus.AlmostSolved):
            return None
        z = np.array(answer.x)
        return [z[rows] for rows in columns] if np.isfinite(z).all() else None

    def _settings(self) -> Any:
        import clarabel

        settings = clarabel.DefaultSettings()
        settings.verbose, settings.presolve_enable, settings.max_threads = False, False, 1
        settings.tol_gap_abs = settings.tol_gap_rel = TOLERANCE
        settings.tol_feas, settings.equilibrate_enable = self.feasibility, self.scaled
        settings.iterative_refinement_enable = False  # it doubles the time
        return settings


@dataclass(frozen=True, slots=True)
class ConeForm:
    """Minimise q'z + ½ z'Pz subject to b - A z in ``cones``, all entries linear in the parameters.

    Attributes
    ----------
    parameters : (p + 1,) float
        Values of all parameters, and a 1.
    places : dict of str to slice
        Where each parameter stands in ``parameters``, in column order.
    columns : dict of int to int
        First column of each variable, by its id.
    cost : (n, p + 1) sparse
        q from the parameters.
    entries : (k, p + 1) sparse
        The entries of A, column by column, from the parameters.
    offset : (rows of b that are not 0 for all parameters, p + 1) sparse
    indices, indptr : int arrays
        Places of the entries of A, as in a csc_array.
    rows : int array
        Rows of ``offset`` in b.
    height : int
        Length of b.
    cones : list
    """

    parameters: FloatArray
    places: dict[str, slice]
    columns: dict[int, int]
    cost: Any
    entries: Any
    offset: Any
    indices: IntArray
    indptr: IntArray
    rows: IntArray
    height: int
    cones: Any

    def matrix(self, entries: FloatArray) -> Any:
        """A with these entries."""
        from scipy.sparse import csc_array

        return csc_array((entries, self.indices, self.indptr), shape=(self.height, self.cost.shape[0]))

    def right_hand_side(self) -> FloatArray:
        """b for the parameters."""
        b = np.zeros(self.height)
        b[self.rows] = self.offset @ self.parameters
        return b


def cone_form(problem: cp.Problem, given: Mapping[str, Any]) -> ConeForm:
    """What cvxpy's canonicalisation makes of a problem whose parameters are ``given``.

    Its tensor has a row for each entry of [A, b], column by column, and a column for each parameter.
    """
    import cvxpy as cp
    from cvxpy.lin_ops.lin_op import CONSTANT_ID
    from cvxpy.reductions.solvers.conic_solvers.clarabel_conif import dims_to_solver_cones
    from scipy.sparse import csr_array

    for parameter in given.values():
        parameter.save_value(np.zeros(parameter.shape))  # cvxpy wants some
    data, _, _ = problem.get_problem_data(cp.CLARABEL)
    form = data[cp.settings.PARAM_PROB]
    n, starts = form.x.size, form.param_id_to_col
    tensor = csr_array(form.A)
    height = tensor.shape[0] // (n + 1)
    filled = np.flatnonzero(np.diff(tensor.indptr))
    of_matrix = filled[filled < height * n]
    of_offset = filled[filled >= height * n]
    parameters = np.zeros(form.total_param_size + 1)
    parameters[starts[CONSTANT_ID]] = 1.0
    return ConeForm(
        parameters=parameters,
        places={name: slice(starts[p.id], starts[p.id] + p.size) for name, p in given.items()},
        columns=dict(form.var_id_to_col),
        cost=csr_array(form.q)[:n],
        entries=-tensor[of_matrix],  # cvxpy's cones hold A z + b
        offset=tensor[of_offset],
        indices=of_matrix % height,
        indptr=np.searchsorted(of_matrix, height * np.arange(n + 1)),
        rows=of_offset - height * n,
        height=height,
        cones=dims_to_solver_cones(data["dims"]),
    )


def curvature_pattern(size: int, columns: Sequence[IntArray]) -> tuple[Any, IntArray]:
    """Upper triangle of the quadratic form of :meth:`ParametrisedProgramme.solve`, without values, and for
    each of its entries the place of its value in the transposed curvature."""
    from scipy.sparse import csc_array

    a, b = columns[:2]
    rows, cols = np.concatenate([a, np.minimum(a, b), b]), np.concatenate([a, np.maximum(a, b), b])
    P = csc_array((np.arange(float(len(rows))), (rows, cols)), shape=(size, size))
    P.sort_indices()
    return P, P.data.astype(int)


__all__: Sequence[str] = ["ParametrisedProgramme", "import_early"]
