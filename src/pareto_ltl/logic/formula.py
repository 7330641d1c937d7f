"""Mission formulas: text to syntax tree and back, and the positive normal form that decides co-safety.

Grammar, loosest first; ``&`` and ``|`` chains are one node, ``U R W M`` and ``->`` associate to the right::

    formula  = implies {("<->" | "xor") implies}
    implies  = or ["->" implies]
    or       = and {("|" | "||" | "or") and}
    and      = binding {("&" | "&&" | "and") binding}
    binding  = unary [("U" | "until" | "R" | "W" | "M") binding]
    unary    = ("!" | "~" | "not" | "X" | "next" | "F" | "eventually" | "<>" | "G" | "[]") unary | atom
    atom     = "true" | "false" | name | "(" formula ")"

``G``, ``R`` and ``W`` are read, so that a formula can be refused with a reason instead of a syntax error.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from functools import lru_cache

from pareto_ltl.support.errors import FormulaError

MAX_DEPTH = 200  # nesting; a sequence of n goals has 2 n levels. Keeps recursion clear of Python's limit.

UNARY = ("!", "X", "F", "G")
BINARY = {"<->": 1, "xor": 1, "->": 2, "|": 3, "&": 4, "U": 5, "R": 5, "W": 5, "M": 5}  # by binding strength
RIGHT = ("->", "U", "R", "W", "M")
FOREVER = ("G", "R", "W")
_TIGHT = 6  # binding strength of unary operators; atoms bind tighter still

_SPELLINGS = {
    **{"~": "!", "not": "!", "next": "X", "eventually": "F", "<>": "F", "[]": "G", "until": "U"},
    **{"&&": "&", "and": "&", "||": "|", "or": "|"},
    **{op: op for op in (*UNARY, *BINARY, "(", ")", "true", "false")},
}
_TOKEN = re.compile(r"<->|->|<>|\[\]|&&|\|\||[!~&|()]|\w+")
_FOREIGN = {"/\\": "&", "\\/": "|", "=>": "->", "==": "<->", "^": "xor", "¬": "!", "∧": "&", "∨": "|"}
_OPERAND = "a proposition, 'true', 'false', '(' or one of ! X F"


@dataclass(frozen=True, slots=True)
class Formula:
    """A node of the syntax tree; equal trees are equal wherever their text stood.

    Attributes
    ----------
    op : str
        ``true``, ``false``, ``name``, one of ``! X F G``, or one of ``& | -> <-> xor U R W M``.
    args : tuple of Formula
        Operands; two or more for ``&`` and ``|``.
    name : str
        The proposition, where ``op`` is ``name``.
    column : int
        Zero-based position of the operator or name in the text it was read from.
    word : str
        The operator as the user wrote it.
    """

    op: str
    args: tuple[Formula, ...] = ()
    name: str = ""
    column: int = field(default=0, compare=False)
    word: str = field(default="", compare=False)

    def __str__(self) -> str:
        return _show(self)

    def walk(self) -> Iterator[Formula]:
        """This node and all below it, shared nodes once, in the order of the text."""
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


TRUE, FALSE = Formula("true"), Formula("false")


@lru_cache(maxsize=256)
def parse(text: str) -> Formula:
    """Read a formula, each text once a process; a :class:`FormulaError` points at the column of the fault."""
    return _Parser(text).formula()


def caret(text: str, column: int) -> str:
    """Two lines: the formula, and a caret under ``column``."""
    line = re.sub(r"\s", " ", text)
    return f"{line}\n{' ' * column}^"


def positive(tree: Formula) -> Formula:
    """The positive normal form: negation on propositions only, operators ``& | X F U M``.

    ``!X p = X !p``, ``!(p R q) = !p U !q``, ``!(p W q) = !p M !q``, ``!G p = F !p``. A formula with these
    operators only is syntactically co-safe: every word that satisfies it does so after a finite prefix
    (Kupferman and Vardi, 2001). What would need ``G``, ``R`` or ``W`` is refused, naming the operator as it
    was written.
    """
    return _Normal().of(tree, None)


def check_names(tree: Formula, names: Iterable[str]) -> None:
    """Refuse a formula that speaks of propositions other than ``names``, the regions of a map."""
    known = set(names)
    for node in tree.walk():
        if node.op == "name" and node.name not in known:
            have = ", ".join(sorted(known)) or "none"
            message = f"unknown region '{node.name}' in the formula: the map has {have}"
            raise FormulaError(f"{message} (column {node.column + 1})", node.column)


def _error(message: str, text: str, column: int) -> FormulaError:
    error = FormulaError(f"{message} (column {column + 1})", column)
    error.add_note(caret(text, column))
    return error


# Reading


@dataclass(frozen=True, slots=True)
class _Token:
    op: str  # canonical spelling, "name" or "end"
    word: str
    column: int

    def __str__(self) -> str:
        return "the end of the formula" if self.op == "end" else f"'{self.word}'"


class _Parser:
    """Precedence climbing over the tokens of one text."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.tokens = list(_tokens(text))
        self.depth = self.parentheses = 0

    def formula(self) -> Formula:
        if self.here.op == "end":
            raise FormulaError("the formula is empty: expected something like F(a & F b)", 0)
        tree = self.binary(1)
        if self.here.op != "end":
            raise self.error("expected an operator or the end of the formula")
        return tree

    @property
    def here(self) -> _Token:
        return self.tokens[0]

    def take(self) -> _Token:
        return self.tokens.pop(0)

    def error(self, expected: str) -> FormulaError:
        here = self.here
        return _error(f"{expected}, found {here}{self.hint()}", self.text, here.column)

    def hint(self) -> str:
        """``FF a`` reads as a proposition ``FF`` and an ``a`` too many: say so."""
        before = self.text[: self.here.column].rstrip()
        glued = re.search(r"\b[XFG]{2,}$", before)
        return f"; to apply operators one after the other write '{' '.join(glued[0])}'" if glued else ""

    def binary(self, strength: int) -> Formula:
        left = self.unary()
        while BINARY.get(self.here.op, 0) >= strength:
            token = self.take()
            self.deeper(token)
            own = BINARY[token.op]
            right = self.binary(own if token.op in RIGHT else own + 1)
            args = [left, right]
            while token.op in "&|" and self.here.op == token.op:  # a chain is one node
                self.take()
                args.append(self.binary(own + 1))
            left = Formula(token.op, tuple(args), column=token.column, word=token.word)
            self.depth -= 1
        return left

    def unary(self) -> Formula:
        token = self.here
        if token.op in UNARY:
            self.take()
            self.deeper(token)
            node = Formula(token.op, (self.unary(),), column=token.column, word=token.word)
            self.depth -= 1
            return node
        if token.op == "(":
            self.take()
            self.parentheses += 1
            self.bounded(self.parentheses, token)
            node = self.binary(1)
            self.parentheses -= 1
            if self.here.op != ")":
                raise self.error(f"expected an operator or ')' to close the '(' of column {token.column + 1}")
            self.take()
            return node
        if token.op not in ("name", "true", "false"):
            raise self.error(f"expected {_OPERAND}")
        self.take()
        name = token.word if token.op == "name" else ""
        return Formula(token.op, (), name, token.column, token.word)

    def deeper(self, token: _Token) -> None:
        self.depth += 1
        self.bounded(self.depth, token)

    def bounded(self, depth: int, token: _Token) -> None:
        if depth > MAX_DEPTH:
            raise _error(f"nested deeper than {MAX_DEPTH} levels: simplify it", self.text, token.column)


def _tokens(text: str) -> Iterator[_Token]:
    column = 0
    while column < len(text):
        if text[column].isspace():
            column += 1
            continue
        match = _TOKEN.match(text, column)
        if match is None:
            found, hint = _foreign(text[column:])
            raise _error(
                f"'{found}' has no meaning in a formula{hint or '; expected ' + _OPERAND}", text, column
            )
        yield _Token(_SPELLINGS.get(match[0], "name"), match[0], column)
        column = match.end()
    yield _Token("end", "", len(text))


def _foreign(rest: str) -> tuple[str, str]:
    for spelling, ours in _FOREIGN.items():
        if rest.startswith(spelling):
            return spelling, f"; write '{ours}'"
    return rest[0], ""


# Writing


def _strength(node: Formula) -> int:
    return BINARY.get(node.op, _TIGHT if node.op in UNARY else _TIGHT + 1)


def _show(node: Formula, word: str = "") -> str:
    """A text with few parentheses that reads back as the same tree, its operator shown as ``word``."""
    if not node.args:
        return node.name or node.op
    own, op = _strength(node), word or node.op
    if node.op in UNARY:
        (arg,) = node.args
        inner = _show(arg)
        if _strength(arg) < own:
            return f"{op}({inner})"
        return f"{op} {inner}" if op.isalpha() else f"{op}{inner}"
    loose = len(node.args) - 1 if node.op in RIGHT else 0  # the operand that may bind as loosely as we do
    if node.op in "&|":
        loose = -1
    parts = []
    for i, arg in enumerate(node.args):
        text = _show(arg)
        bare = _strength(arg) > own or (i == loose and _strength(arg) == own)
        if op in "&|" and _strength(arg) == BINARY["U"]:
            bare = False  # (a U b) & c would not need them, but reads better
        parts.append(text if bare else f"({text})")
    return f" {op} ".join(parts)


# Positive normal form


class _Normal:
    """One conversion; ``<->`` uses both signs of its operands, so results are shared."""

    def __init__(self) -> None:
        self.done: dict[tuple[int, bool], Formula] = {}

    def of(self, node: Formula, negation: Formula | None) -> Formula:
        """``node``, or its negation where ``negation`` is the operator of the user that negates it."""
        key = id(node), negation is not None
        if key not in self.done:
            self.done[key] = self.rewrite(node, negation)
        return self.done[key]

    def rewrite(self, node: Formula, negation: Formula | None) -> Formula:
        op, args, negative = node.op, node.args, negation is not None
        if op in ("true", "false"):
            return TRUE if (op == "true") is not negative else FALSE
        if op == "name":
            return Formula("!", (node,), column=node.column) if negative else node
        turned = None if negative else node
        if op == "!":
            return self.of(args[0], turned)
        if op == "->":
            left = self.of(args[0], turned)
            return _chain("&" if negative else "|", [left, self.of(args[1], negation)])
        if op in ("<->", "xor"):
            return self.either_sign(node, negative)
        if op not in "&|":
            op = _DUAL[op] if negative else op
        if op in FOREVER:
            raise _refusal(node, negation)
        new = []
        for arg in args:
            new.append(self.of(arg, negation))  # noqa: PERF401 - on 3.11 a comprehension recurses twice
        if op in "&|":
            return _chain("&|"[(op == "&") is negative], new)
        return Formula(op, tuple(new), column=node.column, word=node.word)

    def either_sign(self, node: Formula, negative: bool) -> Formula:
        """``p <-> q = (p & q) | (!p & !q)``, ``p xor q = (p & !q) | (!p & q)``; negation swaps the two."""
        p, q = node.args
        differ = (node.op == "xor") is not negative
        pairs = ((None, node), (node, None)) if differ else ((None, None), (node, node))
        return _chain("|", [_chain("&", [self.of(p, s), self.of(q, t)]) for s, t in pairs])


_DUAL = {"X": "X", "F": "G", "G": "F", "U": "R", "R": "U", "W": "M", "M": "W"}


def _chain(op: str, args: list[Formula]) -> Formula:
    flat: list[Formula] = []
    for arg in args:
        flat.extend(arg.args if arg.op == op else [arg])
    return Formula(op, tuple(flat))


def _refusal(node: Formula, negation: Formula | None) -> FormulaError:
    why = "promises something for ever; no finite flight can complete it"
    said = _short(_show(node, node.word))
    if negation is None:
        advice = {"R": "; 'M' in its place comes to an end", "W": "; 'U' in its place comes to an end"}
        message = f"operator '{node.word}': '{said}' {why}{advice.get(node.op, '')}"
    else:
        where = f"'{negation.word}' of column {negation.column + 1}"
        means = _short(str(Formula(_DUAL[node.op], tuple(Formula("!", (arg,)) for arg in node.args))))
        message = f"operator '{node.word}': '{said}' is negated by {where}; that is '{means}', which {why}"
    return FormulaError(f"{message} (column {node.column + 1})", node.column)


def _short(text: str, width: int = 40) -> str:
    return text if len(text) <= width else f"{text[: width - 3]}..."


__all__ = ["FALSE", "MAX_DEPTH", "TRUE", "Formula", "caret", "check_names", "parse", "positive"]
