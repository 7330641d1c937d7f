"""The deterministic automaton of a formula, which reads a word letter by letter.

A letter is the set of propositions that hold at one step. A word is accepted if it is a *good prefix*: all
its infinite continuations over the letters that can occur satisfy the formula. Acceptance is final. Only the
automaton of a tautology accepts the empty word.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np

from ltlf import dfa as tables
from ltlf.advice import PLAIN_ADVICE, Advice
from ltlf.dfa import BoolArray, FloatArray, IntArray, TransitionArray, TransitionTable
from ltlf.errors import FormulaError, StatesError
from ltlf.formula import Formula, parse_formula
from ltlf.normal_form import positive_normal_form
from ltlf.progression import Progression

MAX_ATOMS = 62  # a letter is stored in the bits of an int64
MAX_FREE_ATOMS = 16  # subsets of more propositions do not fit into a table

Letter = frozenset[str]


@dataclass(frozen=True, eq=False, repr=False)
class Dfa:
    """Minimal complete deterministic automaton of the good prefixes of a formula.

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
        States in which the formula is satisfied; at most one, and absorbing.
    distance : (Q,) float
        d_A, the smallest number of letters to acceptance; inf in the trap.
    atoms : tuple of str
        Propositions of the formula, sorted; letters ignore other names.
    formula : str
        Text of the formula.
    """

    delta: TransitionArray
    letters: tuple[Letter, ...]
    initial: int
    accepting: BoolArray
    distance: FloatArray
    atoms: tuple[str, ...]
    formula: str

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

    def __repr__(self) -> str:
        return f"Dfa(formula {self.formula}, states {self.n_states}, letters {len(self.letters)})"

    def to_hoa(self, tool: str = "ltlf") -> str:
        """The automaton in the Hanoi omega-automata format, version 1; ``tool`` is who writes it."""
        from ltlf.hoa import hoa_text

        return hoa_text(self, tool)

    @property
    def n_states(self) -> int:
        """Q, the number of states."""
        return len(self.delta)

    @cached_property
    def trap(self) -> int:
        """The state from which no word is accepted; -1 if there is none."""
        lost = np.flatnonzero(np.isinf(self.distance))
        return int(lost[0]) if len(lost) else -1

    @cached_property
    def preorder(self) -> BoolArray:
        """p >= q as an array (Q, Q): ``[p, q]`` is True if L_q is a subset of L_p.

        Then p is at least as close to acceptance as q.
        """
        return tables.language_inclusion(self.delta, self.distance)

    @property
    def tautology(self) -> bool:
        """Whether the empty word satisfies the formula."""
        return bool(self.accepting[self.initial])

    @property
    def contradiction(self) -> bool:
        """Whether no word satisfies the formula."""
        return bool(np.isinf(self.distance[self.initial]))

    def edge_labels(self) -> dict[tuple[int, int], str]:
        """Label of each edge (from, to): its letters, or ``!(other letters)`` if that text is shorter."""
        from ltlf.labels import edge_labels

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
        if not isinstance(other, Dfa):
            return NotImplemented
        return (
            (self.atoms, self.letters, self.initial) == (other.atoms, other.letters, other.initial)
            and np.array_equal(self.delta, other.delta)
            and np.array_equal(self.accepting, other.accepting)
        )

    def __hash__(self) -> int:
        return hash((self.atoms, self.letters, self.initial, self.delta.tobytes()))

    @cached_property
    def _columns(self) -> Mapping[Letter, int]:
        return {letter: i for i, letter in enumerate(self.letters)}

    def _seen(self, letter: Iterable[str]) -> Letter:
        if isinstance(letter, str):
            raise ValueError(f"a letter is a set of names, not the text {letter!r}: write {{{letter!r}}}")
        return frozenset(letter).intersection(self.atoms)


def translate(
    formula: str | Formula,
    letters: Iterable[Iterable[str]] | None = None,
    max_states: int = 10_000,
    advice: Advice = PLAIN_ADVICE,
) -> Dfa:
    """The minimal automaton of a syntactically co-safe formula.

    Parameters
    ----------
    formula : str or Formula
        Text, or a tree of :func:`ltlf.parse_formula`.
    letters : iterable of sets of names, optional
        The letters that can occur; default: all subsets of the propositions. Fewer letters, e.g. of
        propositions that exclude each other, give smaller automata.
    max_states : int
        Limit of the number of states, also of intermediate automata.
    advice : Advice
        What error messages recommend.

    Raises
    ------
    FormulaError
        If the text has a syntax error, is not co-safe, or has too many states. ``column`` is the position in
        the text. A contradiction is not an error: see ``Dfa.contradiction``.
    """
    text = str(formula)
    tree = parse_formula(formula, advice) if isinstance(formula, str) else formula
    normal = positive_normal_form(tree, formula if isinstance(formula, str) else "", advice)
    atoms = tuple(sorted({*tree.atoms, *normal.atoms}))
    alphabet = alphabet_of(atoms, letters)
    codes = letter_codes(atoms, alphabet)
    progression = Progression(atoms, max_states)
    try:
        (delta, accepting), distance = progression.table(progression.read(normal), codes)
    except StatesError:
        raise StatesError(max_states, advice.states) from None
    return Dfa(delta, alphabet, 0, accepting, distance, atoms, text)


def minimal_dfa(
    table: TransitionTable, alphabet: tuple[Letter, ...], atoms: tuple[str, ...], text: str
) -> Dfa:
    """The minimal automaton of a complete transition table with initial state 0."""
    (delta, accepting), distance = tables.minimal_table(table)
    return Dfa(delta, alphabet, 0, accepting, distance, atoms, text)


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
