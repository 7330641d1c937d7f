"""Convex smoothing of tree paths (the only package that knows cvxpy).

A tree path is feasible but crooked, and it spends more steps than it needs. Smoothing has three moves.
*Pull* draws a taut line through the path's own places of witness, around the corners of whatever the line
would cut. *Walk* flies a line with as few steps as the wind allows, since every step adds covariance.
*Bend* solves one convex programme about the last iterate, propagates exactly, and repeats.

Whatever comes out was flown by ``planning.evaluate.evaluate_path`` like any other path; an iterate that
fails there is never returned.
"""

from __future__ import annotations

from pareto_ltl.planning.refine.smoothing import smooth_paths

__all__ = ["smooth_paths"]
