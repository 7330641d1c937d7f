"""What keeps a polish in the landmarks that it profits from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import expit

from pareto_ltl.planning.refine.step_programme import Descent
from pareto_ltl.support.arrays import FloatArray, IntArray
from pareto_ltl.world.cells import half_planes

NEAREST = 3  # legs of a path on which a flight may be deepest in a landmark
SHARES = (0.5, 1.0)  # of a leg, where that is evaluated


@dataclass(frozen=True, slots=True)
class Attraction:
    """What fixes are worth to a path: an objective that keeps polishes from leaving a landmark.

    Deviations of common flights are held fixed in a solve, so that the failure model does not see that a path
    that leaves a landmark loses its fix. This term does: ``worth`` σ(-m / τ) for each landmark, with m the
    distance by which a flight is inside and ``worth`` the failures that fixes save now.

    Eq. (M75) of docs/mathematics_methods.md.
    """

    marks: tuple[FloatArray, ...]
    worth: float

    def added(self, here: Descent, x: FloatArray, off: FloatArray, width: float, runs: int) -> Descent:
        """``here`` with the term of ``x`` + ``off`` (T+1, 2, n); of ``runs`` flights, others count as 0."""
        if self.worth <= 0.0:
            return here
        value, gradient, hessian = here.value, here.gradient.copy(), here.hessian.copy()
        share = self.worth * off.shape[2] / runs
        for corners in self.marks:
            seen = _inside(corners, x, off)
            missed = expit(-seen.margin / width)
            slope = missed * (1.0 - missed) / width
            bend = np.maximum(slope * (1.0 - 2.0 * missed) / width, 0.0)
            value += share * float(missed.mean())
            nx, ny = seen.normal.T
            pull = share / len(missed) * slope[:, None] * seen.normal
            curve = share / len(missed) * bend[:, None] * np.column_stack([nx * nx, nx * ny, ny * ny])
            for t, weight in ((seen.leg, 1.0 - seen.share), (seen.leg + 1, seen.share)):
                np.add.at(gradient, t, weight[:, None] * pull)
                np.add.at(hessian, t, (weight * weight)[:, None] * curve)
        return Descent(gradient, hessian, value)


class _Inside(NamedTuple):
    """For each flight the leg and the share of it where it is deepest in a landmark, and how deep [m].

    ``normal`` is that of the nearest face, which the depth falls along.
    """

    leg: IntArray
    share: FloatArray
    margin: FloatArray
    normal: FloatArray


def _inside(corners: FloatArray, x: FloatArray, off: FloatArray) -> _Inside:
    normals, offsets = half_planes(corners)
    middle = corners.mean(axis=0)
    ends = np.linalg.norm(x - middle, axis=1)
    near = np.sort(np.argsort(ends[:-1] + ends[1:], kind="stable")[:NEAREST])
    legs, shares = np.repeat(near, len(SHARES)), np.tile(SHARES, len(near))
    s = shares[:, None, None]
    at = (1.0 - s) * (x[legs, :, None] + off[legs]) + s * (x[legs + 1, :, None] + off[legs + 1])
    gap = offsets[None, :, None] - normals @ at
    deep = gap.min(axis=1)
    best, flights = deep.argmax(axis=0), np.arange(off.shape[2])
    face = gap[best, :, flights].argmin(axis=1)
    return _Inside(legs[best], shares[best], deep[best, flights], normals[face])
