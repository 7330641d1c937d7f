"""Common formulas as functions that return their texts; each argument is a proposition or a formula.

If two goals of a sequence hold at the same time, one step can fulfil both; ``strict=True`` requires a later
step for the second goal.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from ltlf.errors import PatternError
from ltlf.formula import Formula, flat_chain, parse_formula


def sequence(*goals: str, strict: bool = False) -> str:
    """Visit ``goals`` in this order, other visits are allowed in between: ``F(a & F(b & F c))``."""
    return str(_nested_visits(_goal_formulas(goals, 1, "sequence"), strict))


def coverage(*goals: str) -> str:
    """Visit all ``goals`` in any order: ``F a & F b & F c``."""
    return str(flat_chain("&", map(_eventually_formula, _goal_formulas(goals, 1, "coverage"))))


def ordered_coverage(goals: Sequence[str], order: Iterable[Sequence[str]]) -> str:
    """Visit all ``goals``; for each pair (first, then) of ``order``, do not visit ``then`` before ``first``.

    ``ordered_coverage(["a", "b", "c"], [("a", "b")])`` is ``F a & F b & F c & (!b U a)``.
    """
    trees = [_eventually_formula(goal) for goal in _goal_formulas(goals, 1, "ordered_coverage")]
    return str(flat_chain("&", trees + [_order_formula(pair, "ordered_coverage") for pair in order]))


def patrol(*goals: str) -> str:
    """Visit ``goals`` in this order and return to the first: ``F(a & F(b & F(c & F a)))``."""
    trees = _goal_formulas(goals, 2, "patrol")
    return str(_nested_visits([*trees, trees[0]], strict=False))


def either(*formulas: str) -> str:
    """One of several formulas: ``F(a & F c) | F(b & F c)``."""
    return str(flat_chain("|", _goal_formulas(formulas, 1, "either")))


def avoid_until(avoid: str | Sequence[str], until: str) -> str:
    """Stay out of ``avoid`` until ``until`` is visited, which is required: ``!b U a``."""
    return str(_avoid_formula(_one_or_more(avoid, "avoid_until"), parse_formula(until)))


def reach_avoid(goals: str | Sequence[str], avoid: str | Sequence[str]) -> str:
    """Visit ``goals`` in this order, and stay out of ``avoid`` until the last: ``!x U (a & (!x U b))``."""
    result: Formula | None = None
    no_go = _one_or_more(avoid, "reach_avoid")
    for goal in reversed(_one_or_more(goals, "reach_avoid")):
        result = _avoid_formula(no_go, goal if result is None else flat_chain("&", [goal, result]))
    return str(result)


def key_door(*pairs: Sequence[str], goal: str | None = None) -> str:
    """For each pair (key, door), visit the door only after the key; visit all doors, or ``goal`` if given.

    ``key_door(("k", "d"))`` is ``(!d U k) & F d``; with ``goal="g"`` it is ``(!d U k) & F g``.
    """
    if not pairs:
        raise PatternError("key_door needs at least one pair [key, door]")
    parts = [_order_formula(pair, "key_door") for pair in pairs]
    ends = [goal] if goal is not None else [door for _, door in pairs]
    return str(flat_chain("&", parts + [_eventually_formula(parse_formula(end)) for end in ends]))


def _nested_visits(goals: list[Formula], strict: bool) -> Formula:
    result = _eventually_formula(goals[-1])
    for goal in reversed(goals[:-1]):
        rest = Formula("X", (result,)) if strict else result
        result = _eventually_formula(flat_chain("&", [goal, rest]))
    return result


def _eventually_formula(goal: Formula) -> Formula:
    return Formula("F", (goal,))


def _avoid_formula(no_go: list[Formula], until: Formula) -> Formula:
    """``!(x | y) U until`` with the formulas x, y of ``no_go``."""
    return Formula("U", (Formula("!", (flat_chain("|", no_go),)), until))


def _order_formula(pair: Sequence[str], pattern: str) -> Formula:
    """``!then U first`` for the pair (first, then)."""
    if isinstance(pair, str) or len(pair) != 2:
        raise PatternError(f"{pattern} takes pairs [first, then], got {pair!r}")
    first, then = pair
    return _avoid_formula([parse_formula(then)], parse_formula(first))


def _one_or_more(names: str | Sequence[str], pattern: str) -> list[Formula]:
    return _goal_formulas([names] if isinstance(names, str) else names, 1, pattern)


def _goal_formulas(goals: Sequence[str], least: int, pattern: str) -> list[Formula]:
    if len(goals) < least:
        raise PatternError(f"{pattern} needs at least {least} regions, got {list(goals)}")
    return [parse_formula(goal) for goal in goals]
