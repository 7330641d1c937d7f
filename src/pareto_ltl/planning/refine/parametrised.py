"""A convex programme that is stated once in cvxpy and solved many times by Clarabel."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from threading import Thread
from typing import Any

import numpy as np

from pareto_ltl.planning.refine.cone_form import ConeForm, Statement
from pareto_ltl.planning.refine.kept_forms import forms_are_kept, kept_form
from pareto_ltl.support.arrays import FloatArray

TOLERANCE = 1e-6  # of the gap between primal and dual


def import_early() -> None:
    """Import cvxpy in a thread, unless the cache has forms, which may be all that is needed."""
    if not forms_are_kept():
        Thread(target=import_module, args=("cvxpy",)).start()


@dataclass(slots=True)
class ParametrisedProgramme:
    """One parametrised problem (DPP), and the solver that keeps its symbolic factors.

    cvxpy canonicalises once (40 ms for 48 steps), in the first run that needs the problem. Its tensors then
    take the parameters to the entries of Clarabel's matrices in one sparse product (0.05 ms;
    ``apply_parameters``, which makes new matrices each time, takes 0.6), and the solver keeps its symbolic
    factorisation (1 ms per solve).

    Attributes
    ----------
    state : callable
        Makes the statement, from the data in ``content`` only.
    content : str
        All that the statement depends on besides its code; the cached form is named after it.
    feasibility : float
        Tolerance of the constraints.
    scaled : bool
        Whether Clarabel scales the problem. The scales come from the first data, so an answer then depends on
        what was solved before.
    """

    state: Callable[[], Statement]
    content: str
    feasibility: float = TOLERANCE
    scaled: bool = False
    _form: ConeForm | None = None
    _solver: Any = None

    @property
    def form(self) -> ConeForm:
        """The problem in Clarabel's form; read or made at first use."""
        if self._form is None:
            self._form = kept_form(self.content, self.state)
        return self._form

    def give(self, **values: Any) -> None:
        """Set parameters."""
        form = self.form
        for name, value in values.items():
            place = form.places[name]
            form.parameters[place] = np.asarray(value, float).ravel(order="F")

    def solve(self) -> list[FloatArray] | None:
        """The values of the statement's variables, or None where the solver found none."""
        import clarabel
        from scipy.sparse import csc_array

        form = self.form
        columns = [np.arange(place.start, place.stop) for place in form.columns]
        q, A, b = form.cost @ form.parameters, form.entries @ form.parameters, form.right_hand_side()
        if self._solver is None:
            P = csc_array((len(q), len(q)))
            self._solver = clarabel.DefaultSolver(P, q, form.matrix(A), b, form.cones, self._settings())
        else:
            self._solver.update(q=q, A=A, b=b)
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
