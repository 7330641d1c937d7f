"""Reading, writing and judging formulas."""

from __future__ import annotations

import itertools
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ltlf import Formula, caret_lines
from ltlf.formula import BINARY_STRENGTH, MAX_DEPTH, UNARY_OPERATORS
from pareto_ltl.logic import FormulaError, parse_formula, positive_normal_form, translate
from pareto_ltl.logic.formula import check_names, disputed_reading
from pareto_ltl.logic.mission import read_formula

names = st.sampled_from(["a", "b", "c", "Goal_1", "x2", "2nd", "höhe", "Fa"]).map(
    lambda name: Formula("name", name=name)
)
leaves = names | st.sampled_from([Formula("true"), Formula("false")])


def branches(trees):
    unary = st.builds(lambda op, p: Formula(op, (p,)), st.sampled_from(UNARY_OPERATORS), trees)
    pair = st.builds(
        lambda op, p, q: Formula(op, (p, q)), st.sampled_from(list(BINARY_STRENGTH)), trees, trees
    )
    chain = st.builds(
        lambda op, parts: Formula(op, tuple(parts)),
        st.sampled_from("&|"),
        st.lists(trees, min_size=2, max_size=4),
    )
    return unary | pair | chain


trees = st.recursive(leaves, branches, max_leaves=12)


@given(trees)
def test_what_is_printed_reads_back_as_the_same_tree(tree):
    assert parse_formula(str(tree)) == tree


@given(trees)
def test_printing_is_stable(tree):
    assert str(parse_formula(str(tree))) == str(tree)


@given(st.text(alphabet="abXFUGM&|!()-<> ~trueor[]$1\n", max_size=25))
def test_any_text_is_read_or_refused_in_one_line_that_points_into_it(text):
    try:
        tree = parse_formula(text)
    except FormulaError as error:
        assert "\n" not in str(error)
        assert 0 <= error.column <= len(text)
    else:
        assert parse_formula(str(tree)) == tree


@pytest.mark.parametrize(
    ("text", "meaning"),
    [
        ("!a & b", "(!a) & b"),
        ("F a U b", "(F a) U b"),
        ("a U b U c", "a U (b U c)"),
        ("a M b U c", "a M (b U c)"),
        ("a U b & c", "(a U b) & c"),
        ("a & b | c", "(a & b) | c"),
        ("a | b -> c", "(a | b) -> c"),
        ("a -> b -> c", "a -> (b -> c)"),
        ("a <-> b -> c", "a <-> (b -> c)"),
        ("a <-> b <-> c", "a <-> (b <-> c)"),
        ("a -> b <-> c", "a -> (b <-> c)"),
        ("a -> b xor c", "a -> (b xor c)"),
        ("a | b xor c", "a | (b xor c)"),
        ("a xor b & c", "a xor (b & c)"),
        ("a xor b xor c", "(a xor b) xor c"),
        ("X F a", "X (F a)"),
        ("! X a U b", "(!(X a)) U b"),
    ],
)
def test_operators_bind_in_the_promised_order(text, meaning):
    assert parse_formula(text) == parse_formula(meaning)


@pytest.mark.parametrize(
    ("text", "same"),
    [
        ("~a", "!a"),
        ("not a", "!a"),
        ("a && b and c", "a & b & c"),
        ("a || b or c", "a | b | c"),
        ("next eventually a", "X F a"),
        ("<>a", "F a"),
        ("a until b", "a U b"),
        ("[]a", "G a"),
        ("(((a)))", "a"),
        ("1 U a", "true U a"),
        ("tt & True & TRUE & ⊤", "true & true & true & true"),
        ("0 | ff | False | FALSE | ⊥", "false | false | false | false | false"),
        ("a /\\ b \\/ ¬ c", "a & b | !c"),
        ("◇(a ∧ ◇b) ∨ ○ c", "F(a & F b) | X c"),
        ("a => b", "a -> b"),
        ("a --> b iff c", "a -> b <-> c"),
        ("a <=> b ⇔ c", "a <-> b <-> c"),
        ("a ⊕ b ^ c", "a xor b xor c"),
        ("F(a & X[!] b)", "F(a & X b)"),
        ("finally a implies always b", "F a -> G b"),
        ("a 𝒰 b ℛ c", "a U b R c"),
        (r"$\Diamond \left( a \land \lnot b \right)$", "F(a & !b)"),
        (r"a \mathcal{U} \mathrm{b} \to \bigcirc c", "a U b -> X c"),
        (r"\Box\, a \leftrightarrow \top", "G a <-> true"),
        ('F "1" & "tt"', 'F "1" & "tt"'),
        ("\ta\n& b ", "a&b"),
    ],
)
def test_spellings_mean_the_same(text, same):
    assert parse_formula(text) == parse_formula(same)


@pytest.mark.parametrize(
    ("text", "column", "said"),
    [
        ("", 0, "empty"),
        ("   ", 0, "empty"),
        ("a &", 3, "expected a proposition"),
        ("a & | b", 4, "found '|'"),
        ("(a & b", 6, "')' to close the '(' of column 1"),
        ("F(a & (b | c)", 13, "')' to close the '(' of column 2"),
        ("a b", 2, "expected an operator or the end"),
        ("a)", 1, "found ')'"),
        ("FF a", 3, "write 'F F'"),
        ("a $ b", 2, "'$' has no meaning"),
        ("a == b", 2, "write '<->'"),
        ("F U", 2, "expected a proposition"),
        ("F " * (MAX_DEPTH + 1) + "a", 2 * MAX_DEPTH, "deeper than"),
        ("(" * (MAX_DEPTH + 1) + "a", MAX_DEPTH, "deeper than"),
    ],
)
def test_a_syntax_error_points_at_its_column_and_says_what_was_expected(text, column, said):
    with pytest.raises(FormulaError) as caught:
        parse_formula(text)
    assert caught.value.column == column
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_caret_stands_under_the_column():
    assert caret_lines("F(a &\t)", 6) == "F(a & )\n      ^"


@pytest.mark.parametrize(
    ("text", "column", "said"),
    [
        ("G p", 0, "operator 'G': 'G p' promises something for ever; no finite flight can complete it"),
        ("F a & []b", 6, "operator '[]': '[] b'"),
        ("a R b", 2, "operator 'R'"),
        ("F(a W b)", 4, "operator 'W'"),
        ("!F a", 1, "'F a' is negated by '!' of column 1; that is 'G !a'"),
        ("not eventually a", 4, "operator 'eventually': 'eventually a' is negated by 'not'"),
        ("!(a U b)", 4, "that is '!a R !b'"),
        ("!(a M b)", 4, "that is '!a W !b'"),
        ("F a -> b", 0, "'F a' is negated by '->' of column 5"),
        ("a <-> F b", 6, "'F b' is negated by '<->' of column 3"),
        ("X F b xor a", 2, "'F b' is negated by 'xor' of column 7"),
        ("!(F a & !G b)", 2, "'F a' is negated by '!' of column 1"),
    ],
)
def test_a_refused_formula_names_the_operator_as_it_was_written_and_why(text, column, said):
    for judge in (lambda: positive_normal_form(parse_formula(text)), lambda: translate(text)):
        with pytest.raises(FormulaError) as caught:
            judge()
        assert caught.value.column == column
        assert said.replace("'[] b'", "'[]b'") in str(caught.value)
        assert "for ever" in str(caught.value)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "normal"),
    [
        ("!(a & !b)", "!a | b"),
        ("!X a", "X !a"),
        ("!G a", "F !a"),
        ("!(a R b)", "!a U !b"),
        ("!(a W b)", "!a M !b"),
        ("a -> F b", "!a | F b"),
        ("!(a -> X b)", "a & X !b"),
        ("a <-> b", "a & b | !a & !b"),
        ("a xor b", "a & !b | !a & b"),
        ("!(a <-> b)", "a & !b | !a & b"),
        ("!(a xor b)", "a & b | !a & !b"),
        ("!!G a -> b", "F !a | b"),
        ("!true", "false"),
        ("(a & b) & c", "a & b & c"),
    ],
)
def test_negation_is_pushed_to_the_propositions(text, normal):
    assert positive_normal_form(parse_formula(text)) == parse_formula(normal)


@given(trees)
def test_the_normal_form_has_only_the_operators_of_co_safety(tree):
    try:
        normal = positive_normal_form(tree)
    except FormulaError as error:
        assert any(node.op in "GRWFUM" for node in tree.walk())
        assert error.column is not None
    else:
        assert {node.op for node in normal.walk()} <= {"true", "false", "name", "!", *"&|XFUM"}
        assert all(node.args[0].op == "name" for node in normal.walk() if node.op == "!")


def test_deep_sequences_and_long_chains_are_no_problem():
    deep = "F(a & " * (MAX_DEPTH // 2) + "b" + ")" * (MAX_DEPTH // 2)
    assert parse_formula(str(positive_normal_form(parse_formula(deep)))) == parse_formula(deep)
    wide = " & ".join(f"F p{i}" for i in range(2000))
    assert len(positive_normal_form(parse_formula(wide)).args) == 2000


def test_nested_equivalences_do_not_explode():
    tree = parse_formula(" <-> ".join(f"p{i}" for i in range(150)))
    assert len(list(positive_normal_form(tree).walk())) < 1500


def test_an_unknown_region_is_named_with_its_column():
    check_names(parse_formula("F(a & F b)"), ["a", "b", "c"])
    with pytest.raises(FormulaError, match="unknown region 'e' in the formula: the map has a, b") as caught:
        check_names(parse_formula("F(a & F e)"), ["b", "a"])
    assert caught.value.column == 8
    with pytest.raises(FormulaError, match="the map has bay, shore; did you mean 'shore'"):
        check_names(parse_formula("F shoer"), ["shore", "bay"])


def test_tracebacks_show_the_caret():
    with pytest.raises(FormulaError) as caught:
        translate("F a & G b")
    assert caught.value.__notes__ == ["F a & G b\n      ^"]


# --- formulas of other tools ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "reading"),
    [
        ("a | b xor c", "a | (b xor c)"),
        ("a -> b <-> c", "a -> (b <-> c)"),
        ("F a & (b U c U d)", "F a & (b U (c U d))"),
        ("a R b U c", "a R (b U c)"),
    ],
)
def test_the_reading_is_printed_where_tools_disagree(text, reading, caplog):
    assert reading in disputed_reading(text)
    assert disputed_reading(reading) == ""
    translate_text = text.replace("R", "M")
    read_formula(translate_text)
    assert "other tools read it in another order" in caplog.text


@pytest.mark.parametrize("text", ["a | b & c", "a -> b -> c", "a xor b xor c", "F a U b", "a & b | !c"])
def test_there_is_no_note_where_tools_agree(text, caplog):
    assert disputed_reading(text) == ""
    read_formula(text)
    assert caplog.text == ""


def test_a_region_with_the_name_of_a_constant_is_not_lost():
    with pytest.raises(FormulaError, match='a region of the map has this name: write "1" in double quotes'):
        check_names(parse_formula("F 1"), ["1"])
    check_names(parse_formula('F "1"'), ["1"])
    check_names(parse_formula("1 U a"), ["a"])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("HOA: v1", "mission.automaton"),
        ("LTLSPEC F a", "NuSMV"),
        ("ltl p { <> a }", "Spin"),
        ("P>=0.9 [ F a ]", "PRISM"),
        ("Pmax=? [ F a ]", "PRISM"),
        ("F<=5 a", "F[0,6h] a"),
        ("F_[0,5] a", "signal temporal logic"),
        ("F[0:5] a", "range of steps"),
        ("(and (visited a) (visited b))", "PDDL"),
        ("A F a", "CTL"),
        ("F x > 3", "comparison of numbers"),
        ("∀ x F x", "quantifier"),
        (r"\foo a", "no operator of TeX"),
    ],
)
def test_a_formula_of_another_kind_is_named_with_the_way_out(text, said):
    with pytest.raises(FormulaError, match=re.escape(said)) as caught:
        parse_formula(text)
    assert "\n" not in str(caught.value)


AVOIDING = st.recursive(
    st.sampled_from(["a", "c", "!a"]),
    lambda inner: st.one_of(
        inner.map(lambda p: f"F({p})"),
        inner.map(lambda p: f"X({p})"),
        st.tuples(inner, st.sampled_from("&|"), inner).map(lambda t: f"(({t[0]}) {t[1]} ({t[2]}))"),
        inner.map(lambda p: f"(c U ({p}))"),
    ),
    max_leaves=4,
)
LETTERS = [frozenset(s) for n in range(4) for s in itertools.combinations("abc", n)]


@settings(max_examples=150, deadline=None)
@given(AVOIDING, st.sampled_from(["G !b", "!F b", "[] !b", "!<> b"]))
def test_the_way_out_of_reach_avoid_is_the_mission_that_was_meant(goal, never):
    """A word completes the suggested formula exactly if it completes the goal before it meets b."""
    with pytest.raises(FormulaError, match="promises something for ever") as caught:
        translate(f"({goal}) & {never}")
    cure = re.search(r"write '(.*?)'(, or|$| \()", str(caught.value))[1]
    suggested, wanted = translate(cure, LETTERS), translate(goal, LETTERS)
    rng = np.random.default_rng(0)
    for _ in range(60):
        word = [LETTERS[k] for k in rng.integers(len(LETTERS), size=rng.integers(1, 7))]
        met = next((k for k, letter in enumerate(word) if "b" in letter), len(word))
        before = [k for k in range(1, met + 1) if wanted.accepts(word[:k])]
        if wanted.tautology:
            continue
        assert suggested.accepts(word) == bool(before), (cure, word)


def test_regions_to_avoid_can_be_drawn_as_obstacles():
    with pytest.raises(FormulaError, match=r"write '!b U \(a & !b\)', or draw b as an obstacle"):
        translate("F a & G !b")
    with pytest.raises(FormulaError, match=r"or draw b, c as obstacles"):
        translate("F a & G(!b & !c)")
    with pytest.raises(FormulaError, match=r"or draw b, c, d, \.\.\. as obstacles"):
        translate("F a & G(!b & !c & !d & !e)")
