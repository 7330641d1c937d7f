"""Labels of edges in HOA files, Boolean expressions, as sets of letters."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import NoReturn

import numpy as np

from careful_io.reading import SHOWN
from pareto_ltl.support.arrays import BoolArray, IntArray

MAX_LABEL_DEPTH = 200  # levels of brackets and negations in a label
MAX_LABEL_WORK = 2**32  # operands and operators of all labels times letters, which takes a few seconds
MAX_STORED = 2**26  # results of labels and aliases, one byte per letter
LABEL_TOKEN = re.compile(r"[()!&|]|[^\s()!&|]+")


class LabelReader:
    """Label expressions as sets of letters, whose bit sets are ``codes`` (L,).

    An alias is evaluated once, as with aliases of aliases 30 lines can expand to 2^30 operands, and so is a
    label that several edges have.
    """

    def __init__(self, codes: IntArray, atoms: int, refuse: Callable[[str, int], NoReturn]) -> None:
        self.letters, self.refuse = len(codes), refuse
        self.known: dict[str, BoolArray] = {}  # by the text of the label
        self.operands = {"t": np.ones(len(codes), bool), "f": np.zeros(len(codes), bool)}
        self.operands |= {str(i): (codes >> i & 1) == 1 for i in range(atoms)}
        self.tokens: list[str] = []  # of the label that is read, the next one last
        self.line = self.depth = self.work = 0

    def define(self, name: str, text: str, line: int) -> None:
        """Let the alias ``name`` stand for the label ``text``."""
        if len(self.operands) * self.letters > MAX_STORED:
            self.refuse(f"too many aliases for {self.letters} letters", line)
        self.operands[name] = self.evaluated(text, line)

    def letters_of(self, text: str, line: int) -> BoolArray:
        """Which letters satisfy the label ``text`` of a ``line``, (L,)."""
        self._count(1, line)
        if text not in self.known:
            if len(self.known) * self.letters > MAX_STORED:
                self.known.clear()
            self.known[text] = self.evaluated(text, line)
        return self.known[text]

    def _count(self, operations: int, line: int) -> None:
        self.work += operations
        if self.work * self.letters > MAX_LABEL_WORK:
            self.refuse(
                f"labels with {self.work} operators are too long for {self.letters} letters; write them with "
                "aliases, or name fewer letters",
                line,
            )

    def evaluated(self, text: str, line: int) -> BoolArray:
        """:meth:`letters_of` without its memory of results."""
        self.tokens, self.line, self.depth = LABEL_TOKEN.findall(text)[::-1], line, 0
        self._count(len(self.tokens), line)
        letters = self._either()
        if self.tokens:
            self.refuse(f"expected ']', found {self.tokens[-1][:SHOWN]}", line)
        return letters

    def _either(self) -> BoolArray:
        letters = self._both()
        while self._sign("|"):
            letters = letters | self._both()
        return letters

    def _both(self) -> BoolArray:
        letters = self._operand()
        while self._sign("&"):
            letters = letters & self._operand()
        return letters

    def _operand(self) -> BoolArray:
        token = self.tokens.pop() if self.tokens else "the end"
        if token not in ("!", "("):
            if token not in self.operands:
                self.refuse(
                    f"{token[:SHOWN]} is not a label; expected t, f, a proposition's number or an alias",
                    self.line,
                )
            return self.operands[token]
        self.depth += 1
        if self.depth > MAX_LABEL_DEPTH:
            self.refuse(f"a label nested deeper than {MAX_LABEL_DEPTH} levels", self.line)
        letters = ~self._operand() if token == "!" else self._either()
        if token == "(" and not self._sign(")"):
            found = self.tokens[-1][:SHOWN] if self.tokens else "the end"
            self.refuse(f"expected ')', found {found}", self.line)
        self.depth -= 1
        return letters

    def _sign(self, text: str) -> bool:
        """Consume the sign ``text`` if it is the next token; return whether it was."""
        found = bool(self.tokens) and self.tokens[-1] == text
        if found:
            self.tokens.pop()
        return found
