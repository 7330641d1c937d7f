"""Automata as text in the Hanoi Omega-Automata format (HOA v1), and the installed reader of such files."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

from pareto_ltl.logic import labels
from pareto_ltl.logic.automaton import Automaton, letter_codes
from pareto_ltl.support.extensions import FORMAT_GROUP, installed_object
from pareto_ltl.support.names import quoted_text


class AutomatonFormats(NamedTuple):
    """The reader of automata of others: the object ``automata`` of the entry points ``pareto_ltl.formats``.

    Attributes
    ----------
    read : callable
        The minimal automaton of a file over the given letters; DataError if it cannot be read.
    atoms : callable
        The propositions of a file.
    """

    read: Callable[[str | Path, Iterable[Iterable[str]] | None], Automaton]
    atoms: Callable[[str | Path], tuple[str, ...]]


@lru_cache
def automaton_formats() -> AutomatonFormats:
    """The installed reader of automata."""
    found: AutomatonFormats = installed_object(FORMAT_GROUP, "automata")
    return found


def hoa_text(automaton: Automaton) -> str:
    """The automaton as HOA text.

    If not all subsets of the propositions can occur, a header ``letters`` lists those that can, as bit sets
    over ``AP``; other tools ignore this header. The edges of letters that are not listed are arbitrary.
    """
    codes = letter_codes(automaton.atoms, automaton.letters)
    names = " ".join(quoted_text(name) for name in automaton.atoms)
    lines = [
        "HOA: v1",
        f"name: {quoted_text(automaton.formula)}",
        'tool: "pareto_ltl"',
        f"States: {automaton.n_states}",
        f"Start: {automaton.initial}",
        f"AP: {len(automaton.atoms)} {names}".rstrip(),
        "acc-name: Buchi",
        "Acceptance: 1 Inf(0)",
        "properties: trans-labels explicit-labels state-acc complete deterministic terminal",
    ]
    if len(codes) < 2 ** len(automaton.atoms):
        lines.append("letters: " + " ".join(map(str, codes.tolist())))
    lines.append("--BODY--")
    places = tuple(map(str, range(len(automaton.atoms))))
    for q, row in enumerate(automaton.delta):
        lines.append(f"State: {q} {{0}}" if automaton.accepting[q] else f"State: {q}")
        ways: dict[int, list[labels.Cube]] = {}
        for cube, target in labels.disjoint_cubes(codes, row):
            ways.setdefault(target, []).append(cube)
        lines += [f"[{labels.cubes_text(ways[target], places, 't')}] {target}" for target in sorted(ways)]
    return "\n".join([*lines, "--END--", ""])
