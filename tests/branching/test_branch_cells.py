"""Cells of measured positions: they divide the plane, and their moments are those of sampled positions."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pareto_ltl.extend import BranchFix, Cell, cells_of
from pareto_ltl_apps.branching.moments import cell_moments, truncated
from pareto_ltl_apps.branching.tree_search import divisions, rounded_places

INF = math.inf
DRAWS = 400_000
COV = np.array([[9.0, 2.4], [2.4, 4.0]])


@st.composite
def laws(draw: st.DrawFn) -> tuple[np.ndarray, np.ndarray]:
    """A mean and a covariance of two distances."""
    number = st.floats(-3.0, 3.0)
    root = np.array([[draw(st.floats(0.3, 3.0)), 0.0], [draw(number), draw(st.floats(0.3, 3.0))]])
    return np.array([draw(number), draw(number)]), root @ root.T


@pytest.mark.parametrize(
    "cell",
    [
        Cell(left=(0.5, INF)),
        Cell(along=(-INF, -1.0)),
        Cell(left=(-1.0, 2.0)),
        Cell((0.0, INF), (-INF, 1.0)),
        Cell((-2.0, 1.0), (0.5, INF)),
        Cell(),
    ],
)
def test_moments_of_a_cell_are_those_of_sampled_positions(cell: Cell) -> None:
    """Within 6 standard errors; half-planes by the closed form, boxes by quadrature, against NumPy alone."""
    mean = np.array([0.4, -0.3])
    y = np.random.default_rng(3).multivariate_normal(mean, COV, DRAWS)
    (a, b), (c, d) = cell.along, cell.left
    held = y[(y[:, 0] >= a) & (y[:, 0] < b) & (y[:, 1] >= c) & (y[:, 1] < d)]
    found = cell_moments(cell, mean, COV)
    assert found.share == pytest.approx(len(held) / DRAWS, abs=6 * 0.5 / math.sqrt(DRAWS) + 1e-9)
    error = np.sqrt(np.diag(COV) / len(held))
    assert (np.abs(found.mean - held.mean(axis=0)) < 6 * error).all()
    assert np.abs(found.cov - np.cov(held.T)).max() < 6 * 9.0 * math.sqrt(2.0 / len(held))


@given(laws(), st.floats(-4.0, 4.0), st.floats(-4.0, 4.0))
def test_cells_of_a_division_have_the_moments_of_the_whole(
    law: tuple[np.ndarray, np.ndarray], first: float, second: float
) -> None:
    """The law of total expectation and of total variance: nothing is lost between four cells."""
    mean, cov = law
    cells = [
        Cell(along, left)
        for along in ((-INF, first), (first, INF))
        for left in ((-INF, second), (second, INF))
    ]
    parts = []
    for cell in cells:
        try:
            parts.append(cell_moments(cell, mean, cov))
        except ValueError:  # no probability
            continue
    size = np.trace(cov)
    assert sum(part.share for part in parts) == pytest.approx(1.0, abs=1e-7)
    assert sum(part.share * part.mean for part in parts) == pytest.approx(mean, abs=1e-6 * math.sqrt(size))
    second_moment = sum(
        part.share * (part.cov + np.outer(part.mean - mean, part.mean - mean)) for part in parts
    )
    assert second_moment == pytest.approx(cov, abs=1e-5 * size)


@given(laws(), st.floats(-6.0, 6.0))
def test_a_cell_never_widens_a_gaussian(law: tuple[np.ndarray, np.ndarray], end: float) -> None:
    """S - V is positive semidefinite, so that what a cell tells has a root."""
    mean, cov = law
    try:
        found = cell_moments(Cell(left=(end, INF)), mean, cov)
    except ValueError:
        return
    assert np.linalg.eigvalsh(cov - found.cov).min() >= -1e-9 * np.trace(cov)


@pytest.mark.parametrize("far", [5.0, 12.0, 30.0])
def test_a_far_tail_keeps_its_digits(far: float) -> None:
    """Mills' ratio: beyond r standard deviations, the mean is about r + 1 / r, the variance 1 / r²."""
    share, mean, variance = truncated(0.0, 1.0, (far, INF))
    assert 0.0 < share < 1e-6
    assert far < mean < far + 1.0 / far
    assert 0.0 <= variance < 1.0 / far**2
    mirrored = truncated(0.0, 1.0, (-INF, -far))
    assert mirrored[0] == pytest.approx(share, rel=1e-12)
    assert mirrored[1] == pytest.approx(-mean, rel=1e-12)


@pytest.mark.parametrize("leaves", [2, 3, 4])
def test_every_division_covers_the_plane_once(leaves: int) -> None:
    """Lines lie at round distances, and points on a line belong to one cell."""
    y = np.random.default_rng(1).normal(0.0, [8000.0, 3000.0], (300, 2))
    places = [rounded_places(y[:, i]) for i in (0, 1)]
    points = np.vstack([y, np.array([[a, b] for a in places[0] for b in places[1]])])
    found = list(divisions(y, leaves))
    assert len(found) > 15
    assert len(set(found)) == len(found)
    for cells in found:
        assert len(cells) == leaves
        number = cells_of(cells, points)  # raises if a point is in no cell, or in two
        assert set(number) <= set(range(leaves))
    assert all(place % 500.0 == 0.0 for place in places[0])


def test_cells_that_leave_a_gap_are_refused() -> None:
    """A position between two cells would have no table."""
    cells = Cell(left=(1.0, INF)), Cell(left=(-INF, 0.0))
    with pytest.raises(ValueError, match="do not divide the plane"):
        cells_of(cells, np.array([[0.0, 0.5]]))


def test_distances_are_along_the_track_and_left_of_it() -> None:
    """Towards north-east: north-west is left, and the place itself is at 0."""
    ahead = np.array([1.0, 1.0]) / math.sqrt(2.0)
    fix = BranchFix(3, np.array([100.0, 200.0]), ahead, 10.0)
    y = fix.place + np.array([[0.0, 0.0], [1.0, 1.0], [-1.0, 1.0]])
    root = math.sqrt(2.0)
    assert fix.distances(y) == pytest.approx(np.array([[0.0, 0.0], [root, 0.0], [0.0, root]]))


@pytest.mark.parametrize(
    ("cell", "words"),
    [
        (Cell(left=(0.0, INF)), "left of the planned track"),
        (Cell(left=(-INF, 0.0)), "right of the planned track"),
        (Cell(left=(5000.0, INF)), "more than 5.0 km left of the planned track"),
        (Cell(left=(-5000.0, INF)), "left of the planned track, or less than 5.0 km right of it"),
        (Cell(left=(-INF, 5000.0)), "right of the planned track, or less than 5.0 km left of it"),
        (Cell(left=(0.0, 5000.0)), "left of the planned track by less than 5.0 km"),
        (Cell(left=(-9000.0, -5000.0)), "between 5.0 km and 9.0 km right of the planned track"),
        (Cell(left=(-5000.0, 9000.0)), "less than 5.0 km right of, or 9.0 km left of, the planned track"),
        (
            Cell((-INF, -5000.0), (0.0, INF)),
            "left of the planned track, and more than 5.0 km behind the planned position (along the track)",
        ),
        (Cell(), "anywhere"),
    ],
)
def test_the_words_of_a_cell_say_where_it_is(cell: Cell, words: str) -> None:
    """Each word is checked against a position in the cell by the numbers above."""
    assert cell.words == words
