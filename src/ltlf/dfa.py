"""Deterministic finite automata as arrays: product, good prefixes, minimisation, language inclusion.

A transition table is complete and deterministic: ``delta`` (Q, L) is the state after each letter, state 0 is
initial.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ltlf.errors import FormulaError, StatesError

MAX_ENTRIES = 2**24  # states x letters; 128 MiB as int64
SAMPLE_LETTERS = 32  # number of letters by which blocks are split first, before all letters are used
BLOCK_ENTRIES = 2**16  # table entries, or pairs of states, per block: small enough for the cache

BoolArray = NDArray[np.bool_]
FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
TransitionArray = NDArray[np.integer]


class TransitionTable(NamedTuple):
    """``delta`` (Q, L) int, ``accepting`` (Q,) bool; state 0 is initial."""

    delta: TransitionArray
    accepting: BoolArray


def check_table_size(states: int, letters: int, max_states: int) -> None:
    """Raise a FormulaError if the table has too many states or entries."""
    if states > max_states:
        raise StatesError(max_states)
    if states * letters > MAX_ENTRIES:
        raise FormulaError(
            f"the automaton needs a table of more than {states - 1} states x {letters} letters "
            f"({MAX_ENTRIES} entries are the limit); pass only the letters that can occur"
        )


def product_table(a: TransitionTable, b: TransitionTable, both: bool, max_states: int) -> TransitionTable:
    """Table of ``a & b`` if ``both``, else of ``a | b``; its states are the reachable pairs of states.

    All pairs with a known outcome (for ``&``, one state is a trap; for ``|``, one accepts) are one state.
    States are numbered in the order of a breadth-first search. Both tables must be minimal and have the same
    letters. Raises a FormulaError if there are more than ``max_states`` states.
    """
    letters, wide = a.delta.shape[1], len(b.delta)
    if len(a.delta) * wide >= 2**31:
        raise StatesError(max_states)
    decided_a, decided_b = (trap_states(t) if both else t.accepting for t in (a, b))
    da, db = a.delta.astype(np.int64) * wide, b.delta.astype(np.int64)
    # number of each pair, from 1; 0: not reached; the system allocates no memory for unused pages
    number = np.zeros(len(a.delta) * wide, np.int32)
    number[0] = 1
    scratch = np.empty(len(number), np.int32)
    pairs, rows, done, width = np.array([0]), [], 0, max(1, BLOCK_ENTRIES // letters)
    sink = 1 if decided_a[0] or decided_b[0] else 0  # number of the state of all decided pairs; 0: none yet
    while done < len(pairs):
        now = pairs[done : done + width]
        done += len(now)
        after = da[now // wide] + db[now % wide]
        rows.append(number[after])
        if rows[-1].all():
            continue
        fresh = first_occurrences(after[rows[-1] == 0], scratch)
        decided = decided_a[fresh // wide] | decided_b[fresh % wide]
        if sink == 0 and decided.any():  # the first decided pair represents all of them
            first = int(decided.argmax())
            sink = len(pairs) + first + 1
            decided[first] = False
        number[fresh[decided]] = sink
        fresh = fresh[~decided]
        number[fresh] = np.arange(len(pairs), len(pairs) + len(fresh)) + 1
        pairs = np.concatenate([pairs, fresh])
        check_table_size(len(pairs), letters, max_states)
        rows[-1] = number[after]
    delta = np.concatenate(rows)
    delta -= 1
    va, vb = a.accepting[pairs // wide], b.accepting[pairs % wide]
    return TransitionTable(delta, va & vb if both else va | vb)


def first_occurrences(values: Any, scratch: NDArray[np.int32]) -> IntArray:
    """``values`` without repetitions, in the order of their first occurrence, in linear time.

    ``values`` are integers from 0 to ``len(scratch) - 1``.
    """
    places = np.arange(len(values), dtype=np.int32)
    scratch[values[::-1]] = places[::-1]
    first: IntArray = values[scratch[values] == places]
    return first


def letter_kinds(kinds: IntArray) -> tuple[IntArray, IntArray]:
    """The first letter of each kind (K,), and the number of each letter's kind (L,), from ``kinds`` (L,).

    Kinds are numbered in the order of their first letters.
    """
    _, first, which = np.unique(kinds, return_index=True, return_inverse=True)
    order = first.argsort()
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    return first[order], place[which]


def trap_states(table: TransitionTable) -> BoolArray:
    """Whether each state does not accept and is never left, shape (Q,); in a minimal table, at most one."""
    stay: BoolArray = (table.delta == np.arange(len(table.delta))[:, None]).all(axis=1)
    return stay & ~table.accepting


def certain_states(delta: TransitionArray, accepting: BoolArray) -> BoolArray:
    """Whether every infinite word from a state reaches acceptance, shape (Q,) bool.

    Good prefixes are the words that lead to these states: from any other state, some infinite word stays
    among the other states.
    """
    doubtful = np.flatnonzero(~accepting)
    while True:
        certain = np.ones(len(delta), np.bool_)
        certain[doubtful] = False
        left = _states_leading_into(~certain, delta, doubtful)
        if len(left) == len(doubtful):
            return certain
        doubtful = left


def acceptance_distances(delta: TransitionArray, accepting: BoolArray) -> FloatArray:
    """Smallest number of letters to acceptance, d_A, shape (Q,); inf if acceptance cannot be reached."""
    distance = np.where(accepting, 0.0, np.inf)
    steps = 0
    while (distance == steps).any():
        reached = _states_leading_into(distance == steps, delta, np.flatnonzero(np.isinf(distance)))
        steps += 1
        distance[reached] = steps
    return distance


def _states_leading_into(goal: BoolArray, delta: TransitionArray, states: IntArray) -> IntArray:
    """The ``states`` from which some letter leads into ``goal`` (Q,) bool.

    Large letters, which lead there most often, are tested first.
    """
    found = []
    for last in range(delta.shape[1], 0, -SAMPLE_LETTERS):
        leads = goal[delta[states, max(0, last - SAMPLE_LETTERS) : last]].any(axis=1)
        found.append(states[leads])
        states = states[~leads]
        if len(states) == 0:
            break
    return np.concatenate(found)


def minimal_table(table: TransitionTable) -> tuple[TransitionTable, FloatArray]:
    """The minimal table of the good prefixes, and its distances to acceptance (Q,).

    States are numbered in the order of a breadth-first search, so that equal languages over equal letters
    give equal tables.
    """
    delta = table.delta
    accepting = certain_states(delta, table.accepting)
    distance = acceptance_distances(delta, accepting)
    block = refine_partition(delta, np.unique(distance, return_inverse=True)[1])
    member = block_members(block)
    if len(member) < len(block):
        delta = block[delta[member]]
    else:
        block = member = np.arange(len(delta))
    order = breadth_first_order(delta, int(block[0]))
    number = np.empty(len(member), np.int64)
    number[order] = np.arange(len(order))
    if not np.array_equal(order, np.arange(len(delta))):  # products are in this order already
        delta = number[delta[order]]
    member = member[order]
    return TransitionTable(delta, accepting[member]), distance[member]


def block_members(block: IntArray) -> IntArray:
    """One state of each block of a partition (Q,) with numbers 0..B - 1, shape (B,)."""
    member = np.empty(block.max() + 1, np.int64)
    member[block] = np.arange(len(block))
    return member


def refine_partition(delta: TransitionArray, block: IntArray) -> IntArray:
    """The coarsest refinement of the partition ``block`` (Q,) in which letters map blocks into blocks.

    As in Hopcroft's algorithm (1971), the largest part of a split block keeps its number, and only
    predecessors of the other parts are processed again. The signature of a state is a random linear form of
    the blocks of its successors. Different states have equal signatures with a probability of about 2^-50,
    and the result is checked. ``block`` comes from the distances to acceptance, which equivalent states
    share: then 1 to 3 iterations are typical, instead of up to max d_A iterations from acceptance alone.

    Blocks are first split by a sample of the letters, which is enough for most tables with many letters. Then
    all letters are tested, but only for states that still share a block.
    """
    random = np.random.default_rng(len(delta))
    used = np.zeros(delta.shape[1], np.bool_)
    used[:: 1 + len(used) // SAMPLE_LETTERS] = True
    while True:
        sample = delta if used.all() else np.ascontiguousarray(delta[:, used])
        weights = random.integers(1, 2**63, sample.shape[1], np.uint64)
        block = _split_blocks(sample, block.astype(np.uint64), weights).astype(np.int64)
        member = block_members(block)
        others = np.flatnonzero(member[block] != np.arange(len(block)))
        splits = (block[delta[others]] != block[delta[member[block[others]]]]).any(axis=0)
        if not splits.any():
            return block
        used |= splits


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
    while len(levels[-1]) and not met.all():
        after = delta[levels[-1]].ravel()
        fresh = first_occurrences(after[~met[after]], scratch)
        met[fresh] = True
        levels.append(fresh)
    return np.concatenate(levels)


def language_inclusion(delta: TransitionArray, distance: FloatArray) -> BoolArray:
    """Shape (Q, Q) bool: ``[p, q]`` is True if ``p`` accepts every word that ``q`` accepts.

    It is the largest relation with d(p) <= d(q) that every letter preserves: if q accepts a word and p does
    not, some prefix of it leads to a pair with d(q) = 0 < d(p). The rows p are computed in the order of d(p):
    a letter that leads closer to acceptance, to a row that is done, excludes most states q, so few pairs
    remain for the other letters. Rows are computed again until nothing changes, because of cycles.

    Eq. (M31) of docs/mathematics.md.
    """
    columns = np.ascontiguousarray(np.unique(delta, axis=1).T)
    holds = _accept_as_much(columns, distance)
    blocks, changed = list(_rows_by_distance(distance)), False
    for p in blocks:
        nearer = distance[columns[:, p]] < distance[p]
        # the first and the last such letter: with one of them, up to seven times as many pairs remain
        for letter in (nearer.argmax(axis=0), len(nearer) - 1 - nearer[::-1].argmax(axis=0)):
            for k in np.unique(letter).tolist():  # taking whole rows is several times as fast as taking pairs
                rows, after = p[letter == k], columns[k]
                holds[rows] &= holds[after[rows]].take(after, axis=1)
        changed |= _exclude(holds, columns, p)
    while changed:
        changed = sum(_exclude(holds, columns, p) for p in blocks) > 0
    return holds


def _accept_as_much(columns: TransitionArray, distance: FloatArray) -> BoolArray:
    """Pairs (p, q) with d(p) <= d(q) in which ``p`` accepts each letter that ``q`` accepts."""
    holds = distance[:, None] <= distance
    last = np.flatnonzero(distance == 1)  # other states accept no letter
    accepts = (distance[columns[:, last]] == 0).T.astype(np.float32)
    holds[last[:, None], last] &= (1 - accepts) @ accepts.T == 0
    return holds


def _rows_by_distance(distance: FloatArray) -> Iterator[IntArray]:
    """Blocks of states with equal finite distance above 0, the nearest to acceptance first."""
    height = max(1, BLOCK_ENTRIES // len(distance))
    for level in np.unique(distance[(distance > 0) & np.isfinite(distance)]):
        states = np.flatnonzero(distance == level)
        yield from np.array_split(states, -(-len(states) // height))


def _exclude(holds: BoolArray, columns: TransitionArray, rows: IntArray) -> bool:
    """Remove pairs in ``rows`` of ``holds`` that a letter leads to a removed pair; return whether any was."""
    found, q = np.nonzero(holds[rows])
    p = rows[found]
    changed = False
    for after in columns:
        keep = holds[after[p], after[q]]
        if not keep.all():
            holds[p[~keep], q[~keep]] = False
            p, q, changed = p[keep], q[keep], True
    return changed
