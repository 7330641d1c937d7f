"""Automata in the Hanoi Omega-Automata (HOA) format, version 1.

Format: http://adl.github.io/hoaf/ and Babiak et al. (2015), doi:10.1007/978-3-319-21690-4_31. Written
automata are deterministic, complete and terminal: one Büchi-accepting state that is never left. Files of
other tools can be read (``ltl2tgba -D -B 'F(a & F b)' > mission.hoa``) if they are deterministic, with
state-based Büchi acceptance and accepting states that are never left.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple, NoReturn

import numpy as np

from careful_io.messages import shown_line, shown_text
from careful_io.reading import SHOWN, Advice, read_text
from pareto_ltl.extend import (
    Automaton,
    AutomatonFormats,
    TransitionTable,
    alphabet_of,
    automaton_from_table,
    letter_codes,
    show_letter,
)
from pareto_ltl.support.arrays import BoolArray, IntArray
from pareto_ltl.support.errors import DataError
from pareto_ltl_apps.formats import hoa_labels

MAX_HOA_BYTES = 2**23
MAX_ALIASES = 1000
MAX_ENTRIES = 2**24  # states x letters; 128 MiB as int64
MAX_DIGITS = 18  # of a number
HOA_FILES = Advice("check mission.automaton", "write it again, e.g. with ltl2tgba -D -B")

STRING = r'"(?:[^"\\]|\\.)*"'
TOKEN = re.compile(
    rf"\s+|(?P<string>{STRING})|(?P<mark>--(?:BODY|END|ABORT)--)|(?P<head>[A-Za-z_][\w-]*:)"
    r"|(?P<label>\[[^][]*\])|(?P<alias>@[\w-]+)|(?P<int>\d+)|(?P<word>[A-Za-z_][\w-]*)"
    r"|(?P<sign>[][{}()!&|])|(?P<other>.)",
    re.DOTALL,
)
COMMENT_PARTS = re.compile(rf'{STRING}|/\*|\*/|[^"/*\n]+|.|\n')


def read_hoa(path: str | Path, letters: Iterable[Iterable[str]] | None = None) -> Automaton:
    """The minimal automaton of a HOA file over ``letters``.

    By default, ``letters`` come from the header ``letters`` of the file, else they are all subsets of its
    propositions. Raises a DataError if the file cannot be read or is not an automaton of a finite mission.
    """
    return parse_hoa(read_text(Path(path), HOA_FILES, MAX_HOA_BYTES), letters, str(path))


def read_atoms(path: str | Path) -> tuple[str, ...]:
    """The propositions of a HOA file, in its order."""
    return _HoaReader(read_text(Path(path), HOA_FILES, MAX_HOA_BYTES), str(path)).atoms


def parse_hoa(
    text: str, letters: Iterable[Iterable[str]] | None = None, source: str = "HOA text"
) -> Automaton:
    """Like :func:`read_hoa`, from text; ``source`` names it in errors."""
    reader = _HoaReader(text, source)
    atoms = tuple(sorted(reader.atoms))
    if letters is None and reader.letters is not None:
        letters = [[name for i, name in enumerate(reader.atoms) if code >> i & 1] for code in reader.letters]
    alphabet = alphabet_of(atoms, letters)
    table = _BodyReader(reader, alphabet).table()
    return automaton_from_table(table, alphabet, atoms, reader.name or source)


# --- tokens ---------------------------------------------------------------------------------------


class _Token(NamedTuple):
    """``kind`` is a group of ``TOKEN``, or ``end``."""

    kind: str
    text: str
    line: int


def _tokens(text: str) -> Iterator[_Token]:
    line = 1
    for match in TOKEN.finditer(text):
        if match.lastgroup:
            yield _Token(match.lastgroup, match[0], line)
        line += match[0].count("\n")
    while True:
        yield _Token("end", "the end of the file", line)


def _without_comments(text: str) -> str:
    """``text`` without (nested) comments; line breaks are kept for the line numbers of errors."""
    if "/*" not in text:
        return text
    outside, depth = [], 0
    for part in COMMENT_PARTS.findall(text):
        depth += part == "/*"
        if depth == 0 or part == "\n":
            outside.append(part)
        depth = max(0, depth - (part == "*/"))
    return "".join(outside)


class _HoaReader:
    """Reads the header at once, and the tokens of the body one after another; ``here`` is the next one."""

    def __init__(self, text: str, source: str) -> None:
        self.source, self.tokens = source, _tokens(_without_comments(text))
        self.name, self.start = "", -1
        self.count: int | None = None
        self.atoms: tuple[str, ...] = ()
        self.letters: list[int] | None = None
        self.aliases: list[tuple[str, str, int]] = []  # name, label, line
        self.advance()
        self._header()

    def refuse(self, reason: str, line: int | None = None) -> NoReturn:
        """Raise :class:`DataError` with the file, the line (of the next token by default) and the reason."""
        raise DataError(shown_line(f"{self.source}, line {line or self.here.line}: {reason}"))

    def advance(self) -> None:
        """Go to the next token; the last one is ``end``, which repeats."""
        self.here = next(self.tokens)
        if self.here.kind == "other":
            self.refuse(f"'{self.here.text}' has no meaning here")

    def take(self, kind: str, what: str) -> _Token:
        """The next token, which must be of this ``kind``; ``what`` names it in errors."""
        token = self.here
        if token.kind != kind:
            self.refuse(f"expected {what}, found {token.text[:SHOWN]}")
        self.advance()
        return token

    def sign(self, text: str) -> bool:
        """Consume the sign ``text`` if it is the next token; return whether it was."""
        found = self.here.kind == "sign" and self.here.text == text
        if found:
            self.advance()
        return found

    def number(self, what: str) -> int:
        """The next token, which must be a number."""
        token = self.take("int", what)
        if len(token.text) > MAX_DIGITS:
            self.refuse(f"{what} has {len(token.text)} digits; expected at most {MAX_DIGITS}", token.line)
        return int(token.text)

    def string(self, what: str) -> str:
        """The content of the next token, which must be in quotes."""
        return re.sub(r"\\(.)", r"\1", self.take("string", what).text[1:-1])

    def no_universal(self) -> None:
        """Refuse several targets at once."""
        if self.sign("&"):
            self.refuse("universal branching (alternation); expected a deterministic automaton")

    def _header(self) -> None:
        if self.here.text != "HOA:":
            self.refuse("not an automaton in HOA format: expected 'HOA: v1'")
        met: set[str] = set()
        while self.here.kind == "head":
            head = self.take("head", "a header")
            key = head.text[:-1]
            if key in met and key != "Alias":
                what = "several initial states; expected one" if key == "Start" else f"a second '{key}:'"
                self.refuse(what, head.line)
            met.add(key)
            self._value(key, head.line)
        for key in ("Start", "Acceptance"):
            if key not in met:
                self.refuse(f"the header '{key}:' is missing")
        if self.take("mark", "--BODY--").text != "--BODY--":
            self.refuse("expected --BODY--")

    def _value(self, key: str, line: int) -> None:
        if key == "HOA":
            version = self.take("word", "a version").text
            if version != "v1":
                self.refuse(f"version {version} of the format; expected v1", line)
        elif key == "name":
            self.name = self.string("a name in quotes")
        elif key == "States":
            self.count = self.number("a number of states")
        elif key == "Start":
            self.start = self.number("a state")
            self.no_universal()
        elif key == "AP":
            count = self.number("a number of propositions")
            self.atoms = tuple([self.string("a proposition in quotes") for _ in range(count)])
            if len(set(self.atoms)) < count:
                self.refuse("a proposition is listed twice", line)
        elif key == "Alias":
            self.aliases.append((self.take("alias", "an alias").text, self._rest(), line))
            if len(self.aliases) > MAX_ALIASES:
                self.refuse(f"more than {MAX_ALIASES} aliases", line)
        elif key == "Acceptance":
            self._acceptance(line)
        elif key == "letters":
            self.letters = self._letter_codes(line)
        elif key[0].isupper():
            self.refuse(f"header '{key}:' changes the meaning and is not supported", line)
        else:
            self._rest()

    def _acceptance(self, line: int) -> None:
        condition = self._rest()
        if condition.replace(" ", "") != "1Inf(0)":
            self.refuse(
                f"acceptance '{shown_text(condition)}'; expected Büchi, '1 Inf(0)' "
                "(ltl2tgba -B, autfilt -B): a mission is complete once an accepting state is reached",
                line,
            )

    def _letter_codes(self, line: int) -> list[int]:
        """The letters of the header ``letters``, as bit sets over the propositions of an earlier header."""
        codes = []
        while self.here.kind == "int":
            codes.append(self.number("a letter"))
        if any(code >> len(self.atoms) for code in codes):
            self.refuse(f"a letter has more bits than the {len(self.atoms)} propositions", line)
        return codes

    def _rest(self) -> str:
        """The texts of all tokens up to the next header, with a space between them."""
        texts = []
        while self.here.kind not in ("head", "mark", "end"):
            texts.append(self.here.text)
            self.advance()
        return " ".join(texts)


# --- body -----------------------------------------------------------------------------------------


class _BodyReader:
    """Reads the states and edges of a file into a table over the letters of ``alphabet``.

    ``number`` numbers the states of the file from 0, the start first; ``rows`` has the number of the state
    after each letter, -1 for letters without an edge; ``targets`` has the state and the line of the first
    edge to each state.
    """

    def __init__(self, reader: _HoaReader, alphabet: tuple[frozenset[str], ...]) -> None:
        self.reader, self.alphabet, self.refuse = reader, alphabet, reader.refuse
        codes = letter_codes(reader.atoms, alphabet)
        self.labels = hoa_labels.LabelReader(codes, len(reader.atoms), reader.refuse)
        for name, text, line in reader.aliases:
            self.labels.define(name, text, line)
        self.number = {reader.start: 0}
        self.rows: dict[int, IntArray] = {}
        self.lines: dict[int, int] = {}
        self.accepting: set[int] = set()
        self.targets: dict[int, tuple[int, int]] = {}

    def table(self) -> TransitionTable:
        """The table with the start as state 0; the last state is a trap, to which missing transitions lead.

        DataError if the automaton is not deterministic, or if an accepting state can be left.
        """
        read = self.reader
        while read.here.text == "State:":
            self._state()
        end = read.take("mark", "'State:', an edge or --END--")
        if end.text != "--END--":
            self.refuse(f"{end.text} instead of --END--: the automaton is not complete", end.line)
        if read.here.kind != "end":
            self.refuse("more than one automaton; expected one")
        self._check_states(end.line)
        delta = np.array([*(self.rows[q] for q in self.number), np.full(len(self.alphabet), -1)])
        delta[delta < 0] = len(self.number)
        accepting = np.array([*(q in self.accepting for q in self.number), False])
        self._check_acceptance(delta, accepting)
        return TransitionTable(delta, accepting)

    def _check_states(self, line: int) -> None:
        read, count = self.reader, self.reader.count
        if count is not None:
            if count > MAX_ENTRIES:
                self.refuse(f"{count} states; {MAX_ENTRIES} are the limit", line)
            self._check_size(max(count, len(self.rows)))
            for q in range(count):
                if q not in self.rows:
                    self._new_row(q, line)
            if len(self.rows) > count:
                last = max(self.rows)
                self.refuse(f"state {last}, but 'States:' announces {count}", self.lines[last])
        for target, (q, where) in self.targets.items():
            if target not in self.rows:
                self.refuse(f"state {q} leads to state {target}, which does not exist", where)
        if read.start not in self.rows:
            self.refuse(f"the start {read.start} is not among the states", line)

    def _check_size(self, states: int) -> None:
        if (states + 1) * len(self.alphabet) > MAX_ENTRIES:
            raise DataError(
                f"{self.reader.source}: {states} states x {len(self.alphabet)} letters are more than "
                f"{MAX_ENTRIES}"
            )

    def _check_acceptance(self, delta: IntArray, accepting: BoolArray) -> None:
        leaves = accepting[:, None] & ~accepting[delta]
        if leaves.any():
            i, column = (int(k) for k in np.argwhere(leaves)[0])
            q = list(self.number)[i]
            self.refuse(
                f"accepting state {q} can be left by {self._letter(column)}; a mission that a finite "
                "flight completes has accepting states that only lead to accepting states",
                self.lines[q],
            )

    def _state(self) -> None:
        read = self.reader
        line = read.take("head", "'State:'").line
        own = self._label()
        q = read.number("a state")
        if read.here.kind == "string":
            read.advance()
        if q in self.rows:
            self.refuse(f"state {q} occurs twice", line)
        self._check_size(len(self.rows) + 1)
        row = self._new_row(q, line)
        if self._mark():
            self.accepting.add(q)
        while read.here.kind in ("int", "label"):
            where = read.here.line
            takes = own if read.here.kind == "int" else self._label()
            if takes is None:
                self.refuse(
                    "an edge without label; expected explicit labels (autfilt rewrites implicit ones)"
                )
            target = read.number("a state")
            read.no_universal()
            if self._mark():
                self.refuse(
                    "transition-based acceptance; expected state-based (ltl2tgba -B, autfilt -B)", where
                )
            i = self._number_of(target)
            clash = takes & (row >= 0) & (row != i)
            if clash.any():
                self.refuse(
                    f"state {q} has two ways on {self._letter(int(np.flatnonzero(clash)[0]))}; expected a "
                    "deterministic automaton (ltl2tgba -D, autfilt -D)",
                    where,
                )
            row[takes] = i
            self.targets.setdefault(target, (q, where))

    def _number_of(self, q: int) -> int:
        return self.number.setdefault(q, len(self.number))

    def _new_row(self, q: int, line: int) -> IntArray:
        self._number_of(q)
        self.lines[q] = line
        self.rows[q] = np.full(len(self.alphabet), -1)
        return self.rows[q]

    def _letter(self, column: int) -> str:
        return shown_text(show_letter(self.alphabet[column]))

    def _label(self) -> BoolArray | None:
        """The letters of the label that follows; None if there is none."""
        token = self.reader.here
        if token.kind != "label":
            return None
        self.reader.advance()
        return self.labels.letters_of(token.text[1:-1], token.line)

    def _mark(self) -> bool:
        """Consume an acceptance signature ``{0}`` or ``{}``; return whether it was ``{0}``."""
        read = self.reader
        if not read.sign("{"):
            return False
        sets = [read.number("an acceptance set")] if read.here.kind == "int" else []
        if sets not in ([], [0]):
            self.refuse(f"acceptance set {sets[0]} does not exist")
        if not read.sign("}"):
            self.refuse(f"expected '}}', found {read.here.text[:SHOWN]}")
        return bool(sets)


FORMATS = AutomatonFormats(read_hoa, read_atoms)
