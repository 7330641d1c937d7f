"""Problems as cvxpy states them, and as Clarabel takes them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from pareto_ltl.support.arrays import FloatArray, IntArray

if TYPE_CHECKING:
    import cvxpy as cp


@dataclass(frozen=True, slots=True)
class Statement:
    """A problem with its parameters, parametrised in a disciplined way, and the variables that are asked for.

    Attributes
    ----------
    problem : cvxpy.Problem
    given : mapping of str to cvxpy.Parameter
    variables : tuple of cvxpy.Variable
    """

    problem: cp.Problem
    given: Mapping[str, Any]
    variables: tuple[Any, ...]


@dataclass(frozen=True, slots=True)
class ConeForm:
    """Minimise q'z + ½ z'Pz subject to b - A z in ``cones``, all entries linear in the parameters.

    Attributes
    ----------
    parameters : (p + 1,) float
        Values of all parameters, and a 1.
    places : dict of str to slice
        Where each parameter stands in ``parameters``, in column order.
    columns : tuple of slice
        Columns of each variable of the statement.
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
    columns: tuple[slice, ...]
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


def cone_form(stated: Statement) -> ConeForm:
    """What cvxpy's canonicalisation makes of a problem.

    Its tensor has a row for each entry of [A, b], column by column, and a column for each parameter.
    """
    import cvxpy as cp
    from cvxpy.lin_ops.lin_op import CONSTANT_ID
    from cvxpy.reductions.solvers.conic_solvers.clarabel_conif import dims_to_solver_cones
    from scipy.sparse import csr_array

    given = stated.given
    for parameter in given.values():
        parameter.save_value(np.zeros(parameter.shape))  # cvxpy wants some
    data, _, _ = stated.problem.get_problem_data(cp.CLARABEL)
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
        columns=tuple(
            slice(first, first + variable.size)
            for variable in stated.variables
            for first in (form.var_id_to_col[variable.id],)
        ),
        cost=csr_array(form.q)[:n],
        entries=-tensor[of_matrix],  # cvxpy's cones hold A z + b
        offset=tensor[of_offset],
        indices=of_matrix % height,
        indptr=np.searchsorted(of_matrix, height * np.arange(n + 1)),
        rows=of_offset - height * n,
        height=height,
        cones=dims_to_solver_cones(data["dims"]),
    )
