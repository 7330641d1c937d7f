"""Convex problems in two forms: a cvxpy problem, and the cone programme that Clarabel solves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from pareto_ltl.support.arrays import FloatArray, IntArray

if TYPE_CHECKING:
    import cvxpy as cp


@dataclass(frozen=True, slots=True)
class Statement:
    """A parametrised problem (DPP), its parameters, and the variables whose values are wanted.

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
        Gives q from the parameters.
    entries : (k, p + 1) sparse
        Gives the entries of A, column by column, from the parameters.
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
    """Canonicalise a problem with cvxpy, and order its rows for Clarabel.

    The tensor of cvxpy has a row for each entry of [A, b], column by column, and a column for each parameter.
    Nearly all rows are empty: arrays as long as the tensor take 4 GB for 1,000 steps, so only filled rows are
    kept. The last reduction of cvxpy makes arrays of full length; :func:`solver_rows` replaces it.
    """
    import cvxpy as cp
    from cvxpy.lin_ops.lin_op import CONSTANT_ID
    from cvxpy.reductions.solvers.conic_solvers.clarabel_conif import dims_to_solver_cones
    from cvxpy.reductions.solvers.solving_chain import resolve_and_build_chain
    from scipy.sparse import csr_array

    given, form = stated.given, stated.problem
    chain = resolve_and_build_chain(form, cp.CLARABEL, canon_backend=cp.settings.COO_CANON_BACKEND)
    for reduction in chain.reductions[:-1]:
        form, _ = reduction.apply(form)
    n, starts, parameters = form.x.size, form.param_id_to_col, form.total_param_size + 1
    target, sign = solver_rows(form.constraints)
    height, tensor = len(target), form.A.tocoo()
    column, row = np.divmod(tensor.row.astype(np.int64), height)
    filled, place = np.unique(height * column + target[row], return_inverse=True)
    rows = csr_array((sign[row] * tensor.data, (place, tensor.col)), shape=(len(filled), parameters))
    entries = int(np.searchsorted(filled, height * n))
    values = np.zeros(parameters)
    values[starts[CONSTANT_ID]] = 1.0
    return ConeForm(
        parameters=values,
        places={name: slice(starts[p.id], starts[p.id] + p.size) for name, p in given.items()},
        columns=tuple(
            slice(first, first + variable.size)
            for variable in stated.variables
            for first in (form.var_id_to_col[variable.id],)
        ),
        cost=csr_array(form.q)[:n],
        entries=-rows[:entries],  # cvxpy's cones hold A z + b
        offset=rows[entries:],
        indices=filled[:entries] % height,
        indptr=np.searchsorted(filled[:entries], height * np.arange(n + 1)),
        rows=filled[entries:] - height * n,
        height=height,
        cones=dims_to_solver_cones(form.cone_dims),
    )


def solver_rows(constraints: Sequence[Any]) -> tuple[IntArray, FloatArray]:
    """Position and sign in Clarabel's order of each row of cvxpy's cones, both (height,).

    Equations have the opposite sign. For second-order cones t >= ‖x‖, cvxpy lists all t of a constraint and
    then all x; Clarabel lists one cone after another.
    """
    from cvxpy.constraints import SOC, NonNeg, Zero

    target, sign, first = [np.empty(0, np.int64)], [np.empty(0)], 0
    for constraint in constraints:
        size = sum(part.size for part in constraint.args)
        within = np.arange(size)
        if isinstance(constraint, SOC):
            cones = constraint.args[0].size
            within = np.concatenate(
                [part.ravel() for part in np.split(within.reshape(cones, -1), [1], axis=1)]
            )
        elif not isinstance(constraint, NonNeg | Zero):
            raise TypeError(
                "constraints must be NonNeg, Zero or SOC to be ordered for Clarabel, "
                f"got {type(constraint).__name__}"
            )
        target.append(first + within)
        sign.append(np.full(size, -1.0 if isinstance(constraint, Zero) else 1.0))
        first += size
    return np.concatenate(target), np.concatenate(sign)
