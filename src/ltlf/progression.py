"""Formula progression: the obligations that remain after each letter, explored into a transition table.

A positive normal form is a graph of shared nodes with literals, ``&``, ``|``, ``X`` and ``U``::

    F p = true U p,    p M q = q U (p & q)

A state is a disjunction of conjunctions of such nodes, stored as an antichain of bit sets, so the number of
states is finite. Progression by a letter (Bacchus and Kabanza, 1998, doi:10.1023/A:1018985923441)::

    step(p U q) = step(q) | (step(p) & p U q),    step(X p) = p,    step(literal) = true or false

Two simplifications keep the number of states close to the minimum. Parts that another part implies are
dropped: after ``a`` in ``F(a & F b)``, ``F b`` implies ``F(a & F b)``. And letters are distinguished only by
the propositions that a state reads at the next step.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ltlf import dfa as tables
from ltlf.dfa import FloatArray, IntArray, TransitionTable
from ltlf.errors import StatesError
from ltlf.formula import Formula

ProgressionState = tuple[int, ...]  # clauses; a clause is a set of obligations, one bit for each
OBLIGATION_KINDS = ("X", "U", "+", "-")  # operators of the nodes in clauses
DONE_STATE: ProgressionState = (0,)
LOST_STATE: ProgressionState = ()


class ProgressionNode:
    """A shared node of the normal form; equal formulas are the same object."""

    __slots__ = ("args", "bit", "eventual", "names", "now", "op", "temporal")

    def __init__(self, op: str, args: tuple[ProgressionNode, ...], now: int, bit: int) -> None:
        self.temporal: bool
        self.names: int = now  # bits of all its propositions
        for arg in args:
            self.names |= arg.names
        self.op = op  # true, false, +, - (literals), &, |, X, U
        self.args = args
        self.now = now  # bits of the propositions that the next step reads
        self.bit = bit  # its bit in clauses
        self.temporal = op in "XU" or any(arg.temporal for arg in args)
        # Eventual: stays true if letters are inserted in front, so that F p = p and q U p = p.
        self.eventual = op in ("true", "false") or (op == "U" and args[0].op == "true")
        if op in "&|X":
            self.eventual = all(arg.eventual for arg in args)


class PartTable(NamedTuple):
    """The minimal table of a part of a formula, with one column for all letters that it does not distinguish.

    ``distance`` (Q,): distance of each state to acceptance; ``column`` (L,): the column of each letter of the
    whole formula. Columns are in the order of their first letters, so that the breadth-first order of states
    is the same in this table and in the one with all letters.
    """

    table: TransitionTable
    distance: FloatArray
    column: IntArray

    def with_columns(self, letters: IntArray) -> TransitionTable:
        """The table with a column for each of ``letters`` (numbers of letters of the whole formula)."""
        return self.table._replace(delta=self.table.delta[:, self.column[letters]])

    def whole(self) -> TransitionTable:
        """The table with a column for each letter of the whole formula."""
        letters = len(self.column)
        return self.table if self.table.delta.shape[1] == letters else self.with_columns(np.arange(letters))


class Progression:
    """All nodes of one translation and their progression.

    Eq. (M30) of docs/mathematics.md.
    """

    def __init__(self, atoms: tuple[str, ...], max_states: int) -> None:
        self.place = {name: 1 << i for i, name in enumerate(atoms)}
        self.max_states = max_states
        self.nodes: list[ProgressionNode] = []
        self.shared: dict[tuple[object, ...], ProgressionNode] = {}
        self.implies = cache(self.shows)
        self.consequences = cache(self.obligations_of_node)
        self.closure = cache(self.obligations_of_clause)
        self.after_letter = cache(self.read_letter)
        self.known: dict[int, tuple[Formula, ProgressionNode]] = {}  # by the identity of the formula
        self.true = self.make("true", ())
        self.false = self.make("false", ())

    # Nodes

    def make(self, op: str, args: tuple[ProgressionNode, ...], atom: int = 0) -> ProgressionNode:
        """The shared node of ``op`` and ``args``."""
        key = (op, atom, *[arg.bit for arg in args])
        if key not in self.shared:
            now = atom
            if op != "X":
                for arg in args:
                    now |= arg.now
            node = self.shared[key] = ProgressionNode(op, args, now, 1 << len(self.nodes))
            self.nodes.append(node)
        return self.shared[key]

    def read(self, tree: Formula) -> ProgressionNode:
        """The simplified shared node of a positive normal form."""
        if id(tree) not in self.known:
            self.known[id(tree)] = tree, self.build(tree)
        return self.known[id(tree)][1]

    def build(self, tree: Formula) -> ProgressionNode:
        """:meth:`read` without its memory of results."""
        if tree.op == "true":
            return self.true
        if tree.op == "false":
            return self.false
        if tree.op == "name":
            return self.make("+", (), self.place[tree.name])
        if tree.op == "!":
            return self.make("-", (), self.place[tree.args[0].name])
        args = []
        for arg in tree.args:
            args.append(self.read(arg))  # noqa: PERF401 - on 3.11 a comprehension recurses twice
        if tree.op in "&|":
            return self.combine(tree.op, args)
        if tree.op == "X":
            return self.next(args[0])
        if tree.op == "F":
            return self.until(self.true, args[0])
        if tree.op == "M":
            return self.until(args[1], self.combine("&", args))
        return self.until(*args)

    def next(self, p: ProgressionNode) -> ProgressionNode:
        """``X p``."""
        return p if p.op in ("true", "false") else self.make("X", (p,))

    def until(self, p: ProgressionNode, q: ProgressionNode) -> ProgressionNode:
        """``p U q``, or ``q`` if both are known to be equivalent."""
        if q.eventual or p.op == "false" or self.implies(p, q):
            return q
        if q.op == "U" and q.args[0] is p:  # p U (p U q)
            return q
        return self.make("U", (p, q))

    def combine(self, op: str, args: Iterable[ProgressionNode]) -> ProgressionNode:
        """``&`` or ``|`` of ``args``, flat, without repeated or redundant parts."""
        unit, zero = (self.true, self.false) if op == "&" else (self.false, self.true)
        flat: dict[int, ProgressionNode] = {}
        for arg in args:
            for part in arg.args if arg.op == op else (arg,):
                flat[part.bit] = part
        flat.pop(unit.bit, None)
        parts = self.merge(op, list(flat.values()))
        if zero in parts or self.clash(parts):
            return zero
        parts = self.needed(op, parts)
        if len(parts) < 2:
            return parts[0] if parts else unit
        return self.make(op, tuple(sorted(parts, key=lambda part: part.bit)))

    def merge(self, op: str, parts: list[ProgressionNode]) -> list[ProgressionNode]:
        """``X p & X q = X (p & q)``, the same for ``|``, and ``p U q | p U r = p U (q | r)``."""
        groups: dict[tuple[str, int], list[ProgressionNode]] = {}
        for part in parts:
            key = ("X", 0) if part.op == "X" else ("", part.bit)
            if part.op == "U" and op == "|":
                key = "U", part.args[0].bit
            groups.setdefault(key, []).append(part)
        merged = []
        for group in groups.values():
            node = group[0]
            if len(group) > 1:
                inner = self.combine(op, [part.args[-1] for part in group])
                node = self.next(inner) if node.op == "X" else self.until(node.args[0], inner)
            merged.append(node)
        return merged  # until() may return a chain again, which costs states but is correct

    def clash(self, parts: list[ProgressionNode]) -> bool:
        """Whether ``parts`` contain a proposition and its negation."""
        plus, minus = ({part.now for part in parts if part.op == sign} for sign in "+-")
        return bool(plus & minus)

    def needed(self, op: str, parts: list[ProgressionNode]) -> list[ProgressionNode]:
        """For ``&`` the ``parts`` that no other part implies, for ``|`` those that imply no other part."""
        for part in list(parts):
            if part in parts:
                pairs = [(other, (part, other) if op == "&" else (other, part)) for other in parts]
                parts = [other for other, pair in pairs if other is part or not self.implies(*pair)]
        return parts

    def shows(self, p: ProgressionNode, q: ProgressionNode) -> bool:  # noqa: PLR0911, PLR0912 - case by case
        """Whether the syntax of ``p`` and ``q`` shows that ``p`` implies ``q``; sound, not complete.

        ``implies`` is the same with a memory of results.
        """
        if p is q or p.op == "false" or q.op == "true":
            return True
        if p.op == "true" or q.op == "false":
            return False
        if p.op == "|":
            return self.each(p.args, q)
        if q.op == "&":
            for part in q.args:  # noqa: SIM110 - all() doubles the depth of the recursion
                if not self.implies(p, part):
                    return False
            return True
        if p.op == "&":
            for part in p.args:
                if self.implies(part, q):
                    return True
        if q.op == "|":
            for part in q.args:
                if self.implies(p, part):
                    return True
        if p.op in "XU" and q.eventual and self.implies(p.args[-1], q):
            return True
        if p.op == "X" and q.op == "X":
            return self.implies(p.args[0], q.args[0])
        if q.op == "U" and self.implies(p, q.args[1]):
            return True
        if p.op != "U":
            return False
        if q.op == "U" and self.implies(p.args[1], q) and self.implies(p.args[0], q.args[0]):
            return True
        return self.each(p.args, q)

    def each(self, parts: tuple[ProgressionNode, ...], q: ProgressionNode) -> bool:
        """Whether each of ``parts`` implies ``q``."""
        for part in parts:  # noqa: SIM110
            if not self.implies(part, q):
                return False
        return True

    # States

    def start(self, node: ProgressionNode) -> ProgressionState:
        """The state in which ``node`` must hold from the next letter on."""
        if node.op == "true":
            return DONE_STATE
        if node.op == "false":
            return LOST_STATE
        if node.op not in "&|":
            return (node.bit,)
        parts = [self.start(arg) for arg in node.args]
        return self.all(parts) if node.op == "&" else self.any(parts)

    def step(self, node: ProgressionNode, letter: int) -> ProgressionState:
        """The obligations of ``node`` after ``letter``, a bit set of propositions."""
        return self.after_letter(node.bit, letter & node.now)

    def read_letter(self, bit: int, letter: int) -> ProgressionState:
        """:meth:`step` of the node of ``bit``, without its memory of results."""
        node = self.nodes[bit.bit_length() - 1]
        op, args = node.op, node.args
        if op in ("true", "false"):
            return self.start(node)
        if op == "+":
            return DONE_STATE if letter & node.now else LOST_STATE
        if op == "-":
            return LOST_STATE if letter & node.now else DONE_STATE
        if op == "X":
            return self.start(args[0])
        if op == "U":
            here = self.step(args[1], letter)
            if here == DONE_STATE:
                return here
            return self.any([here, self.all([self.step(args[0], letter), (node.bit,)])])
        parts = []
        for arg in args:
            part = self.step(arg, letter)
            if part == (LOST_STATE if op == "&" else DONE_STATE):
                return part
            parts.append(part)
        return self.all(parts) if op == "&" else self.any(parts)

    def all(self, parts: Iterable[ProgressionState]) -> ProgressionState:
        """Conjunction: all unions of one clause from each part."""
        result = DONE_STATE
        for part in parts:
            if part == DONE_STATE:
                continue
            result = part if result == DONE_STATE else self.any([[a | b for a in result for b in part]])
            if not result:
                return LOST_STATE
        return result

    def any(self, parts: Iterable[Iterable[int]]) -> ProgressionState:
        """Disjunction: all clauses except those that imply another one."""
        clauses = {self.core(clause) for part in parts for clause in part}
        if len(clauses) < 2:
            return tuple(clauses)
        if 0 in clauses:
            return DONE_STATE
        if len(clauses) > self.max_states:
            raise StatesError(self.max_states)
        remaining = sorted(clauses)
        for clause in remaining[:]:
            if clause in remaining:
                remaining = [other for other in remaining if other == clause or clause & ~self.closure(other)]
        return tuple(remaining)

    def core(self, clause: int) -> int:
        """``clause`` without obligations that its other obligations imply."""
        for bit in set_bits(clause):
            if clause & bit and clause != bit:
                clause &= ~self.consequences(bit) | bit
        return clause

    def obligations_of_clause(self, clause: int) -> int:
        """All obligations that ``clause`` implies; ``closure`` is the same with a memory of results."""
        result = 0
        for bit in set_bits(clause):
            result |= self.consequences(bit)
        return result

    def obligations_of_node(self, bit: int) -> int:
        """The obligations that the node of ``bit`` implies, itself included; ``consequences`` stores them."""
        node, implied = self.nodes[bit.bit_length() - 1], 0
        for other in self.nodes:
            if other.op in OBLIGATION_KINDS and self.implies(node, other):
                implied |= other.bit
        return implied

    # Tables

    def table(self, node: ProgressionNode, letters: IntArray) -> tuple[TransitionTable, FloatArray]:
        """The minimal transition table of ``node`` over ``letters``, and its distances to acceptance."""
        part = self.part(node, letters)
        return part.whole(), part.distance

    def part(self, node: ProgressionNode, letters: IntArray) -> PartTable:
        """The minimal table of ``node``: products for ``&`` and ``|``, progression below them."""
        if node.op in ("&", "|"):
            parts = [part for part in node.args if part.temporal]
            if len(parts) > 1:
                plain = [part for part in node.args if not part.temporal]
                parts += [self.combine(node.op, plain)] if plain else []
                return self.fold([self.part(part, letters) for part in parts], node.op == "&")
        first, column = tables.letter_kinds(letters & node.names)
        return PartTable(*tables.minimal_table(self.explore(node, letters[first])), column)

    def fold(self, parts: list[PartTable], both: bool) -> PartTable:
        """The product of ``parts`` as a balanced tree of products, each of which is minimised."""
        while len(parts) > 1:
            products = [self.product(a, b, both) for a, b in zip(parts[::2], parts[1::2], strict=False)]
            parts = products + parts[2 * len(products) :]
        return parts[0]

    def product(self, a: PartTable, b: PartTable, both: bool) -> PartTable:
        """The minimal product of two parts: of ``&`` if ``both``, else of ``|``."""
        first, column = tables.letter_kinds(a.column * b.table.delta.shape[1] + b.column)
        table = tables.product_table(a.with_columns(first), b.with_columns(first), both, self.max_states)
        return PartTable(*tables.minimal_table(table), column)

    def explore(self, node: ProgressionNode, letters: IntArray) -> TransitionTable:
        """Breadth-first exploration of all letters from all reachable states."""
        states: dict[ProgressionState, int] = {self.start(node): 0}
        groups: dict[int, tuple[list[int], IntArray]] = {}
        rows: list[NDArray[np.int32]] = []
        queue = list(states)
        for state in queue:  # grows during the loop
            now = self.reads(state)
            if now not in groups:
                kinds, which = np.unique(letters & now, return_inverse=True)
                groups[now] = kinds.tolist(), which
            kinds, which = groups[now]
            row = []
            for kind in kinds:
                after = self.after(state, kind)
                if after not in states:
                    states[after] = len(states)
                    queue.append(after)
                row.append(states[after])
            rows.append(np.array(row, dtype=np.int32)[which])
            tables.check_table_size(len(states), len(letters), self.max_states)
        accepting = np.array([state == DONE_STATE for state in queue])
        return TransitionTable(np.array(rows), accepting)

    def reads(self, state: ProgressionState) -> int:
        """Bits of the propositions that the next step from ``state`` reads."""
        now = 0
        for clause in state:
            for bit in set_bits(clause):
                now |= self.nodes[bit.bit_length() - 1].now
        return now

    def after(self, state: ProgressionState, letter: int) -> ProgressionState:
        """The state after ``letter``: the disjunction of its advanced clauses."""
        return (
            state if state in (DONE_STATE, LOST_STATE) else self.any([self.advance(c, letter) for c in state])
        )

    def advance(self, clause: int, letter: int) -> ProgressionState:
        """The state of a clause after ``letter``: the conjunction of its obligations after ``letter``."""
        parts = []
        for bit in set_bits(clause):
            part = self.step(self.nodes[bit.bit_length() - 1], letter)
            if not part:
                return LOST_STATE
            parts.append(part)
        return self.all(parts)


def set_bits(clause: int) -> Iterator[int]:
    """The bits of ``clause`` that are set, the lowest first."""
    while clause:
        bit = clause & -clause
        clause ^= bit
        yield bit
