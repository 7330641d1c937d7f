"""A mission formula in words: ``F(a & F(b | c))`` is "reach a, then b or c"."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from careful_io.times import hours_text
from pareto_ltl.extend import Formula, parse_formula
from pareto_ltl.support.errors import FormulaError

LONGEST = 400  # characters; a longer mission is shown only as a formula
BINARY_WORDS = {
    "U": "{0} until {1}", "->": "if {0}, then {1}", "<->": "{0} exactly if {1}", "xor": "either {0} or {1}",
}  # fmt: skip


def mission_in_words(text: str) -> str:
    """The mission ``text`` in words; empty if it cannot be parsed, has no wording here, or is too long."""
    try:
        words = _goal_words(parse_formula(text))
    except (FormulaError, KeyError, RecursionError):
        return ""
    return words if len(words) <= LONGEST else ""


def _goal_words(tree: Formula) -> str:
    """A mission or a part of it, as an instruction: "reach a, then b"."""
    if tree.op == "&":
        return "; and ".join(_merged_visits(tree.args, "reach {}, in any order", _goal_words))
    if tree.op == "|":
        return "either " + ", or ".join(map(_goal_words, tree.args))
    if tree.op == "F":
        return f"reach {_target_words(tree.args[0])}{_span_words(tree)}"
    if tree.op == "G" and tree.span is not None:
        return f"{_state_words(tree.args[0])}{_span_words(tree)}"
    if tree.op == "X":
        return f"at the next step, {_goal_words(tree.args[0])}"
    if tree.op == "U" and tree.args[0].op == "!":
        return (
            f"stay out of {_place_words(tree.args[0].args[0])} until {_target_words(tree.args[1])} is reached"
        )
    return _state_words(tree)


def _span_words(tree: Formula) -> str:
    """The time span of an operator, e.g. `` within 6 h of departure``; empty if it has none."""
    if tree.span is None:
        return ""
    begin, end = tree.span
    if begin == 0.0 and tree.op == "F":
        return f" within {hours_text(end)} of departure"
    return f" between {hours_text(begin)} and {hours_text(end)} after departure"


def _merged_visits(parts: Sequence[Formula], together: str, words: Callable[[Formula], str]) -> list[str]:
    """The ``words`` for each part; two or more untimed visits are one text, ``together`` of their places."""
    visits = [part for part in parts if _is_untimed_visit(part)]
    if len(visits) < 2:
        return list(map(words, parts))
    *first, last = (_place_words(part.args[0]) for part in visits)
    left = (words(part) for part in parts if part not in visits)
    return [together.format(f"{', '.join(first)} and {last}"), *left]


def _target_words(tree: Formula) -> str:
    """The operand of ``F``: a place, and what must follow there."""
    if _is_place(tree) or tree.op not in ("&", "|"):
        return _place_words(tree)
    if tree.op == "|":
        return " or ".join(f"({_target_words(part)})" for part in tree.args)
    places = [part for part in tree.args if _is_place(part)]
    rest = [part for part in tree.args if not _is_place(part)]
    here = " and ".join(_place_words(part) for part in places)
    if not here:
        return f"a point from which to {' and to '.join(_goal_words(part) for part in rest)}"
    then = _merged_visits(rest, "{} in any order", _following_words)
    return here + "".join(f", then {words}" for words in then[:1]) + "".join(f", and {w}" for w in then[1:])


def _following_words(tree: Formula) -> str:
    """What must follow a place; for ``F b`` only "b"."""
    if tree.op == "X" and tree.args[0].op == "F":
        return f"at a later step {_target_words(tree.args[0].args[0])}"
    return _target_words(tree.args[0]) if tree.op == "F" else _goal_words(tree)


def _is_untimed_visit(tree: Formula) -> bool:
    return tree.op == "F" and tree.span is None and _is_place(tree.args[0])


def _is_place(tree: Formula) -> bool:
    """Whether ``tree`` has no temporal operators, so that one step decides it."""
    return tree.op in ("name", "true", "false") or (
        tree.op in ("&", "|", "!") and all(map(_is_place, tree.args))
    )


def _place_words(tree: Formula) -> str:
    if tree.op == "name":
        return tree.name
    if tree.op == "!":
        return f"outside {_place_words(tree.args[0])}"
    if tree.op in ("&", "|"):
        word = " and " if tree.op == "&" else " or "
        return word.join(_place_words(part) for part in tree.args)
    return f"“{tree}”"


def _state_words(tree: Formula) -> str:
    if _is_place(tree):
        return f"be {_place_words(tree)}" if tree.op == "!" else f"be in {_place_words(tree)}"
    return BINARY_WORDS[tree.op].format(*map(_goal_words, tree.args))
