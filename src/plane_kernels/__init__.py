"""Compiled kernels on points, polygons, paths and Gaussians in the plane; :mod:`typed_kernels` compiles them.

``types``             points, covariances, convex polygons and cells, as named tuples
``geometry``          points, segments and convex polygons; the cell of a point
``clearance``         the signed distance of a segment from a polygon, and its gradient
``boxes``             the polygons near many points or segments
``visibility``        what a straight line can reach past polygons
``gaussian``          the normal distribution in the plane, and bounds on its probability of a polygon
``polygon``           the exact probability of a polygon
``supporting_lines``  the half planes that separate a segment of Gaussians from polygons
``collision_risk``    the chance constraint of a step of a Gaussian past polygons
``path_collision``    a bound on the probability that a path of Gaussians meets polygons
``step_solver``       a second-order cone programme on the points of a path, solved by interior points
``block_matrix``      symmetric block-tridiagonal matrices: elimination and substitution
``neighbours``        k-d trees that grow, and samples of the points in each square of a grid

Kernels do not check their arguments. They contain no wind, no automaton and no plan.
"""

from pathlib import Path

from typed_kernels.packages import PACKAGES

PACKAGES[__name__] = Path(__file__).parent  # kernels whose code depends on a module here are compiled again
