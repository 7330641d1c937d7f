"""The ordered bound V along a path, stored as a few entries (automaton state, V).

    V_t(p) = min(1, min_q [V_{t-1}(q) + P(label not in {s : δ(q, s) ≥ p}) + Σ_h P(hazard h met)]),

with the sum over the hazards whose label loses q. V is monotone: V(p) ≤ V(p') if p' ≥ p. So a row holds a few
entries (state, V), and V(p) is the smallest V of the entries with a state ≥ p, or 1 if there is none. A state
needs no entry if a state ≥ it, lost by the same hazards, has an entry with a V that is not larger.

With the ``targets`` of each state (:class:`~plane_logic.types.Ordered`), the entries represent V exactly.
Without, only the states to which a letter leads are followed, and only the most promising entries are kept.
Leaving out an entry removes one way to complete the mission, so the bound can become larger than V, but it
remains an upper bound of the mission risk.
"""

from __future__ import annotations

from plane_kernels.geometry import locate_cell
from plane_kernels.types import Cov, FloatArray, Gaussian, Int32Array, Point
from plane_logic.letters import epoch_at, next_state
from plane_logic.mission_risk import read_labels, read_place, read_way
from plane_logic.types import Letters, LiveRows, Ordered
from typed_kernels.jit import allocating, inlined, kernel

STEP_WORTH = 0.25  # weight of one transition to acceptance against V when entries are left out


@kernel
def begin_bound(bound: Ordered, rows: LiveRows, row: int) -> None:
    """V(p) before the first letter: 0 if the initial state accepts all that p accepts, else 1.

    Eq. (M37) of docs/mathematics.md.
    """
    first = rows.first[row]
    rows.size[row] = len(bound.begin)
    for k in range(len(bound.begin)):
        rows.state[first + k], rows.value[first + k] = bound.begin[k], 0.0


@kernel
def note_letters(bound: Ordered, letters: Letters) -> bool:
    """List the letters and hazards with a probability above 0; False if only the empty letter can be read."""
    parts, hazards = len(bound.labelled.cell), len(bound.logic.hazards.cell)
    labels, ways = 0, 0
    for part in range(parts):
        if letters.seen[part] > 0.0:
            letters.parts[labels] = part
            labels += 1
    for h in range(hazards):
        if letters.met[h] > 0.0:
            letters.hazards[ways] = h
            ways += 1
    letters.listed[0], letters.listed[1] = labels, ways
    return labels + ways > 0


@kernel
def stays(bound: Ordered, letters: Letters, rows: LiveRows, row: int) -> bool:
    """Whether the empty letter leaves every state of a row unchanged."""
    delta, e = bound.logic.delta, letters.epoch[0]
    empty = delta.shape[2] - 1
    for k in range(rows.first[row], rows.first[row] + rows.size[row]):
        if delta[e, rows.state[k], empty] != rows.state[k]:
            return False
    return True


@inlined
def promise_cost(bound: Ordered, letters: Letters, q: int, p: int, value: float) -> float:
    """V(q) + P(the letter does not lead from q to a state ≥ p) + Σ P(a hazard that loses q is met).

    Eq. (M37) of docs/mathematics.md.
    """
    delta, covers, loses = bound.logic.delta, bound.logic.covers, bound.logic.loses
    e = letters.epoch[0]
    empty = delta[e, q, delta.shape[2] - 1]
    if empty != p and not covers[empty, p]:
        value += letters.seen[len(bound.labelled.cell)]
    for i in range(letters.listed[0]):
        part = letters.parts[i]
        cell = bound.labelled.cell[part]
        to = delta[e, q, cell]
        if to != p and not covers[to, p] and not loses[e, q, cell]:
            value += letters.seen[part]
    for i in range(letters.listed[1]):
        h = letters.hazards[i]
        if loses[e, q, bound.logic.hazards.cell[h]]:
            value += letters.met[h]
    return value


@inlined
def offer(
    bound: Ordered, letters: Letters, q: int, p: int, value: float, rows: LiveRows, row: int, planned: int
) -> None:  # fmt: skip
    """Enter p into a row with its cost from q at V(q) = ``value``; of each state the least cost is kept."""
    cost = promise_cost(bound, letters, q, p, value)
    if cost >= 1.0:
        return
    place, first = letters.place, rows.first[row]
    if place[p] >= 0:
        rows.value[first + place[p]] = min(rows.value[first + place[p]], cost)
        return
    if rows.size[row] == 2 * rows.most:
        leave_out(bound, letters.place, rows, row, planned)
    k = rows.size[row]
    place[p] = k
    rows.state[first + k], rows.value[first + k] = p, cost
    rows.size[row] = k + 1


@inlined
def count_targets(bound: Ordered, letters: Letters, q: int) -> int:
    """Number of states to which an entry at q can lead."""
    listed = bound.targets.ptr[q + 1] - bound.targets.ptr[q]
    return int(listed if listed > 0 else 2 + letters.listed[0])


@inlined
def target_state(bound: Ordered, letters: Letters, q: int, i: int) -> int:
    """State i of those that :func:`count_targets` counts: of the list, or q and states after a letter."""
    first, delta, e = bound.targets.ptr[q], bound.logic.delta, letters.epoch[0]
    if bound.targets.ptr[q + 1] > first:
        return int(bound.targets.state[first + i])
    if i == 0:
        return int(q)
    if i == 1:
        return int(delta[e, q, delta.shape[2] - 1])
    return int(delta[e, q, bound.labelled.cell[letters.parts[i - 2]]])


@kernel
def read_letter(
    bound: Ordered, letters: Letters, before: LiveRows, row: int, now: LiveRows, target: int, planned: int
) -> None:  # fmt: skip
    """Write V after one more letter to row ``target`` of ``now``, from ``row`` of ``before``.

    ``now`` has space for 2 ``most`` entries. When entries are left out, the entry of the state ``planned`` is
    kept.

    Eq. (M37) of docs/mathematics.md.
    """
    now.size[target] = 0
    for k in range(before.first[row], before.first[row] + before.size[row]):
        q, last = int(before.state[k]), -1
        for i in range(count_targets(bound, letters, q)):
            p = target_state(bound, letters, q, i)
            if p != last:
                offer(bound, letters, q, p, before.value[k], now, target, planned)
                last = p
    if now.size[target] > now.most:
        leave_out(bound, letters.place, now, target, planned)
    for k in range(now.first[target], now.first[target] + now.size[target]):
        letters.place[now.state[k]] = -1


@kernel
def leave_out(bound: Ordered, place: Int32Array, rows: LiveRows, row: int, planned: int) -> None:
    """Keep ``most`` entries of a row: those with the least V + ``STEP_WORTH`` d_A, and one for ``planned``.

    The latter is the entry that determines V of the state ``planned``.
    """
    first, count = rows.first[row], rows.size[row]
    for k in range(first, first + count):
        place[rows.state[k]] = -1
    for k in range(first + 1, first + count):
        sink_entry(bound, rows, first, k)
    raise_planned(bound, rows, first, count, planned)
    rows.size[row] = keep_useful(bound, rows, first, count)
    for k in range(rows.size[row]):
        place[rows.state[first + k]] = k


@inlined
def sink_entry(bound: Ordered, rows: LiveRows, first: int, k: int) -> None:
    """Insert entry k into the sorted entries before it; at equal rank the smaller state comes first."""
    state, value, j = rows.state[k], rows.value[k], k
    rank = entry_rank(bound, state, value)
    while j > first:
        other = entry_rank(bound, rows.state[j - 1], rows.value[j - 1])
        if other < rank or (other == rank and rows.state[j - 1] < state):
            break
        rows.state[j], rows.value[j] = rows.state[j - 1], rows.value[j - 1]
        j -= 1
    rows.state[j], rows.value[j] = state, value


@inlined
def entry_rank(bound: Ordered, state: int, value: float) -> float:
    """Sort key of an entry when some are left out: V + ``STEP_WORTH`` d_A."""
    return float(value + STEP_WORTH * bound.logic.distance[state])


@inlined
def raise_planned(bound: Ordered, rows: LiveRows, first: int, count: int, planned: int) -> None:
    """Move the entry that determines V of the state ``planned`` to the front."""
    held, best = -1, 1.0
    for k in range(first, first + count):  # of equal V the first is nearest to acceptance
        if rows.value[k] < best and bound.logic.covers[rows.state[k], planned]:
            held, best = k, rows.value[k]
    if held > first:
        state = rows.state[held]
        for k in range(held, first, -1):
            rows.state[k], rows.value[k] = rows.state[k - 1], rows.value[k - 1]
        rows.state[first], rows.value[first] = state, best


@kernel
def keep_useful(bound: Ordered, rows: LiveRows, first: int, count: int) -> int:
    """Move up to ``most`` entries to the front, without those that an earlier one makes redundant.

    Returns the number of entries kept.
    """
    covers, kind, kept = bound.logic.covers, bound.kind, 0
    for k in range(first, first + count):
        p, value, needless = rows.state[k], rows.value[k], False
        for i in range(first, first + kept):
            other = rows.state[i]
            if rows.value[i] <= value and kind[other] == kind[p] and covers[other, p]:
                needless = True
                break
        if not needless:
            rows.state[first + kept], rows.value[first + kept] = p, value
            kept += 1
            if kept == rows.most:
                break
    return kept


@allocating
def ordered_risk(
    bound: Ordered, rows: LiveRows, letters: Letters, x: FloatArray, cov: FloatArray
) -> float:  # fmt: skip
    """The bound V of the mission risk of a path ``x`` (T+1, 2) [m] with ``cov`` (T+1, 3) = (xx, xy, yy) [m²].

    ``rows`` (two rows) and ``letters`` are scratch.

    Eq. (M37) of docs/mathematics.md.
    """
    logic = bound.logic
    begin_bound(bound, rows, 0)
    before = Gaussian(Point(x[0, 0], x[0, 1]), Cov(cov[0, 0], cov[0, 1], cov[0, 2]))
    cell = locate_cell(bound.cells, before.mean)
    q, now = logic.initial, 0
    for t in range(len(x)):
        letters.epoch[0] = epoch_at(logic.epoch, t)
        here = Gaussian(Point(x[t, 0], x[t, 1]), Cov(cov[t, 0], cov[t, 1], cov[t, 2]))
        read_labels(bound, here, letters.seen)
        if t == 0:
            read_place(bound, here, letters.met)
            q = int(logic.delta[logic.epoch[0], q, cell])
        else:
            read_way(bound, before, here, letters.met)
            there = locate_cell(bound.cells, here.mean)
            q, cell = next_state(bound.cells, logic, t, q, before.mean, cell, here.mean, there), there
        if note_letters(bound, letters) or not stays(bound, letters, rows, now):
            read_letter(bound, letters, rows, now, rows, 1 - now, q)
            now = 1 - now
        before = here
    least = 1.0
    for k in range(rows.first[now], rows.first[now] + rows.size[now]):
        if logic.distance[rows.state[k]] == 0.0:
            least = min(least, rows.value[k])
    return least
