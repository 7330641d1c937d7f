"""Compiled kernels on points, polygons and Gaussians in the plane; :mod:`typed_kernels` compiles them.

``types``  points, covariances, convex polygons and cells, as named tuples

Kernels do not check their arguments. They contain no wind, no automaton and no plan.
"""

from pathlib import Path

from typed_kernels.packages import PACKAGES

PACKAGES[__name__] = Path(__file__).parent  # kernels whose code depends on a module here are compiled again
