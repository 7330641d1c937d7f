"""``pareto-ltl formula "F(a & F b)"``: the meaning of a formula, before planning."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Sequence

import numpy as np

from pareto_ltl.cli.arguments import CommandArguments
from pareto_ltl.cli.output import Answer, print_problem
from pareto_ltl.logic import hoa
from pareto_ltl.logic import picture as draw
from pareto_ltl.logic.automaton import Automaton, show_letter, translate
from pareto_ltl.logic.formula import Formula
from pareto_ltl.logic.formula import caret_lines as caret
from pareto_ltl.logic.formula import parse_formula as parse
from pareto_ltl.logic.formula import positive_normal_form as positive
from pareto_ltl.support.errors import FormulaError
from pareto_ltl.support.messages import shown_text


def formula_command(argv: Sequence[str]) -> Answer:
    """The meaning of a formula; after one line and a caret, exit code 2 for a mistake in it."""
    options = _formula_arguments().parse_args(argv)
    text = options.formula
    try:
        tree = parse(text)
        automaton = translate(text, _alphabet(tree, options), options.max_states)
    except FormulaError as error:
        print_problem(str(error))
        if error.column is not None:
            print(caret(text, error.column), file=sys.stderr)
        return Answer({"error": str(error), "column": error.column}, code=2)
    if options.dot:
        _write_text(options.dot, draw.dot_text(automaton))
    if options.hoa:
        _write_text(options.hoa, hoa.hoa_text(automaton))
    if options.picture:
        draw.save_picture(automaton, options.picture)
    written = [path for path in (options.dot, options.hoa, options.picture) if path]
    meaning = describe_formula(tree, automaton)
    document = {
        "formula": str(tree),
        "normal_form": str(positive(tree)),
        "propositions": automaton.atoms,
        "letters": len(automaton.letters),
        "states": automaton.n_states,
        "initial": automaton.initial,
        "accepting": np.flatnonzero(automaton.accepting),
        "distance": automaton.distance,
        "extra_visits_harmless": automaton.harm() is None,
        "written": written,
    }
    return Answer(document, [f"{name:<14}{value}" for name, value in meaning.items()], written)


def describe_formula(tree: Formula, automaton: Automaton) -> dict[str, str]:
    """What the command prints of a formula, by name."""
    normal = str(positive(tree))
    free = 2 ** len(automaton.atoms)
    return {
        "formula": shown_text(str(tree), 1000),
        "normal form": shown_text(normal, 1000),
        "propositions": ", ".join(automaton.atoms) or "none",
        "letters": f"{len(automaton.letters)}" + " (all subsets)" * (len(automaton.letters) == free),
        "states": f"{automaton.n_states} ({_state_roles(automaton)})",
        "d_A(initial)": _initial_distance(automaton),
        "extra visits": _extra_visits(automaton),
    }


def _state_roles(automaton: Automaton) -> str:
    accepting = np.flatnonzero(automaton.accepting).tolist()
    trap = f"trap {automaton.trap}" if automaton.trap >= 0 else "no trap"
    return f"initial {automaton.initial}, accepting {accepting[0] if accepting else 'none'}, {trap}"


def _initial_distance(automaton: Automaton) -> str:
    if automaton.tautology:
        return "0: a tautology, complete before the flight starts"
    if automaton.contradiction:
        return "inf: a contradiction, no flight completes it"
    steps = int(automaton.distance[automaton.initial])
    return f"{steps} letter{'s' * (steps > 1)} at least, the start position's among them"


def _extra_visits(automaton: Automaton) -> str:
    harm = automaton.harm()
    if harm is None:
        return "harmless: additional letters never make the mission fail (insertion-closed)"
    state, column = harm
    letter = show_letter(automaton.letters[column])
    after = int(automaton.delta[state, column])
    what = (
        "makes the mission fail"
        if after == automaton.trap
        else f"needs further visits (state {state} to {after})"
    )
    return f"not harmless: in state {state} an extra {letter} {what}"


def _alphabet(tree: Formula, options: argparse.Namespace) -> Iterable[Iterable[str]] | None:
    if options.disjoint:
        return [(), *((name,) for name in tree.atoms)]
    return None


def _write_text(path: str, text: str) -> None:
    with open(path, "w", encoding="utf-8") as file:
        file.write(text)


def _formula_arguments() -> CommandArguments:
    parser = CommandArguments(
        prog="pareto-ltl formula",
        description="Show what a mission formula means: normal form, automaton, whether extra visits are "
        "harmful.",
    )
    parser.add_argument("formula", help="for example 'F(a & F b)'")
    parser.add_argument(
        "--disjoint", action="store_true", help="no two regions overlap: each letter has at most one name"
    )
    parser.add_argument(
        "--max-states", type=int, default=10_000, help="stop beyond this many (default 10000)"
    )
    parser.add_argument("--picture", metavar="FILE", help="draw the automaton (png, svg, pdf)")
    parser.add_argument("--dot", metavar="FILE", help="write it as Graphviz text")
    parser.add_argument("--hoa", metavar="FILE", help="write it in the HOA format")
    return parser
