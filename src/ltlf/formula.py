"""Formulas: the syntax tree, the parser and text output.

Grammar, weakest binding first, with the precedence of Spot. A chain of ``&`` or ``|`` is one node;
``U R W M``, ``->`` and ``<->`` associate to the right::

    formula  = or [("->" | "<->") formula]
    or       = xor {"|" xor}
    xor      = and {"xor" and}
    and      = binding {"&" binding}
    binding  = unary [("U" | "R" | "W" | "M") binding]
    unary    = ("!" | "X" | "F" | "G") unary | atom
    atom     = "true" | "false" | name | '"' name of any characters '"' | "(" formula ")"

:mod:`ltlf.words` has the other spellings. ``F`` and ``G`` may have a time span that counts from the start,
``F[0,6h] a`` (:mod:`ltlf.spans`). ``G``, ``R`` and ``W`` are part of the
grammar, so that the error can name the operator that is not co-safe.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from functools import lru_cache

from ltlf.advice import PLAIN_ADVICE, Advice
from ltlf.errors import FormulaError
from ltlf.spans import Span, read_span, shown_span
from ltlf.texts import caret_lines, name_fault, quoted_name
from ltlf.words import (
    OPERAND_TEXT,
    SPELLINGS,
    STRONG_NEXT,
    FormulaToken,
    WordError,
    foreign_format,
    formula_tokens,
)

MAX_DEPTH = 200  # nesting levels, below the recursion limit of Python; a sequence of n goals has 2 n

UNARY_OPERATORS = ("!", "X", "F", "G")
BINARY_STRENGTH = {"->": 1, "<->": 1, "|": 2, "xor": 3, "&": 4, "U": 5, "R": 5, "W": 5, "M": 5}
RIGHT_ASSOCIATIVE = ("->", "<->", "U", "R", "W", "M")
_UNARY_STRENGTH = 6  # binding strength of unary operators; atoms bind more strongly
_DISPUTED = ({"|", "xor"}, {"->", "<->"})  # pairs that NuSMV and others read in another order than Spot
_UNTILS = frozenset("URWM")  # of which NuSMV and Spin read chains from the left, Spot from the right


@dataclass(frozen=True, slots=True)
class Formula:
    """A node of the syntax tree; comparison ignores the position in the text.

    Attributes
    ----------
    op : str
        ``true``, ``false``, ``name``, one of ``! X F G``, or one of ``& | -> <-> xor U R W M``.
    args : tuple of Formula
        Operands; two or more for ``&`` and ``|``.
    name : str
        The proposition if ``op`` is ``name``.
    span : (float, float) or None
        For ``F`` and ``G``: begin and end of the time span [s after the start].
    column : int
        Zero-based position of the operator or name in the text.
    word : str
        The operator as written by the user.
    """

    op: str
    args: tuple[Formula, ...] = ()
    name: str = ""
    span: Span | None = None
    column: int = field(default=0, compare=False)
    word: str = field(default="", compare=False)

    def __str__(self) -> str:
        return formula_text(self)

    def normal_form(self) -> Formula:
        """The formula with negations at propositions only."""
        from ltlf.normal_form import positive_normal_form

        return positive_normal_form(self)

    def walk(self) -> Iterator[Formula]:
        """The node and all nodes below it in the order of the text, shared nodes once."""
        stack, seen = [self], set()
        while stack:
            node = stack.pop()
            if id(node) not in seen:
                seen.add(id(node))
                yield node
                stack.extend(reversed(node.args))

    @property
    def atoms(self) -> tuple[str, ...]:
        """The propositions, sorted."""
        return tuple(sorted({node.name for node in self.walk() if node.op == "name"}))


TRUE_FORMULA, FALSE_FORMULA = Formula("true"), Formula("false")


def parse_formula(text: str, advice: Advice = PLAIN_ADVICE) -> Formula:
    """The syntax tree of ``text``; :class:`FormulaError`, with the column, for a syntax error."""
    return _parsed(text, advice)[0]


@lru_cache(maxsize=256)
def _parsed(text: str, advice: Advice) -> tuple[Formula, bool]:
    """The syntax tree of ``text``, and whether other tools read it in another order."""
    parser = FormulaParser(text, advice)
    return parser.formula(), bool(parser.disputed)


def disputed_reading(text: str, advice: Advice = PLAIN_ADVICE) -> str:
    """How ``text`` is read, with parentheses, if other tools read it in another order; else empty."""
    tree, disputed = _parsed(text, advice)
    if not disputed:
        return ""
    return (
        f"the formula is read as '{tree}', as in Spot; other tools read it in another order: write the "
        "parentheses"
    )


def _is_disputed(inner: str, outer: str) -> bool:
    """Whether tools disagree on an operand with the operator ``inner`` of ``outer``."""
    return {inner, outer} in _DISPUTED or {inner, outer} <= _UNTILS


def _formula_error(message: str, text: str, column: int) -> FormulaError:
    error = FormulaError(f"{message} (column {column + 1})", column)
    error.add_note(caret_lines(text, column))
    return error


# Reading


class FormulaParser:
    """Precedence climbing parser of one text."""

    def __init__(self, text: str, advice: Advice) -> None:
        self.text, self.advice = text, advice
        self.disputed = False  # whether other tools read the text in another order
        self.closed: set[int] = set()  # identities of nodes in parentheses, which the tree keeps alive
        self.depth = self.parentheses = 0
        try:
            self.tokens = list(formula_tokens(text))
        except WordError as error:
            raise _formula_error(f"{error}{foreign_format(text, advice)}", text, error.column) from None

    def formula(self) -> Formula:
        """The whole formula."""
        if self.here.op == "end":
            raise FormulaError("the formula is empty: expected something like F(a & F b)", 0)
        tree = self.binary(1)
        if self.here.op != "end":
            raise self.error("expected an operator or the end of the formula")
        return tree

    @property
    def here(self) -> FormulaToken:
        """The next token."""
        return self.tokens[0]

    def take(self) -> FormulaToken:
        """The next token, which is read."""
        return self.tokens.pop(0)

    def error(self, expected: str) -> FormulaError:
        """The error that something else was expected at the next token."""
        here = self.here
        hint = foreign_format(self.text, self.advice) or self.hint()
        return _formula_error(f"{expected}, found {here}{hint}", self.text, here.column)

    def hint(self) -> str:
        """Advice for ``EFKU CTR``, and for ``FF a``, which is read as a proposition ``FF`` and ``a``."""
        before = self.text[: self.here.column].rstrip()
        if self.here.op == "name" and re.search(r"\w$", before) and not re.search(r"\b[XFG]{2,}$", before):
            return '; a name with spaces stands in double quotes, as in F "two words"'
        glued = re.search(r"\b[XFG]{2,}$", before)
        return f"; to apply operators one after the other write '{' '.join(glued[0])}'" if glued else ""

    def binary(self, strength: int) -> Formula:
        """A formula of binary operators of at least ``strength``."""
        left = self.unary()
        while BINARY_STRENGTH.get(self.here.op, 0) >= strength:
            token = self.take()
            self.deeper(token)
            own = BINARY_STRENGTH[token.op]
            right = self.binary(own if token.op in RIGHT_ASSOCIATIVE else own + 1)
            args = [left, right]
            while token.op in "&|" and self.here.op == token.op:  # a chain is one node
                self.take()
                args.append(self.binary(own + 1))
            left = Formula(token.op, tuple(args), column=token.column, word=token.word)
            self.disputed |= any(_is_disputed(arg.op, left.op) and id(arg) not in self.closed for arg in args)
            self.depth -= 1
        return left

    def unary(self) -> Formula:
        """A formula without binary operators outside of parentheses."""
        token = self.here
        if token.op in UNARY_OPERATORS:
            self.take()
            self.deeper(token)
            span = self.span() if token.op in "FG" else None
            if token.op == "X" and self.here.word == STRONG_NEXT:
                self.take()
            node = Formula(token.op, (self.unary(),), span=span, column=token.column, word=token.word)
            self.depth -= 1
            return node
        if token.op == "(":
            self.take()
            self.parentheses += 1
            self.bounded(self.parentheses, token)
            node = self.binary(1)
            self.closed.add(id(node))
            self.parentheses -= 1
            if self.here.op != ")":
                raise self.error(f"expected an operator or ')' to close the '(' of column {token.column + 1}")
            self.take()
            return node
        if token.op not in ("name", "true", "false"):
            raise self.error(f"expected {OPERAND_TEXT}")
        self.take()
        name = token.word.strip('"') if token.op == "name" else ""
        if token.op == "name" and (fault := name_fault(name)):
            raise _formula_error(f"the name {token} cannot be used: {fault}", self.text, token.column)
        return Formula(token.op, (), name, column=token.column, word=token.word)

    def span(self) -> Span | None:
        """The time span after ``F`` or ``G``; None if there is none."""
        if not self.here.word.startswith("[") or self.here.op == "G":
            return None
        times = read_span(self.here.word)
        if times is None:
            raise self.error("expected a time span such as [0,6h] or [90min,2h], units s, min, h or d")
        self.take()
        return times

    def deeper(self, token: FormulaToken) -> None:
        """Enter an operand of ``token``."""
        self.depth += 1
        self.bounded(self.depth, token)

    def bounded(self, depth: int, token: FormulaToken) -> None:
        """Refuse a ``depth`` that is too large, at ``token``."""
        if depth > MAX_DEPTH:
            raise _formula_error(
                f"nested deeper than {MAX_DEPTH} levels: simplify it", self.text, token.column
            )


# Writing


def written_name(name: str) -> str:
    """``name`` as a formula has it: in double quotes if it is an operator's or not one word."""
    return quoted_name(name, SPELLINGS)


def _binding_strength(node: Formula) -> int:
    return BINARY_STRENGTH.get(
        node.op, _UNARY_STRENGTH if node.op in UNARY_OPERATORS else _UNARY_STRENGTH + 1
    )


def formula_text(node: Formula, word: str = "") -> str:
    """Text of the syntax tree ``node`` with few parentheses; ``word``, if given, replaces its operator."""
    if not node.args:
        return written_name(node.name) if node.name else node.op
    own, op = _binding_strength(node), word or node.op
    if node.op in UNARY_OPERATORS:
        (arg,) = node.args
        inner = formula_text(arg)
        if node.span is not None:
            op += shown_span(node.span)
        if _binding_strength(arg) < own:
            return f"{op}({inner})"
        return f"{op} {inner}" if op[0].isalpha() else f"{op}{inner}"
    # index of the operand that may have the same binding strength; a chain of & or | has none
    loose = -1 if node.op in "&|" else len(node.args) - 1 if node.op in RIGHT_ASSOCIATIVE else 0
    parts = []
    for i, arg in enumerate(node.args):
        text = formula_text(arg)
        bare = _binding_strength(arg) > own or (i == loose and _binding_strength(arg) == own)
        if (op in "&|" and _binding_strength(arg) == BINARY_STRENGTH["U"]) or _is_disputed(arg.op, node.op):
            bare = False  # optional parentheses in (a U b) & c, for readability
        parts.append(text if bare else f"({text})")
    return f" {op} ".join(parts)


def flat_chain(op: str, args: Iterable[Formula]) -> Formula:
    """One or more ``args`` joined by ``op`` (``&`` or ``|``); arguments with the same operator are merged."""
    flat = tuple(part for arg in args for part in (arg.args if arg.op == op else (arg,)))
    return flat[0] if len(flat) == 1 else Formula(op, flat)


def elided_text(text: str, width: int = 40) -> str:
    """``text`` in at most ``width`` characters, the last three of them dots if it is longer."""
    return text if len(text) <= width else f"{text[: width - 3]}..."
