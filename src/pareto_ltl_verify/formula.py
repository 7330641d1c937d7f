"""Formulas, automata and the times of propositions, read and compared without the planner's code.

A co-safe formula is rewritten letter by letter: after a letter, the rest of the formula is a set of
alternatives, each a set of subformulas that must all hold from the next letter on. A word completes the
mission if every infinite word after it leads to a rest with an empty alternative.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any
from unicodedata import normalize

import numpy as np

from careful_io.errors import DataError
from careful_io.names import QUOTED
from pareto_ltl_verify.arrays import BoolArray, FloatArray

Label = frozenset[str]
Window = tuple[str | None, float, float]  # region or None, first and last moment [s after departure]
Node = tuple[Any, ...]  # (operator, argument, ...); a proposition is ("ap", name)
Rest = frozenset[frozenset[Node]]  # alternatives of obligations

TOUCH = 1e-6  # [s] windows are wider by this at both ends, against rounding
MAX_RESTS = 50_000  # limit of the number of different rests of a formula; a formula with more is an error
DONE: Rest = frozenset({frozenset()})
NEVER: Rest = frozenset()

WORDS = {
    **dict.fromkeys(("~", "not", "NOT", "¬", "∼", "˜", "\\lnot", "\\neg"), "!"),
    **dict.fromkeys(("next", "○", "◯", "∘", "⃝", "\\bigcirc", "\\circ", "\\Circle"), "X"),
    **dict.fromkeys(("eventually", "finally", "<>", *"◇♢⋄◊⬦"), "F"),
    **dict.fromkeys(("\\Diamond", "\\diamond", "\\lozenge", "\\Finally", "\\Eventually"), "F"),
    **dict.fromkeys(
        ("[]", "always", "globally", *"□◻☐⬜▢", "\\Box", "\\square", "\\Globally", "\\Always"), "G"
    ),
    **dict.fromkeys(("until", "\\until", "\\Until"), "U"),
    **dict.fromkeys(("release", "\\release", "\\Release"), "R"),
    **dict.fromkeys(("&&", "and", "AND", "/\\", "∧", "⋀", "\\land", "\\wedge", "\\bigwedge"), "&"),
    **dict.fromkeys(("||", "or", "\\/", "∨", "⋁", "\\lor", "\\vee", "\\bigvee"), "|"),
    **dict.fromkeys(("^", "XOR", "⊕", "⊻", "\\oplus", "\\veebar"), "xor"),
    **dict.fromkeys(("=>", "==>", "-->", "implies", *"→⇒⟶⟹⊃", "\\to", "\\rightarrow", "\\Rightarrow"), "->"),
    **dict.fromkeys(("\\implies", "\\longrightarrow", "\\Longrightarrow"), "->"),
    **dict.fromkeys(("<=>", "<==>", "<-->", "iff", *"↔⇔⟷⟺≡", "\\leftrightarrow", "\\Leftrightarrow"), "<->"),
    **dict.fromkeys(("\\iff", "\\longleftrightarrow", "\\Longleftrightarrow", "\\equiv"), "<->"),
    **dict.fromkeys(("1", "tt", "True", "TRUE", "⊤", "\\top"), "true"),
    **dict.fromkeys(("0", "ff", "False", "FALSE", "⊥", "\\bot"), "false"),
}
LABEL_WORDS = {**WORDS, "t": "true", "f": "false", "0": "0", "1": "1"}  # of HOA: numbers are propositions
LEVELS = (("->", "<->"), ("|",), ("xor",), ("&",), ("U", "R", "W", "M"))  # the weakest first, as in Spot
TO_THE_RIGHT = ("->", "<->", "U", "R", "W", "M")
TEX_SPACE = r"(?<!/)\\[,;:! ]|\\(?:left|right)(?![a-zA-Z])|\\q?quad(?![a-zA-Z])|^\s*\$+|\$+\s*$|\ufeff"
TEX_FONT = r"\\(?:math\w+|text\w*|operatorname|mbox)\s*\{\s*(\w+)\s*\}"
DUAL = {"&": "|", "|": "&", "X": "X", "F": "G", "G": "F", "U": "R", "R": "U", "W": "M", "M": "W"}


# --- reading ----------------------------------------------------------------------------------


def read_formula(text: str, short: bool = False) -> Node:
    """The tree of a formula; ``short`` allows ``t`` and ``f`` for true and false, as in HOA labels."""
    plain = re.sub(TEX_FONT, r" \1 ", re.sub(TEX_SPACE, " ", text))
    arrows = r"<-->|<==>|<->|<=>|-->|==>|->|=>|<>|/\\|\\/|\\[a-zA-Z]+"
    words = re.findall(rf"{QUOTED}|{arrows}|\[\]|\[[^\[\]]*\]|&&|\|\||\w+|\S", plain)
    names = LABEL_WORDS if short else WORDS
    tokens = [names.get(word) or _letter_operator(word) for word in words]
    tree = _binary(tokens, 0)
    if tokens:
        raise DataError(f"formula {text!r}: {tokens[0]!r} is not expected")
    return tree


def _letter_operator(word: str) -> str:
    """An operator in mathematical letters, such as 𝒰, as a plain letter; other words unchanged."""
    plain = normalize("NFKC", word)
    return plain if plain in ("X", "F", "G", *LEVELS[-1]) else WORDS.get(plain, word)


def _binary(tokens: list[str], level: int) -> Node:
    if level == len(LEVELS):
        return _unary(tokens)
    left = _binary(tokens, level + 1)
    while tokens and tokens[0] in LEVELS[level]:
        operator = tokens.pop(0)
        right = _binary(tokens, level if operator in TO_THE_RIGHT else level + 1)
        left = (operator, left, right)
    return left


def _unary(tokens: list[str]) -> Node:
    if not tokens:
        raise DataError("the formula ends too early")
    token = tokens.pop(0)
    if token in ("F", "G") and tokens and tokens[0].startswith("["):
        begin, end = _span(tokens.pop(0))
        return ("within", token, begin, end, _unary(tokens))
    if token == "X" and tokens and tokens[0] == "[!]":
        tokens.pop(0)
    if token in ("!", "X", "F", "G"):
        return (token, _unary(tokens))
    if token == "(":
        inner = _binary(tokens, 0)
        if not tokens or tokens.pop(0) != ")":
            raise DataError("the formula lacks a ')'")
        return inner
    if token.startswith('"') and len(token) > 2:
        return ("ap", token[1:-1])
    if not re.fullmatch(r"\w+", token):
        raise DataError(f"the formula has {token!r} where a proposition is expected")
    return (token,) if token in ("true", "false") else ("ap", token)


def _span(text: str) -> tuple[float, float]:
    """Begin and end [s] of a time span such as ``[0,6h]``; a number without a unit has the other's unit."""
    parts = re.findall(r"([\d.]+)\s*(s|min|h|d)?", text)
    units = [unit for _, unit in parts if unit]
    if len(parts) != 2 or not units:
        raise DataError(f"the formula has the time span {text!r}; expected one such as [0,6h]")
    seconds = {"s": 1.0, "min": 60.0, "h": 3600.0, "d": 86_400.0}
    begin, end = (float(number) * seconds[unit or units[-1]] for number, unit in parts)
    return begin, end


def _clock(begin: float, end: float) -> str:
    """Name of the proposition "the time lies between these" [s]."""
    texts = ["on" if math.isinf(t) else f"{round(t, 3):.15g}".replace(".", "p") for t in (begin, end)]
    return "clock_" + "_".join(texts)


def normal_form(node: Node, negated: bool = False) -> Node:
    """Negation moved to the propositions; ``->``, ``<->`` and ``xor`` written out, and so are time spans::

    F[b,e] p = F (now & p),    G[b,e] p = (now -> p) U over
    """
    operator, *args = node
    if operator == "within":
        kind, begin, end, inner = args
        p, now = normal_form(inner, negated), _clock(begin, end)
        if (kind == "F") is not negated:
            return ("F", ("&", ("ap", now), p))
        return ("U", ("|", ("not", now), p), ("ap", _clock(end + 1e-3, math.inf)))
    if operator in ("true", "false"):
        return ("false" if (operator == "true") is negated else "true",)
    if operator == "ap":
        return ("not", *args) if negated else node
    if operator == "!":
        return normal_form(args[0], not negated)
    if operator == "->":
        return normal_form(("|", ("!", args[0]), args[1]), negated)
    if operator in ("<->", "xor"):
        p, q = args
        other = ("!", q) if operator == "xor" else q
        same = ("|", ("&", p, other), ("&", ("!", p), ("!", other)))
        return normal_form(same, negated)
    return (DUAL[operator] if negated else operator, *(normal_form(arg, negated) for arg in args))


# --- meaning ----------------------------------------------------------------------------------


def _either(p: Rest, q: Rest) -> Rest:
    both = p | q
    return frozenset(one for one in both if not any(other < one for other in both))


def _both(p: Rest, q: Rest) -> Rest:
    return _either(frozenset(one | other for one in p for other in q), NEVER)


def after_letter(node: Node, letter: frozenset[str]) -> Rest:
    """The rest of a formula in normal form after ``letter``.

    p U q = q | p & X (p U q),    F q = q | X F q,    p M q = q & (p | X (p M q))
    """
    operator, *args = node
    if operator in ("true", "false"):
        return DONE if operator == "true" else NEVER
    if operator in ("ap", "not"):
        return DONE if (args[0] in letter) is (operator == "ap") else NEVER
    if operator == "X":
        return frozenset({frozenset({args[0]})})
    again: Rest = frozenset({frozenset({node})})
    values = [after_letter(arg, letter) for arg in args]
    if operator == "&":
        return _both(*values)
    if operator == "|":
        return _either(*values)
    if operator == "F":
        return _either(values[0], again)
    if operator == "U":
        return _either(values[1], _both(values[0], again))
    if operator == "M":
        return _both(values[1], _either(values[0], again))
    raise DataError(f"operator {operator} promises something for ever; no finite flight completes it")


def rest_after(rest: Rest, letter: frozenset[str]) -> Rest:
    """The rest after one more letter."""
    left = NEVER
    for obligations in rest:
        together = DONE
        for node in obligations:
            together = _both(together, after_letter(node, letter))
        left = _either(left, together)
    return left


def completed(rests: Mapping[Rest, Sequence[Rest]]) -> set[Rest]:
    """The rests after which every infinite word satisfies the formula: all words lead to ``DONE``."""
    avoid = {rest for rest in rests if rest != DONE}
    while True:
        forced = {rest for rest in avoid if not any(ahead in avoid for ahead in rests[rest])}
        if not forced:
            return {rest for rest in rests if rest not in avoid}
        avoid -= forced


def rest_graph(formula: str, letters: Sequence[frozenset[str]]) -> tuple[Rest, dict[Rest, list[Rest]]]:
    """The first rest, and for every rest that can be reached the next one after each letter."""
    first: Rest = frozenset({frozenset({normal_form(read_formula(formula))})})
    graph: dict[Rest, list[Rest]] = {}
    fresh = [first]
    while fresh:
        rest = fresh.pop()
        if rest in graph:
            continue
        if len(graph) >= MAX_RESTS:
            raise DataError(f"formula {formula!r} is too large to check: more than {MAX_RESTS} rests")
        graph[rest] = [rest_after(rest, letter) for letter in letters]
        fresh += graph[rest]
    return first, graph


# --- automata ---------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Dfa:
    """``delta[q][i]`` is the state after ``letters[i]``; acceptance is final."""

    letters: tuple[frozenset[str], ...]
    atoms: tuple[str, ...]
    delta: tuple[tuple[int, ...], ...]
    initial: int
    accepting: tuple[bool, ...]


def first_difference(dfa: Dfa, formula: str, forbidden: Collection[str] = ()) -> str | None:
    """A shortest word on which automaton and formula disagree; None if there is none.

    A ``forbidden`` proposition makes a mission fail that is not yet complete.
    """
    first, graph = rest_graph(formula, dfa.letters)
    good, bad = completed(graph), [not letter.isdisjoint(forbidden) for letter in dfa.letters]

    def after(rest: Rest, i: int) -> Rest:
        return NEVER if rest == NEVER or (bad[i] and rest not in good) else graph[rest][i]

    return _walk_together(dfa, first, after, lambda q, rest: dfa.accepting[q] == (rest in good))


def unlike(dfa: Dfa, other: Dfa) -> str | None:
    """A shortest word on which two automata over the same propositions disagree; None if there is none."""
    place = [other.letters.index(letter) for letter in dfa.letters]
    return _walk_together(
        dfa,
        other.initial,
        lambda p, i: other.delta[p][place[i]],
        lambda q, p: dfa.accepting[q] == other.accepting[p],
    )


def _walk_together(
    dfa: Dfa, start: Any, step: Callable[[Any, int], Any], agree: Callable[[int, Any], bool]
) -> str | None:
    """Breadth-first search of the pairs that one word leads to; the word of the first that disagrees."""
    seen, fresh = {(dfa.initial, start)}, [(dfa.initial, start, "")]
    while fresh:
        ahead = []
        for q, other, word in fresh:
            if not agree(q, other):
                return word.strip() or "the empty word"
            for i, letter in enumerate(dfa.letters):
                pair = (dfa.delta[q][i], step(other, i))
                if pair not in seen:
                    seen.add(pair)
                    ahead.append((*pair, f"{word} {{{','.join(sorted(letter))}}}"))
        fresh = ahead
    return None


def distances(dfa: Dfa) -> FloatArray:
    """d_A: fewest letters to acceptance from each state, inf if it cannot be reached."""
    found, delta = np.where(dfa.accepting, 0.0, np.inf), np.array(dfa.delta)
    for _ in delta:
        found = np.minimum(found, 1.0 + found[delta].min(axis=1))
    return found


@cache
def covers(dfa: Dfa) -> BoolArray:
    """``[q, p]``: q accepts every word that p accepts."""
    accepting, delta = np.array(dfa.accepting), np.array(dfa.delta)
    better: BoolArray = accepting[:, None] | ~accepting
    while True:
        left = better & better[delta[:, None], delta].all(axis=2)
        if (left == better).all():
            return better
        better = left


@cache
def harmful(dfa: Dfa, empty: Label = frozenset()) -> BoolArray:
    """``[q, letter]``: whether a letter is read between steps; a place without regions has letter ``empty``.

    Such a letter leads from a state that can be completed to one that cannot, or it is not the empty letter
    and leads to a state that does not accept all words that are accepted after the empty letter.
    """
    delta, lost, nothing = np.array(dfa.delta), np.isinf(distances(dfa)), dfa.letters.index(empty)
    worse = ~covers(dfa)[delta, delta[:, nothing, None]]
    worse[:, nothing] = False
    found: BoolArray = worse | (lost[delta] & ~lost[:, None])
    return found


@cache
def losing(dfa: Dfa, empty: Label = frozenset()) -> BoolArray:
    """``[q, letter]``: whether the letter may lead from a state as good as q to one that is not.

    Such a state s accepts all words that q accepts, and the letter is harmful in it.
    """
    better, ahead = covers(dfa), covers(dfa)[np.array(dfa.delta)]  # (s, q) and (s, letter, q)
    found: BoolArray = (better[:, None] & harmful(dfa, empty)[..., None] & ~ahead).any(axis=0).T
    return found


def read_hoa(text: str, letters: Sequence[frozenset[str]]) -> Dfa:
    """The deterministic automaton of a HOA file over ``letters``; DataError if the file is not complete."""
    start = re.search(r"^Start:\s*(\d+)", text, re.M)
    names = re.search(r"^AP:\s*\d+(.*)$", text, re.M)
    if start is None or names is None or "--BODY--" not in text:
        raise DataError("automaton.hoa has no Start, AP or body")
    atoms = [re.sub(r"\\(.)", r"\1", quoted) for quoted in re.findall(r'"((?:[^"\\]|\\.)*)"', names[1])]
    blocks = re.split(r"^State:", text.split("--BODY--")[1].split("--END--", 1)[0], flags=re.M)[1:]
    rows: dict[int, tuple[bool, tuple[int, ...]]] = {}
    for block in blocks:
        head, *edges = block.strip().splitlines()
        state = int(head.split()[0])
        rows[state] = ("{0}" in head, tuple(_edge(edges, atoms, letter) for letter in letters))
    order = sorted(rows)
    return Dfa(
        tuple(letters), tuple(atoms), tuple(rows[q][1] for q in order), int(start[1]),
        tuple(rows[q][0] for q in order),
    )  # fmt: skip


def _edge(edges: Sequence[str], atoms: Sequence[str], letter: frozenset[str]) -> int:
    """Target of the one edge whose label holds for ``letter``."""
    codes = frozenset(str(i) for i, name in enumerate(atoms) if name in letter)
    targets = set()
    for edge in edges:
        label, target = re.fullmatch(r"\s*\[(.*)\]\s*(\d+)\s*", edge).groups()  # type: ignore[union-attr]
        if after_letter(normal_form(read_formula(label, short=True)), codes) == DONE:
            targets.add(int(target))
    if len(targets) != 1:
        raise DataError(
            f"automaton.hoa: letter {sorted(letter)} has {len(targets)} edges from a state, not 1"
        )
    return targets.pop()


# --- times of propositions -------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Timetable:
    """When propositions hold: windows by name, and the step ``dt`` [s]."""

    windows: Mapping[str, Window] = field(default_factory=dict)
    dt: float = 1.0

    def now(self, step: int) -> Label:
        """The propositions whose windows are open at a step."""
        return self._open(self.dt * step, self.dt * step)

    def way(self, step: int) -> Label:
        """The propositions whose windows are open at some moment between the step before and this one."""
        return self._open(self.dt * max(step - 1, 0), self.dt * step)

    def _open(self, first: float, last: float) -> Label:
        spans = {name: (begin - TOUCH, end + TOUCH) for name, (_, begin, end) in self.windows.items()}
        return frozenset(name for name, (begin, end) in spans.items() if begin <= last and first <= end)

    def letter(self, label: Collection[str], holding: Collection[str]) -> Label:
        """The propositions that hold in the regions ``label`` while windows ``holding`` are open."""
        timed = {name for name in holding if self.windows[name][0] in (None, *label)}
        return frozenset(timed.union(name for name in label if name not in self.windows))

    def places(self, label: Collection[str]) -> Label:
        """The propositions that hold in the regions ``label`` at some time, without clocks."""
        timed = {name for name, (region, _, _) in self.windows.items() if region in label}
        return frozenset(timed.union(name for name in label if name not in self.windows))

    def region(self, name: str) -> str | None:
        """The region in which a proposition holds; None for a clock."""
        return self.windows[name][0] if name in self.windows else name


def windows_of(content: Mapping[str, Any] | None) -> dict[str, Window]:
    """The windows of scene.json or automaton.json by name; null in the file means no limit."""
    ends = (("begin", -math.inf), ("end", math.inf))
    found = {}
    for name, stated in (content or {}).items():
        begin, end = (far if stated.get(key) is None else float(stated[key]) for key, far in ends)
        found[name] = stated.get("region"), begin, end
    return found


def clock_of(name: str) -> Window | None:
    """The window in the name of a clock, such as ``clock_0_21600`` or ``clock_21600p001_on``."""
    match = re.fullmatch(r"clock_([\dp]+)_([\dp]+|on)", name)
    if match is None:
        return None
    begin, end = (math.inf if t == "on" else float(t.replace("p", ".")) for t in match.groups())
    return None, begin, end
