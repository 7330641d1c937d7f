"""The deterministic automaton of a mission, which reads a flight letter by letter.

A letter is the set of propositions (regions) that hold at one step; the first letter is the label of the
start. A word is accepted if it is a *good prefix*: all its infinite continuations over the letters that can
occur satisfy the formula. Acceptance is final. Only the automaton of a tautology accepts the empty word.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from pareto_ltl.logic import dfa as tables
from pareto_ltl.logic.dfa import TransitionArray, TransitionTable
from pareto_ltl.logic.formula import Formula, parse_formula
from pareto_ltl.logic.normal_form import positive_normal_form
from pareto_ltl.logic.progression import Progression
from pareto_ltl.support.arrays import BoolArray, FloatArray, IntArray
from pareto_ltl.support.display import Displayed
from pareto_ltl.support.errors import FormulaError
from pareto_ltl.world.windows import Window, clock_windows

if TYPE_CHECKING:
    import networkx as nx

MAX_ATOMS = 62  # a letter is stored in the bits of an int64
MAX_FREE_ATOMS = 16  # subsets of more propositions do not fit into a table

Letter = frozenset[str]


@dataclass(frozen=True, eq=False, repr=False)
class Automaton(Displayed):
    """Minimal complete deterministic automaton of the good prefixes of a mission.

    States are numbered breadth first from 0 over the letters in their order, so that equal languages over
    equal letters give equal automata. ``==`` compares everything but the text of the formula.

    Attributes
    ----------
    delta : (Q, L) int
        State after each letter; stored as int32.
    letters : tuple of L frozensets of str
        The letters that can occur, by size, then by their sorted names.
    initial : int
        State before the first letter; 0.
    accepting : (Q,) bool
        States with a completed mission; at most one, and absorbing.
    distance : (Q,) float
        d_A, the smallest number of letters to acceptance; inf in the trap.
    atoms : tuple of str
        Propositions of the formula, sorted; letters ignore other names.
    formula : str
        Text of the mission.
    windows : mapping of proposition to Window
        The atoms that hold only for a limited time: time windows of the map, and clocks of the formula.
    forbidden : tuple of str
        Atoms with a window that end the mission in failure if they hold before it is complete.
    """

    delta: TransitionArray
    letters: tuple[Letter, ...]
    initial: int
    accepting: BoolArray
    distance: FloatArray
    atoms: tuple[str, ...]
    formula: str
    windows: Mapping[str, Window] = field(default_factory=dict)
    forbidden: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "delta", np.ascontiguousarray(self.delta, np.int32))
        states, letters = self.delta.shape
        if len(self.letters) != letters or len(set(self.letters)) != letters:
            raise ValueError(f"letters must be {letters} different sets, as many as delta has columns")
        if self.accepting.shape != (states,) or self.distance.shape != (states,):
            raise ValueError(f"accepting and distance must have shape ({states},)")
        if self.delta.view(np.uint32).max() >= states:  # also if one is negative
            raise ValueError(f"delta must name states 0..{states - 1}")
        if not 0 <= self.initial < states:
            raise ValueError(f"initial must be one of the states 0..{states - 1}, got {self.initial}")
        if not self.accepting[self.delta[self.accepting]].all():
            raise ValueError("accepting states must be absorbing")

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

    def to_hoa(self) -> str:
        """The automaton in the Hanoi omega-automata format, version 1."""
        from pareto_ltl.logic.hoa import hoa_text

        return hoa_text(self)

    @property
    def n_states(self) -> int:
        """Q, the number of states."""
        return len(self.delta)

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

    @cached_property
    def trap(self) -> int:
        """The state from which no word is accepted; -1 if there is none."""
        lost = np.flatnonzero(np.isinf(self.distance))
        return int(lost[0]) if len(lost) else -1

    @cached_property
    def preorder(self) -> BoolArray:
        """p >= q as an array (Q, Q): ``[p, q]`` is True if L_q is a subset of L_p.

        Then p is at least as close to a completed mission as q.
        """
        return tables.language_inclusion(self.delta, self.distance)

    @property
    def tautology(self) -> bool:
        """Whether the empty word completes the mission."""
        return bool(self.accepting[self.initial])

    @property
    def contradiction(self) -> bool:
        """Whether no word completes the mission."""
        return bool(np.isinf(self.distance[self.initial]))

    def edge_labels(self) -> dict[tuple[int, int], str]:
        """Label of each edge (from, to): its letters, or ``!(other letters)`` if that text is shorter."""
        from pareto_ltl.logic.labels import edge_labels

        return edge_labels(self)

    def harm(self) -> tuple[int, int] | None:
        """A state and a letter that leads to a state which does not cover it; None if there is none."""
        preserved = self.preorder[self.delta, np.arange(self.n_states)[:, None]]
        bad = np.argwhere(~preserved)
        return (int(bad[0][0]), int(bad[0][1])) if len(bad) else None

    def letter_index(self, letter: Iterable[str]) -> int:
        """Column of a letter, a set of names; names that are not in the formula are ignored."""
        seen = self._seen(letter)
        column = self._columns.get(seen)
        if column is None:
            raise ValueError(
                f"letter {show_letter(seen)} is none of the {len(self.letters)} that this automaton was made "
                f"for ({_list_letters(self.letters)}); pass it in `letters` when you translate"
            )
        return column

    def step(self, state: int, letter: Iterable[str]) -> int:
        """State after reading ``letter`` in ``state``."""
        return int(self.delta[state, self.letter_index(letter)])

    def accepts(self, word: Iterable[Iterable[str]]) -> bool:
        """Whether ``word``, a sequence of sets of names, is a good prefix."""
        state = self.initial
        for letter in word:
            state = self.step(state, letter)
        return bool(self.accepting[state])

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Automaton):
            return NotImplemented
        return (
            (self.atoms, self.letters, self.initial) == (other.atoms, other.letters, other.initial)
            and np.array_equal(self.delta, other.delta)
            and np.array_equal(self.accepting, other.accepting)
            and (self.windows, self.forbidden) == (other.windows, other.forbidden)
        )

    def __hash__(self) -> int:
        return hash((self.atoms, self.letters, self.initial, self.delta.tobytes()))

    def facts(self) -> Mapping[str, str]:
        """Formula, numbers of states and letters, and the length of the shortest mission."""
        nearest = self.distance[self.initial]
        return {
            "formula": self.formula,
            "states": f"{self.n_states}",
            "letters": f"{len(self.letters)}",
            "shortest mission": "none" if np.isinf(nearest) else f"{nearest:.0f} letters",
        }

    @cached_property
    def _columns(self) -> Mapping[Letter, int]:
        return {letter: i for i, letter in enumerate(self.letters)}

    def _seen(self, letter: Iterable[str]) -> Letter:
        if isinstance(letter, str):
            raise ValueError(f"a letter is a set of names, not the text {letter!r}: write {{{letter!r}}}")
        return frozenset(letter).intersection(self.atoms)


def translate(
    formula: str | Formula, letters: Iterable[Iterable[str]] | None = None, max_states: int = 10_000
) -> Automaton:
    """The minimal automaton of a syntactically co-safe formula.

    Parameters
    ----------
    formula : str or Formula
        Text, or a tree of :func:`pareto_ltl.logic.parse_formula`.
    letters : iterable of sets of names, optional
        The labels that can occur; default: all subsets of the propositions. Fewer letters, e.g. of
        disjoint regions, give smaller automata.
    max_states : int
        Limit of the number of states, also of intermediate automata.

    Raises
    ------
    FormulaError
        If the text has a syntax error, is not co-safe, or has too many states. ``column`` is the position in
        the text. A contradiction is not an error: see ``Automaton.contradiction``.
    """
    text = str(formula)
    tree = parse_formula(formula) if isinstance(formula, str) else formula
    normal = positive_normal_form(tree, formula if isinstance(formula, str) else "")
    atoms = tuple(sorted({*tree.atoms, *normal.atoms}))
    alphabet = alphabet_of(atoms, letters)
    codes = letter_codes(atoms, alphabet)
    progression = Progression(atoms, max_states)
    (delta, accepting), distance = progression.table(progression.read(normal), codes)
    return Automaton(delta, alphabet, 0, accepting, distance, atoms, text)


def automaton_from_table(
    table: TransitionTable, alphabet: tuple[Letter, ...], atoms: tuple[str, ...], text: str
) -> Automaton:
    """The minimal automaton of a complete transition table with initial state 0."""
    (delta, accepting), distance = tables.minimal_table(table)
    return Automaton(delta, alphabet, 0, accepting, distance, atoms, text)


def alphabet_of(atoms: tuple[str, ...], letters: Iterable[Iterable[str]] | None) -> tuple[Letter, ...]:
    """The letters restricted to ``atoms``, without repetitions, by size, then by their sorted names."""
    if len(atoms) > MAX_ATOMS:
        raise FormulaError(f"the mission has {len(atoms)} propositions; {MAX_ATOMS} are the limit")
    if letters is None:
        if len(atoms) > MAX_FREE_ATOMS:
            raise FormulaError(
                f"{len(atoms)} propositions have 2^{len(atoms)} letters; pass only the letters that can "
                f"occur ({MAX_FREE_ATOMS} propositions are the limit without)"
            )
        return tuple(
            [frozenset(c) for size in range(len(atoms) + 1) for c in combinations(sorted(atoms), size)]
        )
    seen = {frozenset(letter).intersection(atoms) for letter in letters}
    if not seen:
        raise ValueError("letters is empty: a flight shows at least one label set")
    return tuple(sorted(seen, key=lambda letter: (len(letter), sorted(letter))))


def letter_codes(atoms: tuple[str, ...], alphabet: Iterable[Letter]) -> IntArray:
    """Letters as bit sets, bit i for ``atoms[i]``, shape (L,)."""
    place = {name: 1 << i for i, name in enumerate(atoms)}
    return np.array([sum(map(place.__getitem__, letter)) for letter in alphabet], np.int64)


def show_letter(letter: Iterable[str]) -> str:
    """A letter as text, e.g. ``{a, b}``."""
    return f"{{{', '.join(sorted(letter))}}}"


def _list_letters(letters: tuple[Letter, ...], limit: int = 6) -> str:
    shown = [show_letter(letter) for letter in letters[:limit]]
    return ", ".join(shown + ["..."] * (len(letters) > limit))
