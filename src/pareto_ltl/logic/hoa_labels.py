"""Label expressions of HOA files, which aliases share."""

from __future__ import annotations

from typing import Any

import numpy as np

from pareto_ltl.support.arrays import BoolArray, IntArray


class LabelExpression:
    """``t``, ``f``, ``ap`` with its place, ``!`` with one operand, ``&`` or ``|`` with several.

    An alias is worked out once for a file: aliases of aliases let 30 lines stand for 2^30 operands.

    Attributes
    ----------
    depth : int
        Levels of operators.
    alias : bool
        Whether the file has a name for the expression.
    """

    def __init__(self, op: str, args: tuple[LabelExpression, ...] = (), place: int = 0) -> None:
        self.op, self.args, self.place = op, args, place
        self.depth: int = 1 + max((arg.depth for arg in args), default=0)
        self.alias = False

    def on(self, codes: IntArray, known: dict[int, BoolArray]) -> BoolArray:
        """Which letters in ``codes`` (L,) satisfy the expression, shape (L,) bool.

        ``known`` holds what aliases came to, by their ``id``, for the same ``codes``.
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
        if self.op == "!":
            return ~self.args[0].on(codes, known)
        join: Any = np.logical_and if self.op == "&" else np.logical_or
        joined = self.args[0].on(codes, known).copy()
        for arg in self.args[1:]:
            join(joined, arg.on(codes, known), out=joined)
        return joined


__all__ = ["LabelExpression"]
