"""What keeps a polish in the landmarks that it profits from."""

from __future__ import annotations

from dataclasses import dataclass

from pareto_ltl.kernels.data import Landmarks
from pareto_ltl.kernels.margin import Slope
from pareto_ltl.planning.refine.step_programme import Descent
from pareto_ltl.support.arrays import FloatArray


@dataclass(frozen=True, slots=True)
class Attraction:
    """What fixes are worth to a path: an objective that keeps polishes from leaving a landmark.

    Deviations of common flights are held fixed in a solve, so that the failure model does not see that a path
    that leaves a landmark loses its fix. This term does: ``worth`` σ(-m / τ) for each landmark, with m the
    distance by which a flight is inside and ``worth`` the failures that fixes save now.

    Eq. (M75) of docs/mathematics_methods.md.
    """

    marks: Landmarks | None
    worth: float

    def added(self, here: Descent, x: FloatArray, off: FloatArray, width: float, runs: int) -> Descent:
        """``here`` with the term of ``x`` + ``off`` (T+1, 2, n); of ``runs`` flights, others count as 0."""
        if self.marks is None or self.worth <= 0.0:
            return here
        from pareto_ltl.kernels.attraction import add_attraction

        slope = Slope(here.gradient.copy(), here.hessian.copy())
        worth = self.worth * off.shape[2] / runs
        more = add_attraction(self.marks, x, off, width, worth, slope)
        return Descent(slope.gradient, slope.hessian, here.value + float(more))
