"""Values that a law of changes, a thinned set of readings and a label may just have, or just not."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pareto_ltl.support.errors import DataError
from pareto_ltl.wind.observations import FAR_SHARE, thinned
from pareto_ltl_apps.formats.hoa_files import parse_hoa
from wind_laws.change_law import ChangeLaw

GOOD: dict[str, Any] = {
    "spread": 3.0, "power": 0.0, "latitude": 40.0, "slope": 0.01, "freedom": 2.0, "most_freedom": 50.0,
    "situations": 1,
}  # fmt: skip


def test_a_law_of_changes_may_have_one_situation_and_no_power() -> None:
    assert ChangeLaw(**GOOD).situations == 1


@pytest.mark.parametrize(
    ("name", "value"),
    [("spread", 0.0), ("power", -0.1), ("freedom", 0.0), ("most_freedom", 0.0), ("situations", 0)],
)
def test_each_value_that_a_law_of_changes_cannot_have_is_refused(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=r"change\.winds"):
        ChangeLaw(**GOOD | {name: value})


@given(st.integers(0, 2**32 - 1), st.integers(10, 30), st.integers(10, 30), st.floats(0.0, 1.0))
def test_readings_beside_the_scene_stay_and_leave_their_share_to_others(
    seed: int, count: int, limit: int, share: float
) -> None:
    rng = np.random.default_rng(seed)
    beside, around = rng.random(count) < share, 2.0 * np.pi * np.arange(count) / count
    ring = 1e3 * np.column_stack([np.cos(around), np.sin(around)])  # others are far from the scene and apart
    points = np.where(beside[:, None], rng.normal(size=(count, 2)), ring)
    found = thinned(points, beside, np.zeros(2), limit)
    assert len(found) == min(count, limit)
    assert list(found) == sorted(set(found.tolist()))
    if count <= limit:
        return
    near, far = int(beside[found].sum()), int((~beside)[found].sum())
    assert far >= min(int(FAR_SHARE * limit), int((~beside).sum()))
    if near < beside.sum():  # not all of these: the others have their share and no more
        assert far == min(int(FAR_SHARE * limit), int((~beside).sum()))
        inner = np.flatnonzero(beside)
        assert inner[np.argmin(np.hypot(*points[inner].T))] in found


@pytest.mark.parametrize("label", ["(0", "(0 | 1", "((0)", "!(0 1)"])
def test_a_bracket_that_stays_open_is_refused(label: str) -> None:
    with pytest.raises(DataError, match=r"expected '\)'"):
        parse_hoa(
            'HOA: v1\nStates: 1\nStart: 0\nAP: 2 "a" "b"\nAcceptance: 1 Inf(0)\n--BODY--\n'
            f"State: 0 {{0}}\n[{label}] 0\n--END--\n"
        )
