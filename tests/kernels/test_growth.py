"""Where trees grow to: samples of cells."""

from __future__ import annotations

import numpy as np
import shapely

from pareto_ltl.kernels.growth import sample_cell
from pareto_ltl.planning.product_graph import cell_fans
from pareto_ltl.world.cells import Decomposition
from problems import KM, RARE, box, chi_square_chance


def test_samples_of_a_cell_are_uniform():
    """Counts in the parts that a grid cuts out of an irregular cell, against their areas."""
    other = box(-9, -9, -8, -8)
    cell = np.array([[0, 0], [6, 1], [7, 4], [3, 8], [1, 5]]) * KM
    decomposition = Decomposition((other, cell), (frozenset(),) * 2, np.empty((0, 2), np.int64), (), {})
    fan, rng, n = cell_fans(decomposition), np.random.default_rng(5), 6000
    points = np.array([sample_cell(fan, 1, rng) for _ in range(n)])
    squares = [shapely.box(x, y, x + KM, y + KM) for x in np.arange(8) * KM for y in np.arange(9) * KM]
    areas = shapely.area(shapely.intersection(shapely.Polygon(cell), squares))
    counts = np.array([shapely.contains_xy(square, points).sum() for square in squares], float)
    assert counts[areas == 0].sum() == 0
    assert counts.sum() == n
    big = areas > 0.1 * KM**2  # bins of less expect too few draws for the chi-square law
    expected = n * areas / areas.sum()
    rest = [counts[~big].sum()], [expected[~big].sum()]
    chance = chi_square_chance(np.append(counts[big], rest[0]), np.append(expected[big], rest[1]))
    assert chance > RARE
