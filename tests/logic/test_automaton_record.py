"""An automaton refuses tables that do not belong together, each alone."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pareto_ltl.logic import translate

GOOD = translate("F a & F b", [frozenset(), frozenset("a"), frozenset("b"), frozenset("ab")])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"letters": GOOD.letters[:-1]}, "letters must be 4 different sets"),
        ({"letters": (*GOOD.letters[:-1], GOOD.letters[0])}, "letters must be 4 different sets"),
        ({"accepting": GOOD.accepting[:-1]}, "must have shape"),
        ({"distance": GOOD.distance[:-1]}, "must have shape"),
        ({"delta": np.where(GOOD.delta == 1, GOOD.n_states, GOOD.delta)}, "delta must name states"),
        ({"delta": np.where(GOOD.delta == 1, -1, GOOD.delta)}, "delta must name states"),
        ({"initial": -1}, "got -1"),
        ({"initial": GOOD.n_states}, f"got {GOOD.n_states}"),
        ({"accepting": ~GOOD.accepting}, "must be absorbing"),
    ],
)
def test_one_wrong_table_is_refused(change: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        replace(GOOD, **change)


def test_the_last_state_may_be_the_first() -> None:
    assert replace(GOOD, initial=GOOD.n_states - 1).initial == GOOD.n_states - 1
