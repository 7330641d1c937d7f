"""Claims of large automata: what is needless is dropped."""

from __future__ import annotations

from itertools import chain, combinations

import numpy as np
import pytest

from plane_kernels.clearance import CERTAIN
from plane_logic.claim_lists import Claims, drop_needless, enter_claim, is_needless


def sets_of(regions: int) -> list[frozenset[int]]:
    """Sets of regions visited so far, as the states of a mission that visits all of them."""
    sizes = (combinations(range(regions), k) for k in range(regions + 1))
    return [frozenset(one) for one in chain.from_iterable(sizes)]


def claims_of(margins: list[float]) -> Claims:
    none = np.full(len(margins), -CERTAIN)
    claims = Claims(none, *(np.zeros(n, np.int64) for n in (len(margins), len(margins), 1)))
    for p, margin in enumerate(margins):
        if margin > -CERTAIN:
            enter_claim(claims, p, margin, p)
    return claims


@pytest.mark.parametrize("seed", range(5))
def test_of_the_sets_of_n_regions_visited_n_and_one_remain(seed: int) -> None:
    """Each is worth the least visit of its own: the chain of the best visits says all that they say."""
    sets, best = sets_of(6), np.random.default_rng(seed).normal(0.0, 1e4, 6)
    covers = np.array([[p <= q for p in sets] for q in sets])
    margins = [min((float(best[k]) for k in one), default=CERTAIN) for one in sets]
    claims = claims_of(margins)
    drop_needless(covers, claims)
    kept = claims.live[: claims.size[0]].tolist()
    assert len(kept) == 7
    assert kept == sorted(kept)
    for p, margin in enumerate(margins):
        assert is_needless(covers, claims, p, margin)
        assert margin == max(claims.margin[q] for q in kept if covers[q, p])
    assert (np.delete(claims.margin, kept) == -CERTAIN).all()


def test_of_claims_that_are_as_strong_and_as_sure_one_is_kept() -> None:
    claims = claims_of([5.0, 5.0, -CERTAIN, 5.0])
    drop_needless(np.ones((4, 4), bool), claims)
    assert claims.size[0] == 1


def test_a_stronger_claim_that_is_less_sure_leaves_the_weaker_one() -> None:
    claims, covers = claims_of([5.0, 3.0]), np.array([[True, False], [True, True]])
    drop_needless(covers, claims)
    assert claims.live[: claims.size[0]].tolist() == [0, 1]
    assert not is_needless(covers, claims, 0, 6.0)
    assert is_needless(covers, claims, 0, 4.0)
