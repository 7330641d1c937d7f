"""The automaton of a mission, which reads a flight letter by letter.

A letter is the set of propositions (regions) that hold at one step; the first letter is the label of the
start. A flight is accepted if it completes the mission whatever follows (:class:`ltlf.Dfa`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Self

import numpy as np

import ltlf
from ltlf import Dfa, Formula, Letter, TransitionTable
from pareto_ltl.logic.formula import ADVICE, planner_errors
from pareto_ltl.support.display import Displayed
from pareto_ltl.world.windows import Window, clock_windows

if TYPE_CHECKING:
    import networkx as nx


@dataclass(frozen=True, eq=False, repr=False)
class Automaton(Displayed, Dfa):
    """Minimal complete deterministic automaton of the good prefixes of a mission, with its time windows.

    ``==`` compares everything but the text of the formula.

    Attributes
    ----------
    delta, letters, initial, accepting, distance, atoms, formula
        As of :class:`ltlf.Dfa`: ``delta`` (Q, L) is the state after each letter; ``distance`` (Q,) is d_A.
    windows : mapping of proposition to Window
        The atoms that hold only for a limited time: time windows of the map, and clocks of the formula.
    forbidden : tuple of str
        Atoms with a window that end the mission in failure if they hold before it is complete.
    """

    windows: Mapping[str, Window] = field(default_factory=dict)
    forbidden: tuple[str, ...] = ()

    @classmethod
    def of(cls, dfa: Dfa) -> Self:
        """The automaton of a mission without time windows."""
        return cls(dfa.delta, dfa.letters, dfa.initial, dfa.accepting, dfa.distance, dfa.atoms, dfa.formula)

    def after(self, state: int, moment: float = 0.0) -> Automaton:
        """The automaton of the rest of the mission from ``state``, for a flight that departs at ``moment``.

        From a new initial state every letter leads to ``state``, since the label at the position of departure
        was already read. ``moment`` is in [s after the first departure]; time windows then count from there.
        """
        delta = np.vstack([np.full((1, len(self.letters)), state), self.delta]).astype(np.int64) + 1
        accepting = np.concatenate([[False], self.accepting])
        table = TransitionTable(delta, accepting)
        rest = automaton_from_table(table, self.letters, self.atoms, f"the rest of {self.formula}")
        windows = {name: window.later(moment) for name, window in self.windows.items()}
        return replace(rest, windows=windows, forbidden=self.forbidden)

    def to_hoa(self, tool: str = "pareto_ltl") -> str:
        """The automaton in the Hanoi omega-automata format, version 1; ``tool`` is who writes it."""
        return super().to_hoa(tool)

    @property
    def clocks(self) -> dict[str, Window]:
        """The windows of the propositions that are clocks, by their names."""
        return clock_windows(self.atoms)

    @cached_property
    def graph(self) -> nx.DiGraph:
        """The states as nodes, with ``distance`` and ``accepting``, and their transitions as edges."""
        import networkx as nx

        graph = nx.DiGraph()
        for q in range(self.n_states):
            graph.add_node(q, distance=float(self.distance[q]), accepting=bool(self.accepting[q]))
        graph.add_edges_from((q, after) for q, row in enumerate(self.delta.tolist()) for after in row)
        return graph

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Automaton):
            return NotImplemented
        return super().__eq__(other) and (self.windows, self.forbidden) == (other.windows, other.forbidden)

    __hash__ = Dfa.__hash__

    def facts(self) -> Mapping[str, str]:
        """Formula, numbers of states and letters, and the length of the shortest mission."""
        nearest = self.distance[self.initial]
        return {
            "formula": self.formula,
            "states": f"{self.n_states}",
            "letters": f"{len(self.letters)}",
            "shortest mission": "none" if np.isinf(nearest) else f"{nearest:.0f} letters",
        }


@planner_errors()
def translate(
    formula: str | Formula, letters: Iterable[Iterable[str]] | None = None, max_states: int = 10_000
) -> Automaton:
    """The minimal automaton of a syntactically co-safe formula; see :func:`ltlf.translate`.

    Raises
    ------
    FormulaError
        If the text has a syntax error, is not co-safe, or has too many states. ``column`` is the position in
        the text. A contradiction is not an error: see ``Automaton.contradiction``.
    """
    return Automaton.of(ltlf.translate(formula, letters, max_states, ADVICE))


def automaton_from_table(
    table: TransitionTable, alphabet: tuple[Letter, ...], atoms: tuple[str, ...], text: str
) -> Automaton:
    """The minimal automaton of a complete transition table with initial state 0."""
    return Automaton.of(ltlf.minimal_dfa(table, alphabet, atoms, text))


@planner_errors()
def alphabet_of(atoms: tuple[str, ...], letters: Iterable[Iterable[str]] | None) -> tuple[Letter, ...]:
    """The letters restricted to ``atoms``, without repetitions, by size, then by their sorted names."""
    return ltlf.alphabet_of(atoms, letters)
