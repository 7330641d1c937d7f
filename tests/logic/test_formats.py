"""Automata in files and pictures, patterns, and the command that explains a formula."""

from __future__ import annotations

import itertools
import re
import shutil
import subprocess
from collections import deque

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ltlf import Formula, patterns
from pareto_ltl.logic import FormulaError, parse_formula, translate
from pareto_ltl.logic.patterns import formula_of
from pareto_ltl.settings import MissionConfig
from pareto_ltl.support.errors import ConfigError, ParetoLtlError
from pareto_ltl_apps.cli.commands import run_command_line
from pareto_ltl_apps.formats.hoa_files import parse_hoa, read_hoa
from pareto_ltl_apps.view import automaton_picture as draw

ATOMS = ("a", "b", "c")
LETTERS = [frozenset(s) for n in range(4) for s in itertools.combinations(ATOMS, n)]
MISSIONS = [
    "F(a & F b & F c)",
    "!b U a",
    "X X a",
    "F a & F b & (!c U a)",
    "true",
    "a & !a",
    "a M b",
    "F(a & X b)",
]

leaves = st.sampled_from([Formula("name", name=n) for n in ATOMS]).flatmap(
    lambda p: st.sampled_from([p, Formula("!", (p,))])
)
formulas = st.recursive(
    leaves,
    lambda trees: (
        st.builds(lambda op, p: Formula(op, (p,)), st.sampled_from("XF"), trees)
        | st.builds(lambda op, p, q: Formula(op, (p, q)), st.sampled_from("UM&|"), trees, trees)
    ),
    max_leaves=6,
)


# --- HOA ---------------------------------------------------------------------------------------


@settings(max_examples=100)
@given(formulas)
def test_an_automaton_comes_back_from_hoa(f):
    automaton = translate(str(f))
    assert parse_hoa(automaton.to_hoa()) == automaton


@pytest.mark.parametrize("formula", MISSIONS)
def test_a_file_serves_as_a_mission(formula, tmp_path):
    automaton = translate(formula)
    file = tmp_path / "mission.hoa"
    file.write_text(automaton.to_hoa(), encoding="utf-8")
    assert read_hoa(file) == automaton


VALID = """HOA: v1
States: 2
Start: 0
AP: 1 "a"
acc-name: Buchi
Acceptance: 1 Inf(0)
--BODY--
State: 0
[!0] 0
[0] 1
State: 1 {0}
[t] 1
--END--
"""


def test_a_hand_written_file_is_read():
    assert parse_hoa(VALID) == translate("F a")


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("HOA: v1", "HOA: v2"),
        ("[!0] 0\n", "[t] 0\n"),  # not deterministic
        ("[!0] 0\n", ""),  # not complete, fine as a trap? only where it says so
        ("Acceptance: 1 Inf(0)", "Acceptance: 2 Inf(0) & Inf(1)"),
        ("Start: 0", "Start: 5"),
        ("[0] 1", "[0] 7"),
        ("[0] 1", "[3] 1"),
        ("--END--\n", ""),
        ("--BODY--", ""),
        ("[0] 1", "[0 & ] 1"),
    ],
)
def test_a_file_that_is_not_a_deterministic_state_based_automaton_is_refused_in_one_line(old, new):
    text = VALID.replace(old, new)
    assert text != VALID
    try:
        automaton = parse_hoa(text, source="m.hoa")
    except ParetoLtlError as error:
        assert "m.hoa" in str(error)
        assert "\n" not in str(error)
    else:
        assert new == ""  # a missing edge may stand for the trap
        assert not automaton.accepts([set(), {"a"}])


def test_an_acceptance_that_is_not_absorbing_is_no_mission():
    recurring = VALID.replace("[t] 1", "[!0] 0\n[0] 1")
    with pytest.raises(ParetoLtlError, match=r"m\.hoa"):
        parse_hoa(recurring, source="m.hoa")


# --- an independent judge ------------------------------------------------------------------------


def mona_formula(f: Formula, p: str, fresh: itertools.count) -> str:
    """``f`` at position ``p`` in monadic second-order logic on finite strings."""
    if f.op == "name":
        return f"{p} in {f.name.upper()}"
    if f.op == "!":
        return f"~({mona_formula(f.args[0], p, fresh)})"
    if f.op in "&|":
        return "(" + f" {f.op} ".join(mona_formula(g, p, fresh) for g in f.args) + ")"
    q, r = f"q{next(fresh)}", f"r{next(fresh)}"
    if f.op == "X":
        return f"(ex1 {q}: {q} = {p} + 1 & {p} < {q} & {mona_formula(f.args[0], q, fresh)})"
    if f.op == "F":
        return f"(ex1 {q}: {p} <= {q} & {mona_formula(f.args[0], q, fresh)})"
    stay, goal = f.args if f.op == "U" else (f.args[1], Formula("&", f.args))
    return (
        f"(ex1 {q}: {p} <= {q} & {mona_formula(goal, q, fresh)} & "
        f"(all1 {r}: ({p} <= {r} & {r} < {q}) => {mona_formula(stay, r, fresh)}))"
    )


def mona_automaton(f: Formula, folder) -> tuple[int, set[int], dict[int, list[tuple[str, int]]]]:
    """Start after MONA's dummy step, accepting states, and per state guards with their targets."""
    first = f"(ex1 p: p = 0 & {mona_formula(f, 'p', itertools.count())})"
    file = folder / "f.mona"
    file.write_text(f"m2l-str;\nvar2 {', '.join(a.upper() for a in ATOMS)};\n{first};\n")
    told = subprocess.run(["mona", "-w", "-q", str(file)], capture_output=True, text=True, check=True).stdout
    accepting = {int(s) for s in re.search(r"Accepting states:(.*)", told)[1].split()}
    edges: dict[int, list[tuple[str, int]]] = {}
    for source, guard, target in re.findall(r"State (\d+): ([01X]*) -> state (\d+)", told):
        edges.setdefault(int(source), []).append((guard, int(target)))
    ((_, start),) = edges[int(re.search(r"Initial state: (\d+)", told)[1])]
    return start, accepting, edges


@pytest.mark.skipif(shutil.which("mona") is None, reason="MONA is not installed")
@settings(max_examples=40, deadline=None)
@given(formulas)
def test_mona_agrees(tmp_path_factory, f):
    """Good prefixes are the states from which every path meets one that MONA accepts."""
    automaton = translate(str(f), LETTERS)
    start, accepting, edges = mona_automaton(f, tmp_path_factory.mktemp("mona"))

    def step(state: int, letter: frozenset[str]) -> int:
        bits = "".join("1" if a in letter else "0" for a in ATOMS)
        (target,) = [
            t for guard, t in edges[state] if all(g in ("X", b) for g, b in zip(guard, bits, strict=True))
        ]
        return target

    bad = set(edges) - accepting  # greatest set of states that can avoid acceptance for ever
    while True:
        rest = {s for s in bad if any(step(s, letter) in bad for letter in LETTERS)}
        if rest == bad:
            break
        bad = rest
    for letter in LETTERS:  # MONA's empty string is not compared: it has no position 0
        seen, queue = set(), deque([(automaton.step(automaton.initial, letter), step(start, letter))])
        while queue:
            ours, theirs = queue.popleft()
            if (ours, theirs) in seen:
                continue
            seen.add((ours, theirs))
            assert bool(automaton.accepting[ours]) == (theirs not in bad)
            if not automaton.accepting[ours]:
                queue.extend((automaton.step(ours, a), step(theirs, a)) for a in LETTERS)


# --- patterns ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "formula"),
    [
        (patterns.sequence("a", "b", "c"), "F(a & F(b & F c))"),
        (patterns.coverage("a", "b", "c"), "F a & F b & F c"),
        (patterns.ordered_coverage(["a", "b"], [("a", "b")]), "F a & F b & (!b U a)"),
        (patterns.patrol("a", "b"), "F(a & F(b & F a))"),
        (patterns.either("F a", "F b"), "F a | F b"),
        (patterns.avoid_until("b", "a"), "!b U a"),
        (patterns.reach_avoid(["a", "b"], ["c"]), "!c U (a & (!c U b))"),
        (patterns.key_door(("a", "b"), goal="c"), "(!b U a) & F c"),
        (patterns.key_door(("a", "b")), "(!b U a) & F b"),
    ],
)
def test_a_pattern_is_the_formula_it_stands_for(text, formula):
    assert parse_formula(text) == parse_formula(formula)


def test_a_strict_sequence_asks_for_a_later_letter():
    assert translate(patterns.sequence("a", "b"), LETTERS).accepts([{"a", "b"}])
    assert not translate(patterns.sequence("a", "b", strict=True), LETTERS).accepts([{"a", "b"}])


@pytest.mark.parametrize(
    ("mission", "what"),
    [
        (MissionConfig(pattern="sequence"), "sequence"),
        (MissionConfig(pattern="cover", goals=["a"]), "must be one of"),
        (MissionConfig(pattern="coverage", goals=["a"], formula="F a"), "choose one"),
        (MissionConfig(pattern="key_door"), "key_door"),
        (MissionConfig(pattern="avoid_until", avoid=["a"], goals=["a", "b"]), "avoid_until"),
    ],
)
def test_a_pattern_that_lacks_something_says_so(mission, what):
    with pytest.raises(ConfigError, match=what) as caught:
        formula_of(mission)
    assert "\n" not in str(caught.value)


# --- pictures and the command ------------------------------------------------------------------


def test_dot_names_every_state_and_guard():
    text = draw.dot_text(translate("F(a & F b & F c)"))
    assert text.startswith("digraph")
    assert "doublecircle" in text
    assert 'label="b & !c"' in text


@pytest.mark.parametrize("formula", MISSIONS)
def test_a_picture_is_drawn(formula, tmp_path):
    draw.save_picture(translate(formula), tmp_path / "automaton.png", dpi=40)
    assert (tmp_path / "automaton.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"


def test_the_command_tells_what_a_formula_means(capsys, tmp_path):
    files = [tmp_path / name for name in ("m.hoa", "m.dot", "m.png")]
    argv = [f for pair in zip(("--hoa", "--dot", "--picture"), map(str, files), strict=True) for f in pair]
    assert run_command_line(["formula", "F(a & F b)", *argv]) == 0
    told = capsys.readouterr().out
    for word in ("normal form", "states        3", "insertion-closed"):
        assert word in told
    assert all(file.stat().st_size > 0 for file in files)
    assert read_hoa(files[0]) == translate("F(a & F b)")


def test_the_command_points_at_a_mistake(capsys):
    assert run_command_line(["formula", "F(a & (b"]) == 2
    line, text, caret = capsys.readouterr().err.splitlines()
    assert line.startswith("pareto-ltl: expected")
    assert caret.index("^") == len(text)


def test_harmful_visits_are_named(capsys):
    assert run_command_line(["formula", "!b U a"]) == 0
    assert "an extra {b} makes the mission fail" in capsys.readouterr().out


def test_a_formula_that_explodes_is_stopped():
    text = " & ".join(f"F p{i}" for i in range(8))
    with pytest.raises(ParetoLtlError, match="max_states") as caught:
        translate(text, max_states=50)
    assert "\n" not in str(caught.value)


def test_an_unknown_letter_is_a_callers_mistake():
    automaton = translate("F a", [set(), {"a"}])
    assert automaton.step(automaton.initial, {"a", "z"}) == automaton.step(automaton.initial, {"a"})
    with pytest.raises(ValueError):
        translate("F(a & b)", [set(), {"a"}]).step(0, {"a", "b"})


def test_contradictions_and_tautologies_are_said():
    assert translate("a & !a").contradiction
    assert translate("a | !a").tautology
    assert np.isinf(translate("a & !a").distance).all()


def test_a_formula_error_is_also_a_value_error():
    with pytest.raises(ValueError):
        parse_formula("F(")
    assert issubclass(FormulaError, ParetoLtlError)
