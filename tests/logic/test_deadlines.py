"""Deadlines of formulas and propositions with time windows, before any map."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ltlf.spans import clock_name, end_clock, read_span, shown_span, span_clock
from pareto_ltl.logic import parse_formula
from pareto_ltl.logic.automaton import translate
from pareto_ltl.logic.formula import positive_normal_form
from pareto_ltl.logic.mission import automaton_of
from pareto_ltl.logic.timed import keep_clear, letter_of, timed_letters, window_patterns
from pareto_ltl.planning.pack_logic import epochs_of
from pareto_ltl.settings import MissionConfig
from pareto_ltl.support.errors import DataError, FormulaError
from pareto_ltl.world.windows import Window, clock_windows
from pareto_ltl_verify.formula import Dfa, clock_of, first_difference, normal_form, read_formula

seconds = st.integers(0, 400).map(lambda k: 450.0 * k)
spans = st.tuples(seconds, seconds).filter(lambda span: span[0] < span[1])
window = st.one_of(
    st.builds(Window, st.just("r"), st.floats(-500, 5000), st.floats(5001, 9000)),
    st.builds(Window, st.just("r"), st.floats(-500, 9000)),
    st.builds(lambda end: Window("r", end=end), st.floats(-500, 9000)),
)


@given(spans)
def test_spans_survive_their_text(span: tuple[float, float]) -> None:
    assert read_span(shown_span(span)) == span
    tree = parse_formula(f"F{shown_span(span)} (a & b) | !G{shown_span(span)} a")
    assert parse_formula(str(tree)) == tree


@given(spans)
def test_clocks_say_their_windows(span: tuple[float, float]) -> None:
    now, over = span_clock(span), end_clock(span)
    assert clock_windows(["a", now, over]) == {now: Window(None, *span), over: Window(None, span[1] + 1e-3)}
    assert clock_of(now) == (None, *span)
    assert clock_of(over) == (None, span[1] + 1e-3, math.inf)
    assert clock_name(*span) == now


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("F(b & F[0,6h] a)", "stands below 'F' of column 1"),
        ("!b U G[0,6h] a", "stands below 'U' of column 4"),
        ("F[0,6] a", "units s, min, h or d"),
        ("F[6h,2h] a", "expected a time span"),
        ("F[-1h,2h] a", "expected a time span"),
        ("F[0,6h,7h] a", "expected a time span"),
        ("X[0,6h] a", "expected a proposition"),
        ("F a [0,6h]", "expected an operator"),
        ("G a & F[0,6h] b", "promises something for ever"),
    ],
)
def test_bad_spans_are_named(text: str, said: str) -> None:
    with pytest.raises(FormulaError, match=said.replace("[", r"\[")):
        translate(text)


@pytest.mark.parametrize(
    "text",
    ["F[0,6h] a", "!F[0,6h] a & F b", "G[2h,3h] (a | b)", "F[0,1h] a -> F b", "F[0,1h] a & F[2h,3h] (b | a)"],
)
def test_the_judge_reads_the_same_formula(text: str) -> None:
    a = translate(text)
    dfa = Dfa(
        tuple(a.letters), tuple(a.atoms), tuple(map(tuple, a.delta.tolist())), int(a.initial),
        tuple(map(bool, a.accepting)),
    )  # fmt: skip
    assert first_difference(dfa, text) is None
    assert str(normal_form(read_formula(text))).count("clock") == str(
        positive_normal_form(parse_formula(text))
    ).count("clock")


@settings(deadline=None)
@given(st.lists(window, min_size=1, max_size=4), st.floats(50.0, 1500.0))
def test_every_step_shows_a_letter_that_was_foreseen(own: list[Window], dt: float) -> None:
    windows = {f"w{k}": w for k, w in enumerate(own)}
    foreseen = window_patterns(windows)
    number, epochs = epochs_of(windows, dt, 40)
    assert (np.diff(number) >= 0).all()
    for t, e in enumerate(number):
        epoch = epochs[e]
        assert {epoch.now, epoch.way} <= foreseen
        assert epoch.now <= epoch.way
        moments = np.linspace(dt * max(t - 1, 0), dt * t, 50)
        held = {name for name, w in windows.items() if any(w.holds_at(float(m)) for m in moments)}
        assert held <= epoch.way
        assert epoch.now == {name for name, w in windows.items() if w.holds_at(dt * t)}
    labels = [frozenset(), frozenset("r"), frozenset("rs")]
    letters = timed_letters(labels, windows)
    assert {letter_of(label, windows, e.now) for label in labels for e in epochs} <= letters


@pytest.mark.parametrize("text", ["F a", "F a & F b", "a U b", "F(a & X b)"])
def test_a_mission_that_keeps_clear_is_lost_by_a_forbidden_letter_alone(text: str) -> None:
    labels = [frozenset(c) for n in range(3) for c in itertools.combinations("abw", n)]
    plain, clear = translate(text), keep_clear(translate(text, labels), ("w",), labels)
    assert clear.forbidden == ("w",)
    for word in itertools.product(labels, repeat=3):
        state, done, lost = plain.initial, False, False
        for letter in word:
            if not done and "w" in letter:
                lost = True
                break
            state = plain.step(state, letter & {"a", "b"})
            done = bool(plain.accepting[state])
        assert clear.accepts(word) == (done and not lost)


def test_windows_of_the_map_reach_the_automaton() -> None:
    windows = {"late": Window("a", 100.0), "gone": Window("b", -math.inf, 50.0), "unused": Window("a", 5.0)}
    labels = [frozenset(), frozenset("a"), frozenset("b")]
    mission = MissionConfig(formula="F[0,1h] late")
    found = automaton_of(mission, labels, regions=["a", "b"], windows=windows, forbidden=("gone",))
    assert set(found.windows) == {"late", "gone", "clock_0_3600"}
    assert found.forbidden == ("gone",)
    assert frozenset({"late", "clock_0_3600"}) in found.letters


def test_an_automaton_with_clocks_is_read_from_its_file(tmp_path) -> None:
    labels = [frozenset(), frozenset("a")]
    made = automaton_of(MissionConfig(formula="F[0,1h] a"), labels, regions=["a"])
    (tmp_path / "m.hoa").write_text(made.to_hoa(), encoding="utf-8")
    again = automaton_of(MissionConfig(automaton=str(tmp_path / "m.hoa")), labels, regions=["a"])
    assert again == made
    with pytest.raises(DataError, match="unknown region 'a'"):
        automaton_of(MissionConfig(automaton=str(tmp_path / "m.hoa")), labels, regions=["b"])
