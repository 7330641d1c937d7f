"""Mission formulas: parser, text output, and the positive normal form, which decides co-safety.

Grammar, weakest binding first. A chain of ``&`` or ``|`` is one node; ``U R W M`` and ``->`` associate to the
right::

    formula  = implies {("<->" | "xor") implies}
    implies  = or ["->" implies]
    or       = and {("|" | "||" | "or") and}
    and      = binding {("&" | "&&" | "and") binding}
    binding  = unary [("U" | "until" | "R" | "W" | "M") binding]
    unary    = ("!" | "~" | "not" | "X" | "next" | "F" | "eventually" | "<>" | "G" | "[]") unary | atom
    atom     = "true" | "false" | name | '"' name of any characters '"' | "(" formula ")"

``F`` and ``G`` may have a time span that counts from departure, ``F[0,6h] a``
(:mod:`pareto_ltl.world.windows`). ``G``, ``R`` and ``W`` are part of the grammar, so that the error can name
the operator that is not co-safe.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from functools import lru_cache

from pareto_ltl.support.display import listed_text
from pareto_ltl.support.errors import FormulaError
from pareto_ltl.support.messages import SHOWN_WIDTH, shown_text
from pareto_ltl.support.names import QUOTED, name_fault, quoted_name
from pareto_ltl.world.windows import Span, clock_windows, end_clock, read_span, shown_span, span_clock

MAX_DEPTH = 200  # nesting levels, below the recursion limit of Python; a sequence of n goals has 2 n

BYTE_ORDER_MARK = "\ufeff"  # at the start of a text that was saved on Windows

UNARY_OPERATORS = ("!", "X", "F", "G")
BINARY_STRENGTH = {"<->": 1, "xor": 1, "->": 2, "|": 3, "&": 4, "U": 5, "R": 5, "W": 5, "M": 5}
RIGHT_ASSOCIATIVE = ("->", "U", "R", "W", "M")
FOREVER_OPERATORS = ("G", "R", "W")
_UNARY_STRENGTH = 6  # binding strength of unary operators; atoms bind more strongly

_SPELLINGS = {
    **{"~": "!", "not": "!", "next": "X", "eventually": "F", "<>": "F", "[]": "G", "until": "U"},
    **{"&&": "&", "and": "&", "||": "|", "or": "|"},
    **{op: op for op in (*UNARY_OPERATORS, *BINARY_STRENGTH, "(", ")", "true", "false")},
}
_TOKEN_PATTERN = re.compile(rf"<->|->|<>|\[\]|\[[^\[\]]*\]|&&|\|\||[!~&|()]|{QUOTED}|\w+")
_FOREIGN_OPERATORS = {
    "/\\": "&",
    "\\/": "|",
    "=>": "->",
    "==": "<->",
    "^": "xor",
    "¬": "!",
    "∧": "&",
    "∨": "|",
}
_OPERAND_TEXT = "a proposition, 'true', 'false', '(' or one of ! X F"


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
        For ``F`` and ``G``: begin and end of the time span [s after departure].
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
        return _formula_text(self)

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


@lru_cache(maxsize=256)
def parse_formula(text: str) -> Formula:
    """The syntax tree of ``text``; :class:`FormulaError`, with the column, for a syntax error."""
    return FormulaParser(text).formula()


def caret_lines(text: str, column: int) -> str:
    """Two lines: the formula near the zero-based ``column``, and a caret under it."""
    line = "".join(character if character.isprintable() else " " for character in text)
    first, beyond = max(0, column - SHOWN_WIDTH // 2), column + SHOWN_WIDTH // 2
    before, after = "..." if first else "", "..." if len(line) > beyond else ""
    return f"{before}{line[first:beyond]}{after}\n{' ' * (len(before) + column - first)}^"


def positive_normal_form(tree: Formula, text: str = "") -> Formula:
    """The positive normal form, with negation of propositions only and operators ``& | X F U M``.

        !X p = X !p,   !(p R q) = !p U !q,   !(p W q) = !p M !q,   !G p = F !p

    A formula with these operators only is syntactically co-safe: every word that satisfies it has a finite
    prefix that decides so (Kupferman and Vardi, 2001, doi:10.1023/A:1011254632723).

    Raises
    ------
    FormulaError
        If the normal form needs ``G``, ``R`` or ``W``, or a time span is below a temporal operator; the
        message names the operator as the user wrote it, and a note points at it in ``text`` if that is given.
    """
    try:
        _check_spans(tree)
        return _NormalForm().of(tree, None)
    except FormulaError as error:
        if text and error.column is not None:
            error.add_note(caret_lines(text, error.column))
        raise


def _check_spans(tree: Formula) -> None:
    """Raise a FormulaError for a time span below a temporal operator, as spans count from departure."""
    stack: list[tuple[Formula, Formula | None]] = [(tree, None)]
    while stack:
        node, above = stack.pop()
        if node.span is not None and above is not None:
            raise FormulaError(
                f"the time span {shown_span(node.span)} stands below '{above.word or above.op}' of column "
                f"{above.column + 1}; spans count from departure: put it outside, as in F[0,6h] (a & b), or "
                f"give the region a time window (column {node.column + 1})",
                node.column,
            )
        inner = node if node.op in "XFGURWM" else above
        stack.extend((arg, inner) for arg in node.args)


def check_names(tree: Formula, names: Iterable[str]) -> None:
    """Raise a FormulaError if a proposition of ``tree`` is not in ``names``, the regions of a map."""
    known = {*names, *clock_windows(tree.atoms)}
    for node in tree.walk():
        if node.op == "name" and node.name not in known:
            have = listed_text([quoted_name(name, _SPELLINGS) for name in sorted(known)], 26)
            guess = difflib.get_close_matches(node.name, sorted(known), n=1, cutoff=0.5)
            hint = f"; did you mean {guess[0]!r}?" if guess else ""
            message = f"unknown region '{shown_text(node.name)}' in the formula: the map has {have}{hint}"
            raise FormulaError(f"{message} (column {node.column + 1})", node.column)


def _formula_error(message: str, text: str, column: int) -> FormulaError:
    error = FormulaError(f"{message} (column {column + 1})", column)
    error.add_note(caret_lines(text, column))
    return error


# Reading


@dataclass(frozen=True, slots=True)
class _FormulaToken:
    op: str  # canonical spelling, "name" or "end"
    word: str
    column: int

    def __str__(self) -> str:
        return "the end of the formula" if self.op == "end" else f"'{shown_text(self.word)}'"


class FormulaParser:
    """Precedence climbing parser of one text."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.tokens = list(_formula_tokens(text))
        self.depth = self.parentheses = 0

    def formula(self) -> Formula:
        """The whole formula."""
        if self.here.op == "end":
            raise FormulaError("the formula is empty: expected something like F(a & F b)", 0)
        tree = self.binary(1)
        if self.here.op != "end":
            raise self.error("expected an operator or the end of the formula")
        return tree

    @property
    def here(self) -> _FormulaToken:
        """The next token."""
        return self.tokens[0]

    def take(self) -> _FormulaToken:
        """The next token, which is read."""
        return self.tokens.pop(0)

    def error(self, expected: str) -> FormulaError:
        """The error that something else was expected at the next token."""
        here = self.here
        return _formula_error(f"{expected}, found {here}{self.hint()}", self.text, here.column)

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
            self.depth -= 1
        return left

    def unary(self) -> Formula:
        """A formula without binary operators outside of parentheses."""
        token = self.here
        if token.op in UNARY_OPERATORS:
            self.take()
            self.deeper(token)
            span = self.span() if token.op in "FG" else None
            node = Formula(token.op, (self.unary(),), span=span, column=token.column, word=token.word)
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
            raise self.error(f"expected {_OPERAND_TEXT}")
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

    def deeper(self, token: _FormulaToken) -> None:
        """Enter an operand of ``token``."""
        self.depth += 1
        self.bounded(self.depth, token)

    def bounded(self, depth: int, token: _FormulaToken) -> None:
        """Refuse a ``depth`` that is too large, at ``token``."""
        if depth > MAX_DEPTH:
            raise _formula_error(
                f"nested deeper than {MAX_DEPTH} levels: simplify it", self.text, token.column
            )


def _formula_tokens(text: str) -> Iterator[_FormulaToken]:
    column = 0
    while column < len(text):
        if text[column].isspace() or text[column] == BYTE_ORDER_MARK:
            column += 1
            continue
        match = _TOKEN_PATTERN.match(text, column)
        if match is None:
            rest = text[column:]
            found = next(filter(rest.startswith, _FOREIGN_OPERATORS), rest[0])
            hint = f"; write '{_FOREIGN_OPERATORS[found]}'" if found in _FOREIGN_OPERATORS else ""
            if found == '"':
                hint = '; a name in quotes ends with another ", and has no backslash in it'
            raise _formula_error(
                f"'{shown_text(found)}' has no meaning in a formula{hint or '; expected ' + _OPERAND_TEXT}",
                text,
                column,
            )
        kind = "span" if match[0].startswith("[") else "name"
        yield _FormulaToken(_SPELLINGS.get(match[0], kind), match[0], column)
        column = match.end()
    yield _FormulaToken("end", "", len(text))


# Writing


def _binding_strength(node: Formula) -> int:
    return BINARY_STRENGTH.get(
        node.op, _UNARY_STRENGTH if node.op in UNARY_OPERATORS else _UNARY_STRENGTH + 1
    )


def _formula_text(node: Formula, word: str = "") -> str:
    """Text of the syntax tree ``node`` with few parentheses; ``word``, if given, replaces its operator."""
    if not node.args:
        return quoted_name(node.name, _SPELLINGS) if node.name else node.op
    own, op = _binding_strength(node), word or node.op
    if node.op in UNARY_OPERATORS:
        (arg,) = node.args
        inner = _formula_text(arg)
        if node.span is not None:
            op += shown_span(node.span)
        if _binding_strength(arg) < own:
            return f"{op}({inner})"
        return f"{op} {inner}" if op[0].isalpha() else f"{op}{inner}"
    # index of the operand that may have the same binding strength; a chain of & or | has none
    loose = -1 if node.op in "&|" else len(node.args) - 1 if node.op in RIGHT_ASSOCIATIVE else 0
    parts = []
    for i, arg in enumerate(node.args):
        text = _formula_text(arg)
        bare = _binding_strength(arg) > own or (i == loose and _binding_strength(arg) == own)
        if op in "&|" and _binding_strength(arg) == BINARY_STRENGTH["U"]:
            bare = False  # optional parentheses in (a U b) & c, for readability
        parts.append(text if bare else f"({text})")
    return f" {op} ".join(parts)


# Positive normal form


class _NormalForm:
    """One conversion; results are shared, since ``<->`` needs both signs of its operands."""

    def __init__(self) -> None:
        self.done: dict[tuple[int, bool], Formula] = {}

    def of(self, node: Formula, negation: Formula | None) -> Formula:
        """Normal form of ``node``, or of its negation if the operator ``negation`` negates it."""
        key = id(node), negation is not None
        if key not in self.done:
            self.done[key] = self.rewrite(node, negation)
        return self.done[key]

    def rewrite(self, node: Formula, negation: Formula | None) -> Formula:
        op, args, negative = node.op, node.args, negation is not None
        if op in ("true", "false"):
            return TRUE_FORMULA if (op == "true") is not negative else FALSE_FORMULA
        if op == "name":
            return Formula("!", (node,), column=node.column) if negative else node
        turned = None if negative else node
        if op == "!":
            return self.of(args[0], turned)
        if op == "->":
            left = self.of(args[0], turned)
            return flat_chain("&" if negative else "|", [left, self.of(args[1], negation)])
        if op in ("<->", "xor"):
            return self.either_sign(node, negative)
        if op not in "&|":
            op = _DUAL_OPERATORS[op] if negative else op
        if node.span is not None:
            return self.within_span(op, node.span, self.of(args[0], negation))
        if op in FOREVER_OPERATORS:
            raise _not_co_safe(node, negation)
        new = []
        for arg in args:
            new.append(self.of(arg, negation))  # noqa: PERF401 - on 3.11 a comprehension recurses twice
        if op in "&|":
            return flat_chain("&|"[(op == "&") is negative], new)
        return Formula(op, tuple(new), column=node.column, word=node.word)

    def within_span(self, op: str, span: Span, inner: Formula) -> Formula:
        """Normal form of ``F`` or ``G`` with a time span, written with clocks."""
        now, over = Formula("name", name=span_clock(span)), Formula("name", name=end_clock(span))
        if op == "F":
            return Formula("F", (flat_chain("&", [now, inner]),))
        return Formula("U", (flat_chain("|", [Formula("!", (now,)), inner]), over))

    def either_sign(self, node: Formula, negative: bool) -> Formula:
        """Normal form of ``<->`` and ``xor``; negation exchanges the two.

        p <-> q = (p & q) | (!p & !q),   p xor q = (p & !q) | (!p & q)
        """
        p, q = node.args
        differ = (node.op == "xor") is not negative
        pairs = ((None, node), (node, None)) if differ else ((None, None), (node, node))
        return flat_chain("|", [flat_chain("&", [self.of(p, s), self.of(q, t)]) for s, t in pairs])


_DUAL_OPERATORS = {"X": "X", "F": "G", "G": "F", "U": "R", "R": "U", "W": "M", "M": "W"}


def flat_chain(op: str, args: Iterable[Formula]) -> Formula:
    """One or more ``args`` joined by ``op`` (``&`` or ``|``); arguments with the same operator are merged."""
    flat = tuple(part for arg in args for part in (arg.args if arg.op == op else (arg,)))
    return flat[0] if len(flat) == 1 else Formula(op, flat)


def _not_co_safe(node: Formula, negation: Formula | None) -> FormulaError:
    why = "promises something for ever; no finite flight can complete it"
    shown = _elided_text(_formula_text(node, node.word))
    if negation is None:
        advice = {"R": "; 'M' in its place comes to an end", "W": "; 'U' in its place comes to an end"}
        message = f"operator '{node.word}': '{shown}' {why}{advice.get(node.op, '')}"
    else:
        where = f"'{negation.word}' of column {negation.column + 1}"
        means = _elided_text(
            str(Formula(_DUAL_OPERATORS[node.op], tuple(Formula("!", (arg,)) for arg in node.args)))
        )
        message = f"operator '{node.word}': '{shown}' is negated by {where}; that is '{means}', which {why}"
    return FormulaError(f"{message} (column {node.column + 1})", node.column)


def _elided_text(text: str, width: int = 40) -> str:
    return text if len(text) <= width else f"{text[: width - 3]}..."
