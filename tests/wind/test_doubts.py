"""Warnings on readings that do not fit the map or the law of errors."""

from __future__ import annotations

import numpy as np
import pytest

from pareto_ltl.support.errors import DataError
from pareto_ltl.wind.doubts import edge_warning, refuse_small_extent, spread_warning
from pareto_ltl.wind.named_laws import law_named

BOUNDS = np.array([[0.0, 0.0], [100e3, 50e3]])


def lattice(east, north):
    """Readings every 10 km up to ``east``, ``north`` [m]."""
    sides = np.meshgrid(np.arange(-50e3, east + 1, 10e3), np.arange(-50e3, north + 1, 10e3))
    return np.stack(sides, axis=-1).reshape(-1, 2)


def test_readings_that_end_inside_the_map_are_warned_of_with_the_distance():
    message = edge_warning("w.csv", BOUNDS, [lattice(150e3, 150e3), lattice(70e3, 150e3)])
    assert "w.csv: the readings end inside the map, which reaches up to 30 km beyond them" in message
    assert edge_warning("w.csv", BOUNDS, [lattice(100e3, 50e3)]) == ""


def test_readings_in_kilometres_are_refused_with_what_they_cover():
    points = np.array([[0.0, 0.0], [100.0, 50.0], [50.0, 20.0]])
    with pytest.raises(DataError, match=r"span 100 m, and the map 1e\+05 m: they cover 0.0001 % of it"):
        refuse_small_extent("w.csv", BOUNDS, points)
    refuse_small_extent("w.csv", BOUNDS, points * 1000)


@pytest.mark.parametrize(
    ("ratio", "words"), [(0.2, "may be larger"), (1.0, ""), (2.9, ""), (4.0, "may be small")]
)
def test_a_spread_unlike_that_of_the_law_is_warned_of(ratio, words):
    law = law_named("gfs")
    message = spread_warning("w.csv", law, law.level, ratio * law.spread)
    assert words in message
    assert bool(message) == bool(words)
    assert spread_warning("w.csv", law, "80m", ratio * law.spread) == ""  # there the law follows the spread
