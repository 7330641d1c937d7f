"""Automata as text in the Hanoi Omega-Automata format (HOA v1)."""

from __future__ import annotations

from ltlf import labels
from ltlf.automaton import Dfa, letter_codes


def hoa_text(automaton: Dfa, tool: str) -> str:
    """The automaton as HOA text, written by ``tool``.

    If not all subsets of the propositions can occur, a header ``letters`` lists those that can, as bit sets
    over ``AP``; other tools ignore this header. The edges of letters that are not listed are arbitrary.
    """
    codes = letter_codes(automaton.atoms, automaton.letters)
    names = " ".join(_quoted(name) for name in automaton.atoms)
    lines = [
        "HOA: v1",
        f"name: {_quoted(automaton.formula)}",
        f"tool: {_quoted(tool)}",
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


def _quoted(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'
