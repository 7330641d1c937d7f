"""Automata in the Hanoi Omega-Automata (HOA) format, version 1.

Format: http://adl.github.io/hoaf/ and Babiak et al. (2015), doi:10.1007/978-3-319-21690-4_31. Written
automata are deterministic, complete and terminal: one Büchi-accepting state that is never left. Files of
other tools can be read (``ltl2tgba -D -B 'F(a & F b)' > mission.hoa``) if they are deterministic, with
state-based Büchi acceptance and accepting states that are never left.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pareto_ltl.logic import labels
from pareto_ltl.logic.automaton import Automaton, alphabet_of, automaton_from_table, letter_codes, show_letter
from pareto_ltl.logic.dfa import MAX_ENTRIES, TransitionTable
from pareto_ltl.logic.hoa_labels import LabelExpression, letters_of, sum_of_cubes
from pareto_ltl.logic.hoa_tokens import Token, Tokens
from pareto_ltl.support.arrays import BoolArray, IntArray
from pareto_ltl.support.errors import DataError
from pareto_ltl.support.messages import shown_text
from pareto_ltl.support.reading import SHOWN, Advice, read_text

MAX_HOA_BYTES = 2**23
MAX_LABEL_DEPTH = 200  # levels of brackets and negations in a label, including its aliases
MAX_ALIASES = 1000
MAX_LABEL_WORK = 2**32  # operators of all labels times letters, which takes a few seconds
MAX_DIGITS = 18  # of a number
HOA_FILES = Advice("check mission.automaton", "write it again, e.g. with ltl2tgba -D -B")


def hoa_text(automaton: Automaton) -> str:
    """The automaton as HOA text.

    If not all subsets of the propositions can occur, a header ``letters`` lists those that can, as bit sets
    over ``AP``; other tools ignore this header. The edges of letters that are not listed are arbitrary.
    """
    codes = letter_codes(automaton.atoms, automaton.letters)
    names = " ".join(labels.quoted_text(name) for name in automaton.atoms)
    lines = [
        "HOA: v1",
        f"name: {labels.quoted_text(automaton.formula)}",
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


def write_hoa(automaton: Automaton, path: str | Path) -> None:
    """Write the automaton to a ``.hoa`` file."""
    Path(path).write_text(hoa_text(automaton), encoding="utf-8")


def read_hoa(path: str | Path, letters: Iterable[Iterable[str]] | None = None) -> Automaton:
    """The minimal automaton of a HOA file over ``letters``.

    By default, ``letters`` come from the header ``letters`` of the file, else they are all subsets of its
    propositions. Raises a DataError if the file cannot be read or is not an automaton of a finite mission.
    """
    return parse_hoa(read_text(Path(path), HOA_FILES, MAX_HOA_BYTES), letters, str(path))


def read_atoms(path: str | Path) -> tuple[str, ...]:
    """The propositions of a HOA file, in its order."""
    return _HoaReader(read_text(Path(path), HOA_FILES, MAX_HOA_BYTES), str(path)).file().atoms


def parse_hoa(
    text: str, letters: Iterable[Iterable[str]] | None = None, source: str = "HOA text"
) -> Automaton:
    """Like :func:`read_hoa`, from text; ``source`` names it in errors."""
    file = _HoaReader(text, source).file()
    atoms = tuple(sorted(file.atoms))
    if letters is None and file.letters is not None:
        letters = [[name for i, name in enumerate(file.atoms) if code >> i & 1] for code in file.letters]
    alphabet = alphabet_of(atoms, letters)
    codes = letter_codes(file.atoms, alphabet)
    if (len(file.states) + 1) * len(codes) > MAX_ENTRIES:
        raise DataError(
            f"{source}: {len(file.states)} states x {len(codes)} letters are more than {MAX_ENTRIES}"
        )
    if file.operators * len(codes) > MAX_LABEL_WORK:
        raise DataError(
            f"{source}: labels with {file.operators} operators are too long for {len(codes)} letters; "
            "write them with aliases, or name fewer letters"
        )
    delta, accepting = _table_of_file(file, codes, alphabet)
    return automaton_from_table(TransitionTable(delta, accepting), alphabet, atoms, file.name or source)


# From the parsed file to a table


@dataclass
class _HoaState:
    line: int
    accepting: bool
    edges: list[tuple[LabelExpression, int, int]] = field(default_factory=list)  # label, target, line


@dataclass
class _HoaFile:
    source: str
    name: str = ""
    start: int = -1
    atoms: tuple[str, ...] = ()
    letters: list[int] | None = None
    states: dict[int, _HoaState] = field(default_factory=dict)
    operators: int = 0  # of all labels


def _table_of_file(
    file: _HoaFile, codes: IntArray, alphabet: tuple[frozenset[str], ...]
) -> tuple[IntArray, BoolArray]:
    """``delta`` and accepting states, with the start as state 0; the last state is a trap.

    Missing transitions lead to the trap. DataError if the automaton is not deterministic, or if an accepting
    state can be left.
    """
    order = [file.start, *(q for q in file.states if q != file.start)]
    number = {q: i for i, q in enumerate(order)}
    trap = len(order)
    delta = np.full((trap + 1, len(codes)), trap, np.int64)
    known: dict[int, BoolArray] = {}
    repeated: dict[int, BoolArray] = {}
    for q, state in file.states.items():
        row = delta[number[q]]
        for label, target, line in state.edges:
            takes = letters_of(label, codes, known, repeated)
            clash = takes & (row != trap) & (row != number[target])
            if clash.any():
                letter = shown_text(show_letter(alphabet[int(np.flatnonzero(clash)[0])]))
                raise DataError(
                    f"{file.source}, line {line}: state {q} has two ways on {letter}; expected a "
                    "deterministic automaton (ltl2tgba -D, autfilt -D)"
                )
            row[takes] = number[target]
    accepting = np.array([file.states[q].accepting for q in order] + [False])
    leaves = accepting[:, None] & ~accepting[delta]
    if leaves.any():
        i, column = (int(k) for k in np.argwhere(leaves)[0])
        raise DataError(
            f"{file.source}, line {file.states[order[i]].line}: accepting state {order[i]} can be left by "
            f"{shown_text(show_letter(alphabet[column]))}; a mission that a finite flight completes has "
            "accepting states that only lead to accepting states"
        )
    return delta, accepting


# Reading text


class _Label(NamedTuple):
    """A label of the body, which several edges can have, and its number of operators."""

    expression: LabelExpression
    operators: int


class _HoaReader:
    """Recursive-descent parser of one HOA text."""

    def __init__(self, text: str, source: str) -> None:
        self.tokens = Tokens(text, source)
        self.refuse = self.tokens.refuse
        self.aliases: dict[str, LabelExpression] = {}
        self.labels: dict[str, _Label] = {}  # by their text
        self.cubes: dict[str, LabelExpression] = {}
        self.result = _HoaFile(source)
        self.count: int | None = None
        self.brackets = 0

    @property
    def here(self) -> Token:
        return self.tokens.here

    def take(self, kind: str, what: str) -> Token:
        token = self.here
        if token.kind != kind:
            self.refuse(f"expected {what}, found {token.text[:SHOWN]}", token.line)
        self.tokens.advance()
        return token

    def sign(self, text: str) -> bool:
        """Consume the sign ``text`` if it is the next token; return whether it was."""
        found = self.tokens.here.kind == "sign" and self.tokens.here.text == text
        if found:
            self.tokens.advance()
        return found

    def close(self, text: str) -> None:
        if not self.sign(text):
            self.refuse(f"expected '{text}', found {self.here.text[:SHOWN]}", self.here.line)

    def number(self, what: str) -> int:
        token = self.take("int", what)
        if len(token.text) > MAX_DIGITS:
            self.refuse(f"{what} has {len(token.text)} digits; expected at most {MAX_DIGITS}", token.line)
        return int(token.text)

    # Header

    def file(self) -> _HoaFile:
        if self.here.text != "HOA:":
            self.refuse("not an automaton in HOA format: expected 'HOA: v1'", self.here.line)
        met: set[str] = set()
        while self.here.kind == "head":
            head = self.take("head", "a header")
            key = head.text[:-1]
            if key in met and key != "Alias":
                what = "several initial states; expected one" if key == "Start" else f"a second '{key}:'"
                self.refuse(what, head.line)
            met.add(key)
            self.header(key, head.line)
        for key in ("Start", "Acceptance"):
            if key not in met:
                self.refuse(f"the header '{key}:' is missing", self.here.line)
        if self.take("mark", "--BODY--").text != "--BODY--":
            self.refuse("expected --BODY--", self.here.line)
        self.body()
        return self.result

    def header(self, key: str, line: int) -> None:
        if key == "HOA":
            version = self.take("word", "a version").text
            if version != "v1":
                self.refuse(f"version {version} of the format; expected v1", line)
        elif key == "name":
            self.result.name = _unquoted_string(self.take("string", "a name in quotes").text)
        elif key == "States":
            self.count = self.number("a number of states")
        elif key == "Start":
            self.result.start = self.number("a state")
            self.no_universal()
        elif key == "AP":
            count = self.number("a number of propositions")
            names = [
                _unquoted_string(self.take("string", "a proposition in quotes").text) for _ in range(count)
            ]
            if len(set(names)) < count:
                self.refuse("a proposition is listed twice", line)
            self.result.atoms = tuple(names)
        elif key == "Alias":
            name = self.take("alias", "an alias").text
            self.aliases[name] = self.label_or()
            self.aliases[name].alias = True
            if len(self.aliases) > MAX_ALIASES:
                self.refuse(f"more than {MAX_ALIASES} aliases", line)
        elif key == "Acceptance":
            self.acceptance(line)
        elif key == "letters":
            self.result.letters = self.letter_codes(line)
        elif key[0].isupper():
            self.refuse(f"header '{key}:' changes the meaning and is not supported", line)
        else:
            self.skip()

    def letter_codes(self, line: int) -> list[int]:
        """The letters of the header ``letters``, as bit sets over the propositions of an earlier header."""
        codes = []
        while self.here.kind == "int":
            codes.append(self.number("a letter"))
        if any(code >> len(self.result.atoms) for code in codes):
            self.refuse(f"a letter has more bits than the {len(self.result.atoms)} propositions", line)
        return codes

    def skip(self, *kinds: str) -> list[str]:
        """Consume tokens up to the next header, or while they are of ``kinds`` if given; return the texts."""
        texts = []
        while self.here.kind not in ("head", "mark", "end") and (not kinds or self.here.kind in kinds):
            texts.append(self.here.text)
            self.tokens.advance()
        return texts

    def acceptance(self, line: int) -> None:
        condition = " ".join(self.skip())
        if condition.replace(" ", "") != "1Inf(0)":
            self.refuse(
                f"acceptance '{shown_text(condition)}'; expected Büchi, '1 Inf(0)' "
                "(ltl2tgba -B, autfilt -B): a mission is complete once an accepting state is reached",
                line,
            )

    def no_universal(self) -> None:
        if self.sign("&"):
            self.refuse(
                "universal branching (alternation); expected a deterministic automaton", self.here.line
            )

    # Body

    def body(self) -> None:
        while self.here.text == "State:":
            self.state()
        end = self.take("mark", "'State:', an edge or --END--")
        if end.text != "--END--":
            self.refuse(f"{end.text} instead of --END--: the automaton is not complete", end.line)
        if self.here.kind != "end":
            self.refuse("more than one automaton; expected one", self.here.line)
        self.check_targets(end.line)

    def check_targets(self, line: int) -> None:
        states = self.result.states
        if self.count is not None:
            if self.count > MAX_ENTRIES:
                self.refuse(f"{self.count} states; {MAX_ENTRIES} are the limit", line)
            for q in range(self.count):
                states.setdefault(q, _HoaState(line, False))
            if len(states) > self.count:
                self.refuse(
                    f"state {max(states)}, but 'States:' announces {self.count}", states[max(states)].line
                )
        for q, state in states.items():
            for _, target, where in state.edges:
                if target not in states:
                    self.refuse(f"state {q} leads to state {target}, which does not exist", where)
        if self.result.start not in states:
            self.refuse(f"the start {self.result.start} is not among the states", line)

    def state(self) -> None:
        line = self.take("head", "'State:'").line
        own = self.bracketed()
        q = self.number("a state")
        if self.here.kind == "string":
            self.tokens.advance()
        if q in self.result.states:
            self.refuse(f"state {q} occurs twice", line)
        state = self.result.states[q] = _HoaState(line, self.marks())
        while self.here.kind == "int" or (self.here.kind == "sign" and self.here.text == "["):
            where = self.here.line
            label = self.bracketed() or own
            if label is None:
                self.refuse(
                    "an edge without label; expected explicit labels (autfilt rewrites implicit ones)", where
                )
            target = self.number("a state")
            self.no_universal()
            if self.marks():
                self.refuse(
                    "transition-based acceptance; expected state-based (ltl2tgba -B, autfilt -B)", where
                )
            state.edges.append((label, target, where))

    def marks(self) -> bool:
        """Consume an acceptance signature ``{0}`` or ``{}``; return whether it was ``{0}``."""
        if not self.sign("{"):
            return False
        sets = [self.number("an acceptance set")] if self.here.kind == "int" else []
        if sets not in ([], [0]):
            self.refuse(f"acceptance set {sets[0]} does not exist", self.here.line)
        self.close("}")
        return bool(sets)

    def bracketed(self) -> LabelExpression | None:
        """The label in brackets that follows, None if there is none; each label text is parsed once."""
        if self.here != ("sign", "[", self.here.line):
            return None
        text = self.tokens.upcoming("]")
        known = self.labels.get(text)
        if known is not None:
            known.expression.repeated = True
            self.result.operators += known.operators
            self.tokens.skip(text)
            return known.expression
        before = self.result.operators
        label = sum_of_cubes(text, len(self.result.atoms), self.cubes)
        if label is not None:
            self.result.operators += 1 + sum(map(text.count, "&|!"))
            self.tokens.skip(text)
        else:
            self.tokens.advance()
            label = self.label_or()
            self.close("]")
        self.labels[text] = _Label(label, self.result.operators - before)
        return label

    def label_or(self) -> LabelExpression:
        parts = [self.label_and()]
        while self.sign("|"):
            parts.append(self.label_and())
        return parts[0] if len(parts) == 1 else self.bounded_label("|", *parts)

    def label_and(self) -> LabelExpression:
        parts = [self.label_not()]
        while self.sign("&"):
            parts.append(self.label_not())
        return parts[0] if len(parts) == 1 else self.bounded_label("&", *parts)

    def bounded_label(self, op: str, *parts: LabelExpression) -> LabelExpression:
        label = LabelExpression(op, parts)
        if label.depth > MAX_LABEL_DEPTH:
            self.refuse(f"a label nested deeper than {MAX_LABEL_DEPTH} levels", self.here.line)
        return label

    def label_not(self) -> LabelExpression:
        token = self.here
        self.result.operators += 1
        if token.text in ("!", "("):
            self.brackets += 1
            if self.brackets > MAX_LABEL_DEPTH:
                self.refuse(f"a label nested deeper than {MAX_LABEL_DEPTH} levels", token.line)
        if self.sign("!"):
            inner = self.bounded_label("!", self.label_not())
            self.brackets -= 1
            return inner
        if self.sign("("):
            inner = self.label_or()
            self.close(")")
            self.brackets -= 1
            return inner
        self.tokens.advance()
        if token.text in ("t", "f"):
            return LabelExpression(token.text)
        if token.kind == "alias" and token.text in self.aliases:
            return self.aliases[token.text]
        if token.kind == "int" and len(token.text) <= MAX_DIGITS and int(token.text) < len(self.result.atoms):
            return LabelExpression("ap", place=int(token.text))
        return self.refuse(
            f"{token.text[:SHOWN]} is not a label; expected t, f, a proposition's number or an alias",
            token.line,
        )


def _unquoted_string(text: str) -> str:
    return re.sub(r"\\(.)", r"\1", text[1:-1])
