"""Values that a law of changes may just have, or just not."""

from __future__ import annotations

from typing import Any

import pytest

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
