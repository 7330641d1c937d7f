"""Small plans of each model have the numbers and texts that are recorded for them (``tests/recorded.py``).

On the processor of the record, with as many threads, they are equal to 1e-6. Elsewhere BLAS rounds otherwise,
and a search may end elsewhere within its tolerance: with the BLAS of another processor, 16 of 17 plans were
equal to 1e-3. There, what no search makes is equal to 1e-4, but for modes of the wind, which are eigenvectors
and may be others of one value; and the plan is about as long. Other versions of libraries fit winds
otherwise.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import golden
import recorded

pytestmark = pytest.mark.no_cover  # other tests run the same lines, and coverage is slow

KEPT = recorded.kept()
FIRST = ("scene.json", "cells.json", "automaton.json", "wind.nc")  # made without a search


def _same(*names: str) -> bool:
    made_by = recorded.made_by()
    return all(made_by[name] == KEPT["fingerprint"][name] for name in names)


def check(mission: str, tmp_path: Path) -> None:
    """Plan the mission, and compare what its results directory states with the record."""
    expected, here = KEPT["cases"][mission], recorded.found(mission, tmp_path)
    if _same("processor", "threads", *golden.LIBRARIES):
        assert recorded.differences(expected, here) == []
        return
    files = FIRST if _same(*golden.LIBRARIES) else FIRST[:-1]
    first = [
        {key: value for key, value in of_files.items() if key.startswith(files) and not key.endswith("modes")}
        for of_files in (expected, here)
    ]
    assert recorded.differences(*first, close=1e-4) == []
    lengths = [of_files["metrics.json:length_m"][1] for of_files in (expected, here)]
    assert lengths[1] == pytest.approx(lengths[0], rel=0.5)


@pytest.mark.parametrize("mission", sorted(KEPT["cases"].keys() - {*recorded.LONG}))
def test_a_small_plan_has_the_recorded_numbers(mission: str, tmp_path: Path) -> None:
    check(mission, tmp_path)


def test_every_mission_is_recorded(tmp_path: Path) -> None:
    assert KEPT["cases"].keys() == recorded.missions(tmp_path).keys()


@pytest.mark.parametrize("mission", KEPT["cases"])
def test_any_number_that_changes_in_the_fifth_place_is_noticed(mission: str) -> None:
    of_files = KEPT["cases"][mission]
    for key, (size, *sums) in of_files.items():
        if size == 0 or sums[1] == 0.0:
            continue
        rounded, other = ([size, sums[0] + part * sums[1], *sums[1:]] for part in (1e-9, 1e-5))
        assert recorded.differences(of_files, of_files | {key: rounded}) == []
        assert len(recorded.differences(of_files, of_files | {key: other})) == 1


def test_a_text_an_order_and_a_size_are_noticed() -> None:
    short = recorded.in_short
    assert short([1.0, 2.0]) != short([2.0, 1.0])
    assert short(["a", 1.0]) != short(["b", 1.0])
    assert short([1.0, None]) != short([1.0])
    assert np.isclose(short([3.0, "-4"])[2], 7.0)
