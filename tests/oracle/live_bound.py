"""The ordered bound kept for live states, with dictionaries (:mod:`plane_logic.ordered_bound`)."""

from __future__ import annotations

from collections.abc import Mapping

from pareto_ltl.planning.pack_logic import Reading
from pareto_ltl.support.arrays import FloatArray, IntArray
from plane_logic.ordered_bound import STEP_WORTH


def live_bound(logic: Reading, entries: Mapping[int, float], p: int) -> float:
    """V(p) = min over entries q ≥ p; 1 if there is no such entry."""
    return min([1.0, *(value for q, value in entries.items() if logic.covers[q, p])])


def read_live_letter(
    logic: Reading, entries: Mapping[int, float], column: IntArray, seen: FloatArray, met: FloatArray
) -> dict[int, float]:
    """Entries after one more letter: of each q itself and of the states after letters that may be read.

    ``column`` (L + 1,) of ``logic.delta`` for each label and, last, for none; ``seen`` (L + 1,) = P(label),
    ``met`` (H,) = P(hazard met).
    """
    found: dict[int, float] = {}
    for q, value in entries.items():
        read = column[:-1][seen[:-1] > 0.0]
        for p in {q, int(logic.delta[q, column[-1]]), *logic.delta[q, read].tolist()}:
            spoils = ~logic.covers[logic.delta[q, column], p]
            spoils[:-1] &= ~logic.loses[q, column[:-1]]
            met_here = met[logic.loses[q, logic.hazards.cell]]
            cost = value
            for term in (seen[-1] * spoils[-1], *(seen[:-1] * spoils[:-1]), *met_here):
                cost += float(term)  # in the order of the kernel, to the last bit
            if cost < 1.0:
                found[p] = min(found.get(p, 1.0), cost)
    return found


def keep_live(
    logic: Reading, kind: IntArray, entries: Mapping[int, float], most: int, planned: int
) -> dict[int, float]:
    """At most ``most`` entries, none dominated: first V(``planned``), then by V + ``STEP_WORTH`` d_A."""
    if len(entries) <= most:
        return dict(entries)
    order = sorted(entries, key=lambda q: (entries[q] + STEP_WORTH * logic.distance[q], q))
    held = [q for q in order if logic.covers[q, planned]]
    if held:
        first = min(held, key=lambda q: (entries[q], logic.distance[q], q))
        order = [first, *(q for q in order if q != first)]
    kept: dict[int, float] = {}
    for p in order:
        needless = any(v <= entries[p] and kind[q] == kind[p] and logic.covers[q, p] for q, v in kept.items())
        if not needless and len(kept) < most:
            kept[p] = entries[p]
    return kept
