"""Label expressions of HOA files."""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from pareto_ltl.support.arrays import BoolArray, IntArray

MAX_KEPT = 2**26  # stored results of repeated labels, one byte per letter
SHORT = 4  # largest number of digits of a proposition's number
LITERAL = rf"\s*!?\s*\d{{1,{SHORT}}}\s*"
CUBES = re.compile(rf"{LITERAL}(?:[&|]{LITERAL})*", re.ASCII)


class LabelExpression:
    """The label of an edge: an operator with its operands.

    Operators are ``t``, ``f``, ``ap`` with the number of the proposition in ``place``, ``!`` with one
    operand, ``&`` or ``|`` with several, and ``cube``, the conjunction of the propositions in the bit set
    ``place`` and of the negated ones in ``absent``.

    An alias is evaluated once per file, as with aliases of aliases 30 lines can expand to 2^30 operands.

    Attributes
    ----------
    depth : int
        Number of levels of operators.
    alias : bool
        Whether the file has a name for the expression.
    repeated : bool
        Whether several edges have it as their label.
    """

    __slots__ = ("absent", "alias", "args", "depth", "op", "place", "repeated")

    def __init__(
        self, op: str, args: tuple[LabelExpression, ...] = (), place: int = 0, absent: int = 0
    ) -> None:
        self.op, self.args, self.place, self.absent = op, args, place, absent
        self.depth: int = 1 + max((arg.depth for arg in args), default=0)
        self.alias = self.repeated = False

    def on(self, codes: IntArray, known: dict[int, BoolArray]) -> BoolArray:
        """Which letters in ``codes`` (L,) satisfy the expression, shape (L,) bool.

        ``known`` holds the results of aliases for the same ``codes``, by the ``id`` of the expression.
        """
        if not self.alias:
            return self._worked_out(codes, known)
        if id(self) not in known:
            known[id(self)] = self._worked_out(codes, known)
        return known[id(self)]

    def _worked_out(self, codes: IntArray, known: dict[int, BoolArray]) -> BoolArray:
        if self.op in "tf":
            return np.full(len(codes), self.op == "t")
        if self.op == "ap":
            holds: BoolArray = (codes & (1 << self.place)) != 0
            return holds
        if self.op == "cube":
            fits: BoolArray = codes & (self.place | self.absent) == self.place
            return fits
        if self.op == "!":
            return ~self.args[0].on(codes, known)
        join: Any = np.logical_and if self.op == "&" else np.logical_or
        joined = self.args[0].on(codes, known).copy()
        for arg in self.args[1:]:
            join(joined, arg.on(codes, known), out=joined)
        return joined


def letters_of(
    label: LabelExpression, codes: IntArray, known: dict[int, BoolArray], repeated: dict[int, BoolArray]
) -> BoolArray:
    """Like :meth:`LabelExpression.on`; ``repeated`` holds the results of labels that several edges have."""
    if not label.repeated:
        return label.on(codes, known)
    if id(label) not in repeated:
        if len(repeated) * len(codes) > MAX_KEPT:
            repeated.clear()
        repeated[id(label)] = label.on(codes, known)
    return repeated[id(label)]


def sum_of_cubes(text: str, atoms: int, cubes: dict[str, LabelExpression]) -> LabelExpression | None:
    """The label ``text`` if it consists only of literals joined by ``&`` and ``|``, else None.

    ``atoms`` is the number of propositions; ``cubes`` holds the cubes found so far, by their text. Most
    labels of large files have this form and share their cubes.
    """
    if CUBES.fullmatch(text) is None:
        return None
    parts = []
    for cube in text.split("|"):
        if cube not in cubes:
            bits = [0, 0]  # of the propositions, and of the negated ones
            for literal in cube.split("&"):
                place = int(literal.replace("!", ""))
                if place >= atoms:
                    return None
                bits["!" in literal] |= 1 << place
            holds, absent = bits
            cubes[cube] = LabelExpression("f" if holds & absent else "cube", (), holds, absent)
        parts.append(cubes[cube])
    return parts[0] if len(parts) == 1 else LabelExpression("|", tuple(parts))
