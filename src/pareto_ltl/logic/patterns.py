"""Missions that recur, as formulas.

Every argument is the name of a region or any formula. The patterns speak of *letters*, the labels a flight
shows step by step: where regions overlap, one letter may serve two goals; ``strict=True`` asks for a later
one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING

from pareto_ltl.logic.formula import Formula, parse
from pareto_ltl.support import extensions
from pareto_ltl.support.errors import ConfigError
from pareto_ltl.support.extensions import extension_names, known_kind

if TYPE_CHECKING:
    from pareto_ltl.settings import MissionConfig


def sequence(*goals: str, strict: bool = False) -> str:
    """One after the other, other visits allowed in between: ``F(a & F(b & F c))``."""
    return str(_sequence(_goal_trees(goals, 1, "sequence"), strict))


def coverage(*goals: str) -> str:
    """All of them, in any order: ``F a & F b & F c``."""
    return str(_all([_eventually(goal) for goal in _goal_trees(goals, 1, "coverage")]))


def ordered_coverage(goals: Sequence[str], order: Iterable[Sequence[str]]) -> str:
    """All of ``goals``, and for each pair (first, then) of ``order`` nothing of ``then`` before ``first``.

    ``ordered_coverage(["a", "b", "c"], [("a", "b")])`` is ``F a & F b & F c & (!b U a)``.
    """
    trees = [_eventually(goal) for goal in _goal_trees(goals, 1, "ordered_coverage")]
    return str(_all(trees + [_before(pair, "ordered_coverage") for pair in order]))


def patrol(*goals: str) -> str:
    """Once around, back to the first: ``F(a & F(b & F(c & F a)))``."""
    trees = _goal_trees(goals, 2, "patrol")
    return str(_sequence([*trees, trees[0]], strict=False))


def either(*missions: str) -> str:
    """Any one of several missions: ``F(a & F c) | F(b & F c)``."""
    trees = _goal_trees(missions, 1, "either")
    return str(trees[0] if len(trees) == 1 else _flat_chain("|", trees))


def avoid_until(avoid: str | Sequence[str], until: str) -> str:
    """Stay out of ``avoid`` until ``until``, which must come: ``!b U a``."""
    return str(_clear(_several(avoid, "avoid_until"), parse(until)))


def reach_avoid(goals: str | Sequence[str], avoid: str | Sequence[str]) -> str:
    """``goals`` in this order, never in ``avoid`` before the last: ``!x U (a & (!x U b))``."""
    result: Formula | None = None
    no_go = _several(avoid, "reach_avoid")
    for goal in reversed(_several(goals, "reach_avoid")):
        result = _clear(no_go, goal if result is None else _all([goal, result]))
    return str(result)


def key_door(*pairs: Sequence[str], goal: str | None = None) -> str:
    """For each pair (key, door) the door only after the key, and through all doors, or to ``goal`` if given.

    ``key_door(("k", "d"))`` is ``(!d U k) & F d``; with ``goal="g"`` it is ``(!d U k) & F g``.
    """
    if not pairs:
        raise ConfigError("mission pattern key_door needs at least one pair [key, door]")
    parts = [_before(pair, "key_door") for pair in pairs]
    ends = [goal] if goal is not None else [door for _, door in pairs]
    return str(_all(parts + [_eventually(parse(end)) for end in ends]))


PATTERNS: dict[str, Callable[[MissionConfig], str]] = {
    "sequence": lambda m: sequence(*m.goals),
    "coverage": lambda m: coverage(*m.goals),
    "ordered_coverage": lambda m: ordered_coverage(m.goals, m.order),
    "patrol": lambda m: patrol(*m.goals),
    "either": lambda m: either(*m.goals),
    "avoid_until": lambda m: avoid_until(m.avoid, _only(m.goals, "avoid_until")),
    "reach_avoid": lambda m: reach_avoid(m.goals, m.avoid),
    "key_door": lambda m: key_door(*m.order, goal=_only(m.goals, "key_door") if m.goals else None),
}


def formula_of(mission: MissionConfig) -> str:
    """The formula that the settings ask for, written out or by pattern."""
    if mission.pattern is None:
        return mission.formula
    if mission.formula:
        raise ConfigError(f"mission.pattern={mission.pattern} and mission.formula are both set; choose one")
    try:
        make = known_kind(extensions.PATTERN_GROUP, PATTERNS, mission.pattern, callable)
    except KeyError:
        known = ", ".join((*PATTERNS, *extension_names(extensions.PATTERN_GROUP)))
        raise ConfigError(f"mission.pattern must be one of {known}; got {mission.pattern!r}") from None
    return make(mission)


def _sequence(goals: list[Formula], strict: bool) -> Formula:
    result = _eventually(goals[-1])
    for goal in reversed(goals[:-1]):
        rest = Formula("X", (result,)) if strict else result
        result = _eventually(_all([goal, rest]))
    return result


def _eventually(goal: Formula) -> Formula:
    return Formula("F", (goal,))


def _all(parts: list[Formula]) -> Formula:
    return parts[0] if len(parts) == 1 else _flat_chain("&", parts)


def _flat_chain(op: str, parts: list[Formula]) -> Formula:
    flat = [piece for part in parts for piece in (part.args if part.op == op else (part,))]
    return Formula(op, tuple(flat))


def _clear(no_go: list[Formula], until: Formula) -> Formula:
    """``!(x | y) U until``"""
    zone = no_go[0] if len(no_go) == 1 else _flat_chain("|", no_go)
    return Formula("U", (Formula("!", (zone,)), until))


def _before(pair: Sequence[str], pattern: str) -> Formula:
    """``!then U first``"""
    if isinstance(pair, str) or len(pair) != 2:
        raise ConfigError(f"mission pattern {pattern} takes pairs [first, then], got {pair!r}")
    first, then = pair
    return _clear([parse(then)], parse(first))


def _several(names: str | Sequence[str], pattern: str) -> list[Formula]:
    return _goal_trees([names] if isinstance(names, str) else names, 1, pattern)


def _goal_trees(goals: Sequence[str], least: int, pattern: str) -> list[Formula]:
    if len(goals) < least:
        raise ConfigError(f"mission pattern {pattern} needs at least {least} regions, got {list(goals)}")
    return [parse(goal) for goal in goals]


def _only(goals: Sequence[str], pattern: str) -> str:
    if len(goals) != 1:
        raise ConfigError(f"mission pattern {pattern} takes one goal, got {list(goals)}")
    return goals[0]


__all__ = [
    "PATTERNS",
    "avoid_until",
    "coverage",
    "either",
    "formula_of",
    "key_door",
    "ordered_coverage",
    "patrol",
    "reach_avoid",
    "sequence",
]
