"""Results that must not change by accident: the paper's planner on both missions, three seeds each.

On a machine like the one that made ``golden.json`` the files are equal byte for byte; with another number of
cores or another libm, the numbers in them are equal to 1e-6. On another processor, where BLAS and kernels
round differently, a solver or a tree may end elsewhere within its tolerance, and what comes of it is as good:
the shortest path and the least risk are nearly the same. ``tests/golden.py`` makes them anew.
With other versions of the libraries, which the lock file picks for other versions of Python, fits of the wind
end elsewhere within their tolerance, and nothing is compared.
"""

from __future__ import annotations

import numpy as np
import pytest

import golden

pytestmark = pytest.mark.no_cover  # other tests run the same lines, and coverage is slow

KEPT = golden.reference()
CLOSE = 1e-6  # relative


def differences(expected, found):
    """Names of the numbers that differ by more than 1e-6."""
    assert found.keys() == expected.keys()
    return [
        name
        for name in expected
        if len(found[name]) != len(expected[name])
        or not np.allclose(found[name], expected[name], rtol=CLOSE, atol=1e-300)
    ]


def as_good(expected, found):
    """Whether the shortest path is as short, within 2 %, and the least risk as small, within a factor of two.

    On another processor one rounded comparison may let a tree grow otherwise; the least risk is its most
    variable number (0.68 and 1.48 times in two of six runs).
    """
    shortest, safest = (min(found[name]) / min(expected[name]) for name in ("length_m", "mission_risk"))
    grown = np.sum(found["trees_size"]) / np.sum(expected["trees_size"])
    return abs(shortest - 1) < 0.02 and 0.5 < safest < 2.0 and abs(grown - 1) < 0.02


@pytest.mark.parametrize(("mission", "seed"), golden.CASES)
def test_a_run_of_the_papers_planner_gives_the_same_results(mission, seed, tmp_path):
    kept, here = (
        {name: told[name] for name in golden.LIBRARIES}
        for told in (KEPT["fingerprint"], golden.fingerprint())
    )
    if kept != here:
        pytest.skip(f"the reference was made with other versions, whose fits round differently: {kept}")
    expected = KEPT["cases"][f"{mission}_{seed}"]
    directory = golden.run_case(mission, seed, tmp_path)
    found = golden.numbers(directory)
    assert as_good(expected["numbers"], found)
    if golden.fingerprint()["processor"] == KEPT["fingerprint"]["processor"]:
        assert differences(expected["numbers"], found) == []
    if golden.fingerprint() == KEPT["fingerprint"]:
        assert golden.digests(directory) == expected["digests"]


@pytest.mark.parametrize("case", KEPT["cases"])
def test_numbers_that_change_in_the_sixth_place_are_noticed(case):
    """The comparison on other machines accepts rounding and nothing else."""
    kept = KEPT["cases"][case]["numbers"]
    assert differences(kept, {k: [v * (1 + 1e-9) for v in values] for k, values in kept.items()}) == []
    for name, values in kept.items():
        changed = kept | {name: [values[0] * (1 + 3e-6), *values[1:]]}
        assert differences(kept, changed) == [name]
        assert differences(kept, kept | {name: values[1:]}) == [name]
