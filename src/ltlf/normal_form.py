"""The positive normal form of a formula, which decides co-safety, and what to write if it is not co-safe."""

from __future__ import annotations

from ltlf.advice import PLAIN_ADVICE, Advice
from ltlf.errors import FormulaError
from ltlf.formula import (
    FALSE_FORMULA,
    TRUE_FORMULA,
    Formula,
    elided_text,
    flat_chain,
    formula_text,
)
from ltlf.spans import Span, end_clock, shown_span, span_clock
from ltlf.texts import caret_lines

FOREVER_OPERATORS = ("G", "R", "W")
TEMPORAL = frozenset("XFGURWM")


def positive_normal_form(tree: Formula, text: str = "", advice: Advice = PLAIN_ADVICE) -> Formula:
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
        _check_spans(tree, advice)
        return _NormalForm(advice, _way_out(tree, advice)).of(tree, None)
    except FormulaError as error:
        if text and error.column is not None:
            error.add_note(caret_lines(text, error.column))
        raise


def _check_spans(tree: Formula, advice: Advice) -> None:
    """Raise a FormulaError for a time span below a temporal operator, as spans count from the start."""
    stack: list[tuple[Formula, Formula | None]] = [(tree, None)]
    while stack:
        node, above = stack.pop()
        if node.span is not None and above is not None:
            raise FormulaError(
                f"the time span {shown_span(node.span)} stands below '{above.word or above.op}' of column "
                f"{above.column + 1}; {advice.spans} (column {node.column + 1})",
                node.column,
            )
        inner = node if node.op in "XFGURWM" else above
        stack.extend((arg, inner) for arg in node.args)


class _NormalForm:
    """One conversion; results are shared, since ``<->`` needs both signs of its operands."""

    def __init__(self, advice: Advice, cure: str) -> None:
        self.done: dict[tuple[int, bool], Formula] = {}
        self.advice = advice
        self.cure = cure  # what to write instead of G, for the error message

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
            raise _not_co_safe(node, negation, self.advice, self.cure)
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


def _not_co_safe(node: Formula, negation: Formula | None, advice: Advice, cure: str) -> FormulaError:
    why = f"promises something for ever; {advice.endless}"
    shown = elided_text(formula_text(node, node.word))
    if negation is None:
        message = f"operator '{node.word}': '{shown}' {why}"
        if node.op == "G":
            message += (
                f"; {cure}" if cure else "; give it an end, as in G[0,6h] a, or say what comes after it"
            )
        else:
            message += f"; '{'M' if node.op == 'R' else 'U'}' in its place comes to an end"
    else:
        where = f"'{negation.word}' of column {negation.column + 1}"
        means = elided_text(
            str(Formula(_DUAL_OPERATORS[node.op], tuple(Formula("!", (arg,)) for arg in node.args)))
        )
        message = f"operator '{node.word}': '{shown}' is negated by {where}; that is '{means}', which {why}"
        message += f"; {cure}" * bool(cure)
    return FormulaError(f"{message} (column {node.column + 1})", node.column)


# Reach and avoid


def _way_out(tree: Formula, advice: Advice) -> str:
    """What to write instead of a conjunction with ``G`` of what to avoid; empty if there is no such text.

    A word is over when the formula holds. So "F a, and never b" is ``!b U (a & !b)``.
    """
    parts = tree.args if tree.op == "&" else (tree,)
    safe, rest = list[Formula](), list[Formula]()
    for part in parts:
        lasting = _lasting(part)
        (rest if lasting is None else safe).append(part if lasting is None else lasting)
    if not safe or any(map(_is_temporal, safe)):
        return ""
    clear, literals = flat_chain("&", safe), [arg for part in safe for arg in _factors(part)]
    try:
        text = str(flat_chain("&", [_kept_clear(part, clear) for part in rest]) if rest else clear)
    except ValueError:
        return ""
    if rest:
        cure = advice.ended.format(text)
    else:
        cure = advice.unended.format(text if len(clear.args) < 2 else f"({text})")
    if any(literal.op != "!" or literal.args[0].op != "name" for literal in literals):
        return cure
    return cure + advice.excluded([literal.args[0].name for literal in literals])


def _lasting(part: Formula) -> Formula | None:
    """The condition p of ``G p``, or of ``!F q`` as !q; None for another formula."""
    if part.span is None and part.op == "G":
        return part.args[0]
    if part.op == "!" and part.args[0].op == "F" and part.args[0].span is None:
        return Formula("!", part.args[0].args)
    return None


def _factors(part: Formula) -> tuple[Formula, ...]:
    return part.args if part.op == "&" else (part,)


def _is_temporal(tree: Formula) -> bool:
    return any(node.op in TEMPORAL for node in tree.walk())


def _kept_clear(node: Formula, clear: Formula) -> Formula:
    """``node`` with the condition c = ``clear`` at every step up to its completion.

    T(b) = b & c without temporal operators,  T(X p) = c & X T(p),  T(F p) = c U T(p),
    T(p U q) = (p & c) U T(q)  with p as b above

    ValueError for other formulas.
    """
    if not _is_temporal(node):
        return flat_chain("&", [node, clear])
    if node.op in "&|":
        return Formula(node.op, tuple(_kept_clear(arg, clear) for arg in node.args))
    if node.span is not None or node.op not in "XFU" or (node.op == "U" and _is_temporal(node.args[0])):
        raise ValueError(node.op)
    then = _kept_clear(node.args[-1], clear)
    if node.op == "X":
        return flat_chain("&", [clear, Formula("X", (then,))])
    return Formula("U", (clear if node.op == "F" else flat_chain("&", [node.args[0], clear]), then))
