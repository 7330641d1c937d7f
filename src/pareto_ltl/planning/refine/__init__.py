"""Refinement of tree paths (the only package that imports cvxpy).

A tree path is feasible, but it is not straight and has more steps than it needs. With
``fidelity.refine=convex`` smoothing has three operations. *Pull* (``planning.routes``) draws a taut line
through the points where the path visits its regions, around the corners of obstacles. *Walk* divides a line
into as few steps as the wind allows, since every step adds covariance. *Bend* (``programme``) solves one
convex programme about the last iterate, propagates exactly, and repeats.

With ``fidelity.refine=sampled`` the failure rate of common flights is minimised directly (``sampled``), from
one start for each way to complete the mission (``starts``), at many lengths (``front_sweep``).

``planning.evaluate.evaluate_path`` checks every result like any other path.
"""

from __future__ import annotations

from pareto_ltl.planning.refine.effort import Effort
from pareto_ltl.planning.refine.front_sweep import sampled_paths
from pareto_ltl.planning.refine.programme import import_early
from pareto_ltl.planning.refine.smoothing import smooth_paths
from pareto_ltl.planning.refine.starts import flown_lines

__all__ = ["Effort", "flown_lines", "import_early", "sampled_paths", "smooth_paths"]
