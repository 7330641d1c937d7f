"""Formulas of missions: parsed with advice in words of flights and maps, and compared with a map's regions.

The package ``ltlf``, which is not about maps, parses formulas and translates them. Here its errors become
errors of the planner.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager

import ltlf
from careful_io.messages import shown_text
from careful_io.names import quoted_name
from careful_io.texts import listed_text
from ltlf import Advice, Formula
from pareto_ltl.support.errors import FormulaError
from pareto_ltl.world.windows import clock_windows


def _as_obstacles(names: Sequence[str]) -> str:
    shown = listed_text(map(quoted_name, names), 3)
    return f", or draw {shown} as {'obstacles' if len(names) > 1 else 'an obstacle'}"


ADVICE = Advice(
    endless="no finite flight can complete it",
    ended="a flight ends with its last visit: write '{}'",
    unended="a flight ends with a visit: write '{} U goal', with the region to visit as goal",
    excluded=_as_obstacles,
    spans="spans count from departure: put it outside, as in F[0,6h] (a & b), or give the region a time "
    "window",
    states="raise logic.max_states",
    foreign={
        "an automaton in the HOA format": "name its file as mission.automaton",
        "a property of PRISM (PCTL)": "write the path formula alone, what stands between [ and ]; the "
        "failure probability is minimised",
        "a formula of CTL": "leave out A and E: a mission is about one path, as in F a",
        "a comparison of numbers, as in signal temporal logic": "draw the set of positions as a region and "
        "write its name",
        "a quantifier": "write one formula for each region, joined by & or |",
    },
)


@contextmanager
def planner_errors() -> Iterator[None]:
    """Raise a :class:`FormulaError` of the planner for one of ``ltlf``, with its column and notes."""
    try:
        yield
    except ltlf.FormulaError as error:
        raised = FormulaError(str(error), error.column)
        for note in getattr(error, "__notes__", ()):
            raised.add_note(note)
        raise raised from None


@planner_errors()
def parse_formula(text: str) -> Formula:
    """The syntax tree of ``text``; :class:`FormulaError`, with the column, for a syntax error."""
    return ltlf.parse_formula(text, ADVICE)


@planner_errors()
def disputed_reading(text: str) -> str:
    """How ``text`` is read, with parentheses, if other tools read it in another order; else empty."""
    return ltlf.disputed_reading(text, ADVICE)


@planner_errors()
def positive_normal_form(tree: Formula, text: str = "") -> Formula:
    """The positive normal form of a co-safe formula (:func:`ltlf.positive_normal_form`).

    For others :class:`FormulaError`, with a note that points at the operator in ``text`` if that is given.
    """
    return ltlf.positive_normal_form(tree, text, ADVICE)


def check_names(tree: Formula, names: Iterable[str]) -> None:
    """Raise a FormulaError if a proposition of ``tree`` is not in ``names``, the regions of a map."""
    known = {*names, *clock_windows(tree.atoms)}
    for node in tree.walk():
        if node.word in known and node.op in ("true", "false"):
            raise FormulaError(
                f"'{node.word}' is the constant {node.op}, and a region of the map has this name: write "
                f'"{node.word}" in double quotes for the region, or {node.op} (column {node.column + 1})',
                node.column,
            )
        if node.op == "name" and node.name not in known:
            have = listed_text(map(ltlf.written_name, sorted(known)), 26)
            guess = difflib.get_close_matches(node.name, sorted(known), n=1, cutoff=0.5)
            hint = f"; did you mean {guess[0]!r}?" if guess else ""
            message = f"unknown region '{shown_text(node.name)}' in the formula: the map has {have}{hint}"
            raise FormulaError(f"{message} (column {node.column + 1})", node.column)
