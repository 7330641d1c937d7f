"""Deterministic finite automata as arrays: product, good prefixes, minimisation, language inclusion.

A transition table is complete and deterministic: ``delta`` (Q, L) is the state after each letter, state 0 is
initial. The functions work on whole columns.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pareto_ltl.support.arrays import BoolArray, FloatArray, IntArray
from pareto_ltl.support.errors import FormulaError

MAX_ENTRIES = 2**24  # states x letters; 128 MiB as int64
SIFTING_LETTERS = 64  # letters applied to all pairs of states; the others to the remaining pairs
CHUNK_ENTRIES = 2**20  # table entries, or pairs of states, per block

TransitionArray = NDArray[np.integer]


class TransitionTable(NamedTuple):
    """``delta`` (Q, L) int, ``accepting`` (Q,) bool; state 0 is initial."""

    delta: TransitionArray
    accepting: BoolArray


def too_many_states(max_states: int) -> FormulaError:
    """The error of an automaton with more than ``max_states`` states."""
    return FormulaError(
        f"the automaton has more than {max_states} states; simplify the formula, pass only the letters "
        "that can occur, or raise logic.max_states"
    )


def check_table_size(states: int, letters: int, max_states: int) -> None:
    """Raise a FormulaError if the table has too many states or entries."""
    if states > max_states:
        raise too_many_states(max_states)
    if states * letters > MAX_ENTRIES:
        raise FormulaError(
            f"the automaton needs a table of more than {states - 1} states x {letters} letters "
            f"({MAX_ENTRIES} entries are the limit); pass only the letters that can occur"
        )


def product_table(a: TransitionTable, b: TransitionTable, both: bool, max_states: int) -> TransitionTable:
    """Table of ``a & b`` if ``both``, else of ``a | b``; its states are the reachable pairs of states.

    Decided pairs (one state is a trap for ``&``, one accepts for ``|``) are merged into the last state. Both
    tables must be minimal. Raises a FormulaError if there are more than ``max_states`` states.
    """
    letters, wide = a.delta.shape[1], len(b.delta)
    if len(a.delta) * wide >= 2**31:
        raise too_many_states(max_states)
    decided_a, decided_b = (trap_states(t) if both else t.accepting for t in (a, b))
    if decided_a[0] or decided_b[0]:
        return TransitionTable(np.zeros((1, letters), np.int64), np.array([not both]))
    da, db = a.delta.astype(np.int64) * wide, b.delta.astype(np.int64)
    # number of each pair, from 1; -1 decided, 0 not met; pages that are never written use no memory
    number = np.zeros(len(da) * wide, np.int32)
    number[0] = 1
    scratch = np.empty(len(number), np.int32)
    pairs, rows, done, width = np.array([0]), [], 0, max(1, CHUNK_ENTRIES // letters)
    while done < len(pairs):
        now = pairs[done : done + width]
        done += len(now)
        after = da[now // wide] + db[now % wide]
        rows.append(after)
        fresh = first_occurrences(after[number[after] == 0], scratch)
        decided = decided_a[fresh // wide] | decided_b[fresh % wide]
        number[fresh[decided]] = -1
        fresh = fresh[~decided]
        number[fresh] = np.arange(len(pairs), len(pairs) + len(fresh)) + 1
        pairs = np.concatenate([pairs, fresh])
        check_table_size(len(pairs) + 1, letters, max_states)
    number[number < 0] = len(pairs) + 1
    last = np.full((1, letters), len(pairs) + 1, np.int32)
    delta = np.concatenate([*(number[after] for after in rows), last]) - 1
    accepting = a.accepting[pairs // wide] & b.accepting[pairs % wide]
    return TransitionTable(delta, np.append(accepting, not both))


def first_occurrences(values: Any, scratch: NDArray[np.int32]) -> IntArray:
    """``values`` without repetitions, in the order of their first occurrence, in linear time.

    ``scratch`` is a work array that ``values`` can index.
    """
    places = np.arange(len(values), dtype=np.int32)
    scratch[values[::-1]] = places[::-1]
    first: IntArray = values[scratch[values] == places]
    return first


def trap_states(table: TransitionTable) -> BoolArray:
    """Whether a state of a minimal table does not accept and is never left, shape (Q,); at most one is."""
    stay: BoolArray = (table.delta == np.arange(len(table.delta))[:, None]).all(axis=1)
    return stay & ~table.accepting


def certain_states(delta: TransitionArray, accepting: BoolArray) -> BoolArray:
    """States from which every infinite word reaches acceptance, shape (Q,) bool.

    Good prefixes lead to these states: from any other state, some letter leads to another such state, for
    ever.
    """
    while True:
        more = accepting | accepting[delta].all(axis=1)
        if (more == accepting).all():
            return accepting
        accepting = more


def acceptance_distances(delta: TransitionArray, accepting: BoolArray) -> FloatArray:
    """Smallest number of letters to acceptance, d_A, shape (Q,); inf if there is no way."""
    distance = np.where(accepting, 0.0, np.inf)
    near, steps = accepting, 0
    while near.any():
        steps += 1
        near = near[delta].any(axis=1) & np.isinf(distance)
        distance[near] = steps
    return distance


def minimal_table(table: TransitionTable) -> tuple[TransitionTable, FloatArray]:
    """The minimal table of the good prefixes, and its distances to acceptance (Q,).

    States are numbered in the order of a breadth-first search, so that equal languages over equal letters
    give equal tables.
    """
    delta = table.delta
    accepting = certain_states(delta, table.accepting)
    distance = acceptance_distances(delta, accepting)
    block = refine_partition(delta, np.unique(distance, return_inverse=True)[1])
    member = np.empty(block.max() + 1, np.int64)
    member[block] = np.arange(len(block))
    quotient = block[delta[member]]
    order = breadth_first_order(quotient, int(block[0]))
    number = np.empty(len(member), np.int64)
    number[order] = np.arange(len(order))
    member = member[order]
    return TransitionTable(number[quotient[order]], accepting[member]), distance[member]


def refine_partition(delta: TransitionArray, block: IntArray) -> IntArray:
    """The coarsest refinement of the partition ``block`` (Q,) in which a letter maps a block into one block.

    As in Hopcroft's algorithm (1971), the largest part of a split block keeps its number, and only
    predecessors of the other parts are processed again. The signature of a state is a random linear form of
    the blocks of its successors. Different states have equal signatures with a probability of about 2^-50,
    and the result is checked. ``block`` comes from the distances to acceptance, which equivalent states
    share: then 1 to 3 iterations are typical, instead of up to max d_A iterations from acceptance alone.
    """
    random = np.random.default_rng(len(delta))
    while True:
        weights = random.integers(1, 2**63, delta.shape[1], np.uint64)
        result = _split_blocks(delta, block.astype(np.uint64), weights).astype(np.int64)
        member = np.empty(result.max() + 1, np.int64)
        member[result] = np.arange(len(result))
        if (result[delta] == result[delta[member]][result]).all():
            return result


def _split_blocks(
    delta: TransitionArray, block: NDArray[np.uint64], weights: NDArray[np.uint64]
) -> NDArray[np.uint64]:
    signature = np.zeros(len(block), np.uint64)
    touched = np.ones(len(block), np.bool_)
    while touched.any():
        signature[touched] = block[delta[touched]] @ weights
        order = np.lexsort((signature, block))
        b, s = block[order], signature[order]
        edge = np.append(True, (b[1:] != b[:-1]) | (s[1:] != s[:-1]))
        start = np.flatnonzero(edge)
        size = np.diff(start, append=len(order))
        ranked = np.lexsort((-size, b[start]))  # parts by block, the largest first
        owner = b[start][ranked]
        renamed = ranked[np.append(False, owner[1:] == owner[:-1])]
        name = b[start]
        name[renamed] = len(start) - len(renamed) + np.arange(len(renamed), dtype=np.uint64)
        fresh = np.zeros(len(start), np.bool_)
        fresh[renamed] = True
        part = np.cumsum(edge) - 1
        block[order] = name[part]
        moved = np.empty(len(block), np.bool_)
        moved[order] = fresh[part]
        touched[:] = moved[delta].any(axis=1)
    return block


def breadth_first_order(delta: TransitionArray, initial: int) -> IntArray:
    """States in the order of a breadth-first search from ``initial`` over the letters."""
    met = np.zeros(len(delta), np.bool_)
    met[initial] = True
    scratch = np.empty(len(delta), np.int32)
    levels = [np.array([initial])]
    while len(levels[-1]):
        after = delta[levels[-1]].ravel()
        fresh = first_occurrences(after[~met[after]], scratch)
        met[fresh] = True
        levels.append(fresh)
    return np.concatenate(levels)


def language_inclusion(delta: TransitionArray, distance: FloatArray) -> BoolArray:
    """Shape (Q, Q) bool: ``[p, q]`` is True if ``p`` accepts every word that ``q`` accepts.

    It is the largest relation with d(p) <= d(q) that every letter preserves: if q accepts a word and p does
    not, some prefix of it leads to a pair with d(q) = 0 < d(p).
    """
    columns = np.unique(delta, axis=1).T
    holds = _never_farther(columns[:SIFTING_LETTERS], distance)
    changed = True
    while changed:
        changed = False
        for p, q in _undecided_pairs(holds, distance):
            for after in columns:
                keep = holds[after[p], after[q]]
                if not keep.all():
                    holds[p[~keep], q[~keep]] = False
                    p, q, changed = p[keep], q[keep], True
    return holds


def _never_farther(columns: TransitionArray, distance: FloatArray) -> BoolArray:
    """Pairs (p, q) with d(p) <= d(q), now and after each letter; 1 ns per pair and letter."""
    rank = np.unique(distance, return_inverse=True)[1].astype(np.int32)
    if rank.max() < 2**15:
        rank = rank.astype(np.int16)
    holds = np.empty((len(rank), len(rank)), np.bool_)
    height = max(1, CHUNK_ENTRIES // len(rank))
    for top in range(0, len(rank), height):
        rows = holds[top : top + height]
        np.less_equal(rank[top : top + height, None], rank, out=rows)
        for after in columns:
            there = rank[after]
            rows &= there[top : top + height, None] <= there
    return holds


def _undecided_pairs(holds: BoolArray, distance: FloatArray) -> Iterator[tuple[IntArray, IntArray]]:
    """The pairs of ``holds`` that further letters may exclude, in blocks of rows."""
    height = max(1, CHUNK_ENTRIES // len(holds))
    for top in range(0, len(holds), height):
        p, q = np.nonzero(holds[top : top + height])
        p += top
        open_ = (p != q) & (distance[p] > 0) & np.isfinite(distance[q])
        yield p[open_], q[open_]
