"""HOA files that ask for more than a machine has are refused in one line."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ltlf import labels
from pareto_ltl.logic import translate
from pareto_ltl.support.arrays import BoolArray
from pareto_ltl.support.errors import DataError, ParetoLtlError
from pareto_ltl_apps.formats import hoa_files, hoa_labels
from pareto_ltl_apps.formats.hoa_files import parse_hoa, read_hoa


def text(header: str = "", label: str = "0", states: str = "States: 2") -> str:
    return (
        f'HOA: v1\n{states}\nStart: 0\nAP: 2 "a" "b"\nAcceptance: 1 Inf(0)\n{header}\n--BODY--\n'
        f"State: 0\n[{label}] 1\n[!({label})] 0\nState: 1 {{0}}\n[t] 1\n--END--\n"
    )


def refusal(content: str) -> str:
    with pytest.raises(ParetoLtlError) as caught:
        parse_hoa(content)
    message = str(caught.value)
    assert "\n" not in message
    assert len(message) < 300
    return message


def test_aliases_that_double_are_worked_out_once_each() -> None:
    lines = ["Alias: @a0 0", *(f"Alias: @a{i + 1} @a{i} & @a{i}" for i in range(150))]
    found = parse_hoa(text("\n".join(lines), "@a150"))
    plain = parse_hoa(text())
    np.testing.assert_array_equal(found.delta, plain.delta)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (text(states="States: 1000000000"), "1000000000 states; 16777216 are the limit"),
        (text(states=f"States: {'9' * 5000}"), "line 2: a number of states has 5000 digits"),
        (text(label="9" * 5000), "is not a label"),
        (text(label="(" * 5000 + "0"), "line 9: a label nested deeper than 200 levels"),
        (text(label="!" * 5000 + "0"), "nested deeper than 200 levels"),
        (text("\n".join(f"Alias: @a{i} 0" for i in range(2000))), "more than 1000 aliases"),
        (text("letters: 0 4"), "a letter has more bits than the 2 propositions"),
        (text(f"letters: {'9' * 30}"), "a letter has 30 digits"),
        (text().replace("v1", "v" * 5000), "line 1: version vvv"),
        (text().replace("1 Inf(0)", "[" * 5000), "acceptance '[ [ [ "),
        (text('Alias: "\n'), "has no meaning here"),
        (text('Alias: "a\nb"'), 'line 6: expected an alias, found "a b"'),
        (text().replace('AP: 2 "a" "b"', f"AP: {'9' * 18}"), "expected a proposition in quotes"),
    ],
)
def test_a_file_beyond_the_limits_is_refused(content: str, words: str) -> None:
    assert words in refusal(content)


def test_labels_that_take_too_much_work_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hoa_labels, "MAX_LABEL_WORK", 1000)
    assert "too long for 4 letters" in refusal(text(label=" | ".join(["0"] * 200)))


@pytest.mark.parametrize("data", [b"HOA: v1\n\xff", b"\xff\xfeH\0O\0A\0"])
def test_a_file_that_is_no_text_is_refused_with_its_line(data: bytes, tmp_path) -> None:
    (tmp_path / "a.hoa").write_bytes(data)
    with pytest.raises(DataError, match=r"a\.hoa: line \d: byte 0xff is not UTF-8"):
        read_hoa(tmp_path / "a.hoa")


def test_a_byte_order_mark_is_no_part_of_an_automaton(tmp_path) -> None:
    (tmp_path / "a.hoa").write_text(text(), encoding="utf-8-sig")
    assert read_hoa(tmp_path / "a.hoa") == parse_hoa(text())


def test_a_label_that_many_edges_have_is_read_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """4,096 states share the labels of their edges: they are parsed and worked out once for each text."""
    made, before = [], hoa_labels.LabelReader.evaluated

    def counted(self: hoa_labels.LabelReader, text: str, line: int) -> BoolArray:
        made.append(text)
        return before(self, text, line)

    monkeypatch.setattr(hoa_labels.LabelReader, "evaluated", counted)
    count = 4096
    lines = [
        f"State: {q}{' {0}' if q == count - 1 else ''}\n[(0) &\n 1] {min(q + 1, count - 1)}\n[!0 | !1] {q}"
        for q in range(count - 1)
    ]
    head = text(states=f"States: {count}").split("State: 0")[0]
    read = parse_hoa("\n".join([head, *lines, f"State: {count - 1} {{0}} [t] {count - 1} --END--"]))
    assert read.n_states == count
    assert len(made) < 10


def test_lines_of_labels_that_are_passed_over_are_counted() -> None:
    content = text(label="0 &\n 1").replace("[!(0 &\n 1)] 0", "[0 &\n 1] 1\n[!(0 & 1)] 7")
    assert "line 13: state 0 leads to state 7" in refusal(content)


def test_literals_that_exclude_each_other_take_no_letter() -> None:
    found = parse_hoa(text(label="0 & !0 | 0 & 1"))
    np.testing.assert_array_equal(found.delta, parse_hoa(text(label="(0) & 1")).delta)


def test_quotes_without_an_end_are_refused_after_one_look() -> None:
    assert "has no meaning here" in refusal(text("name: " + '"\\' * 1_000_000))


def test_a_state_that_is_announced_and_has_no_lines_never_completes() -> None:
    content = text(states="States: 3")
    found, plain = parse_hoa(content), parse_hoa(text())
    for word in ((), ("a",), ("a", "b"), ("b", "a")):
        letters = [frozenset(one) for one in word]
        assert found.accepts(letters) == plain.accepts(letters)


def test_a_header_that_ends_with_another_mark_is_refused() -> None:
    assert "expected --BODY--" in refusal(text().replace("--BODY--", "--END--"))


def test_an_edge_may_lead_to_a_state_that_is_announced_and_has_no_lines_and_to_no_other() -> None:
    leads = text(states="States: 3").replace("[!(0)] 0\n", "[!(0)] 2\n")
    found = parse_hoa(leads)
    assert found.accepts([{"a"}, set()])
    assert not found.accepts([set(), {"a"}])
    assert "state 0 leads to state 2, which does not exist" in refusal(leads.replace("States: 3\n", ""))
    assert "state 1, but 'States:' announces 1" in refusal(text(states="States: 1"))


def test_the_name_of_a_state_changes_nothing() -> None:
    named = text().replace("State: 0\n", 'State: 0 "begin"\n').replace("State: 1 {0}", 'State: 1 "done" {0}')
    assert parse_hoa(named) == parse_hoa(text())


def test_letters_are_listed_where_some_are_missing_and_only_there() -> None:
    whole = translate("F(a & F b)")
    assert "letters:" not in whole.to_hoa()
    some = translate("F(a & F b)", whole.letters[:3])
    assert "letters: 0 1 2" in some.to_hoa()
    assert parse_hoa(some.to_hoa()) == some


@given(st.integers(1, 2**16 - 2))
def test_labels_hold_their_codes_and_no_other_and_none_is_redundant(chosen: int) -> None:
    codes = np.arange(16)
    inside, outside = codes[(chosen >> codes) & 1 == 1], codes[(chosen >> codes) & 1 == 0]
    cubes = labels.covering_cubes(inside, outside, 4)

    def held(some: list[labels.Cube]) -> set[int]:
        return {code for code in codes.tolist() if any(code & care == value for care, value in some)}

    assert held(cubes) == set(inside.tolist())
    for cube in cubes:
        assert held([one for one in cubes if one != cube]) != held(cubes)


def test_a_proposition_that_is_listed_twice_is_refused() -> None:
    assert "a proposition is listed twice" in refusal(text().replace('"a" "b"', '"a" "a"'))


def test_a_table_of_as_many_entries_as_the_limit_is_read(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two states and a trap, times four letters."""
    monkeypatch.setattr(hoa_files, "MAX_ENTRIES", 12)
    assert parse_hoa(text()).accepts([{"a"}])
    monkeypatch.setattr(hoa_files, "MAX_ENTRIES", 11)
    assert "2 states x 4 letters are more than 11" in refusal(text())


def test_the_depth_of_a_label_is_counted_anew_after_each_bracket() -> None:
    deep = hoa_labels.MAX_LABEL_DEPTH
    side_by_side = " & ".join(["(0)"] * (deep + 50))
    assert parse_hoa(text(label=side_by_side)) == parse_hoa(text())
    assert parse_hoa(text(label="!" * (deep // 2 * 2 - 2) + "0")) == parse_hoa(text())
    for label in ("(" * (deep + 1) + "0" + ")" * (deep + 1), f"{side_by_side} & " + "!" * (deep + 2) + "0"):
        assert f"deeper than {deep} levels" in refusal(text(label=label))


@pytest.mark.parametrize("label", ["(0", "(0 | 1", "((0)", "!(0 1)"])
def test_a_bracket_that_stays_open_is_refused(label: str) -> None:
    with pytest.raises(DataError, match=r"expected '\)'"):
        parse_hoa(
            'HOA: v1\nStates: 1\nStart: 0\nAP: 2 "a" "b"\nAcceptance: 1 Inf(0)\n--BODY--\n'
            f"State: 0 {{0}}\n[{label}] 0\n--END--\n"
        )
