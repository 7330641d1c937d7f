"""Convex smoothing of tree paths (Section 4.8 of the design; the only room that knows cvxpy).

A tree path is right but crooked, and it spends more steps than it needs. Smoothing has three moves. *Pull*
draws a taut line through the path's own places of witness, around the corners of whatever the line would
cut. *Walk* flies a line with as few steps as the wind allows, since every step adds covariance. *Bend*
solves one convex programme about the last iterate, propagates exactly, and repeats.

Whatever comes out was flown by ``planning.problem.evaluate`` like any other path; an iterate that fails
there is never returned.
"""

from __future__ import annotations

from pareto_ltl.planning.refine.convex import PIECES, Programme, _tangents, programme, separating
from pareto_ltl.planning.refine.obligations import allowed, duties, propagate, wind_and_gradient
from pareto_ltl.planning.refine.smoothing import (
    Start,
    damped,
    fitting,
    fly,
    improve,
    merit,
    rounds,
    shortened,
    smooth,
    starts,
)
from pareto_ltl.planning.refine.taut_lines import CAP, _wind, possible_orders, pull, walk

__all__ = [
    "CAP",
    "PIECES",
    "Programme",
    "Start",
    "_tangents",
    "_wind",
    "allowed",
    "damped",
    "duties",
    "fitting",
    "fly",
    "improve",
    "merit",
    "possible_orders",
    "programme",
    "propagate",
    "pull",
    "rounds",
    "separating",
    "shortened",
    "smooth",
    "starts",
    "walk",
    "wind_and_gradient",
]
