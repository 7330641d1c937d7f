"""Convex smoothing of tree paths (the only package that knows cvxpy).

A tree path is feasible, but it is not straight and has more steps than it needs. Smoothing has three
operations. *Pull* (``taut_lines``) draws a taut line through the points where the path visits its regions,
around the corners of obstacles. *Walk* divides a line into as few steps as the wind allows, since every
step adds covariance. *Bend* (``convex``) solves one convex programme about the last iterate, propagates
exactly, and repeats.

``planning.evaluate.evaluate_path`` checks every result like any other path; an iterate that fails there is
not returned.
"""

from __future__ import annotations

from pareto_ltl.planning.refine.smoothing import smooth_paths

__all__ = ["smooth_paths"]
