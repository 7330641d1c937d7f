"""Each level has the tests of those before it; what only the night runs has a reason."""

from __future__ import annotations

import ast
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import levels
from levels import (
    FEWER,
    IN_EVERY_PART,
    NOT_BY_DAY,
    NOT_UNCOMPILED,
    SECONDS,
    USUAL_SECONDS,
    drawn,
    fewer,
    in_part,
    names_by_level,
    of_this_level,
    parts_of,
)  # fmt: skip

HERE = Path(__file__)
MODULE = """
from levels import BY_DAY
SIZE = 5 if BY_DAY else 50
DOUBLE: int = 2 * SIZE
OTHER = 3

def helper():
    return DOUBLE

@pytest.fixture
def made():
    return SIZE

def test_by_fixture(made): ...
def test_by_helper(): assert helper()
@pytest.mark.parametrize("k", [1] if BY_DAY else [1, 2])
def test_by_parameters(k): ...
class TestCases:
    def test_in_class(self): assert SIZE
def test_alike(): assert OTHER
"""
ALL_FIXTURE = "\n@pytest.fixture(autouse=True)\ndef before(made): ...\n"


def test_names_that_depend_on_the_level_are_found_through_helpers_and_fixtures() -> None:
    assert names_by_level(MODULE, "BY_DAY") == {
        "BY_DAY", "SIZE", "DOUBLE", "helper", "made", "test_by_fixture", "test_by_helper",
        "test_by_parameters", "TestCases",
    }  # fmt: skip


@pytest.mark.parametrize("more", ["\npytestmark = pytest.mark.skipif(BY_DAY)\n", ALL_FIXTURE])
def test_what_all_tests_of_a_module_use_makes_all_of_them_depend(more: str) -> None:
    assert "test_alike" in names_by_level(MODULE + more, "BY_DAY")


def test_a_test_with_examples_of_the_level_is_another_one_at_night() -> None:
    def plain() -> None: ...

    usual = given(st.none())(lambda _: None)
    own = settings(max_examples=7)(given(st.none())(lambda _: None))
    items = [item(HERE, test) for test in (plain, usual, own)]
    assert levels.night_alone(items) == {items[1]}


@dataclass(eq=False)
class Item:
    """What pytest collects, as far as levels look at it."""

    path: Path
    obj: Any
    name: str


def item(path: Path, test: Any = None, name: str = "test_x") -> Any:
    return Item(path, test or (lambda: None), name)


def cases(path: Path, count: int, name: str = "test_x") -> list[Any]:
    return [item(path, name=f"{name}[{k}]") for k in range(count)]


@pytest.fixture
def level(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Sets a level."""

    def change(**values: Any) -> None:
        usual = {"BY_DAY": False, "AT_NIGHT": False, "SAMPLE": "", "PART": 1, "PARTS": 1}
        for name, value in (usual | values).items():
            monkeypatch.setattr(levels, name, value)

    return change


@pytest.mark.parametrize(("count", "retained"), [(10, 3), (10, 1), (10, 0), (3, 10), (7, 7)])
def test_the_cases_that_stay_are_as_many_as_stated_from_first_to_last(count: int, retained: int) -> None:
    chosen = fewer(count, retained)
    assert len(chosen) == min(count, retained)
    assert chosen <= set(range(count))
    if retained > 1:
        assert {0, count - 1} <= chosen


def test_all_tests_have_those_of_the_day_and_the_night_has_every_test(
    level: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(FEWER, "test_levels::test_few", (3, "for this test"))
    monkeypatch.setattr(levels, "NOT_BY_DAY", [*NOT_BY_DAY, "test_levels::test_slow"])
    golden = HERE.parent / "test_golden.py"
    items = [*cases(HERE, 9, "test_few"), item(HERE, name="test_slow"), item(HERE), item(golden)]
    level()
    every = of_this_level(items)
    assert [one.name for one in every] == [
        "test_few[0]",
        "test_few[4]",
        "test_few[8]",
        "test_slow",
        "test_x",
        "test_x",
    ]
    level(BY_DAY=True)
    by_day = of_this_level([one for one in items if one.path == HERE])  # others are not even read
    assert by_day == [one for one in every if one.path == HERE and one.name != "test_slow"]
    level(AT_NIGHT=True)
    assert of_this_level(items) == items


def test_a_part_has_the_tests_of_the_day_and_each_other_test_is_in_one(
    level: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(levels, "NOT_BY_DAY", [*NOT_BY_DAY, "test_levels::test_slow"])
    monkeypatch.setattr(levels, "LEVEL", "all")
    parts_of.cache_clear()
    slow, usual = item(HERE, name="test_slow"), item(HERE)
    runs = []
    for part in (1, 2, 3):
        level(PART=part, PARTS=3)
        runs.append(of_this_level([slow, usual]))
        assert not levels.left_out(HERE.parent / "test_golden.py")
    assert [usual in run for run in runs] == [True] * 3
    assert sum(slow in run for run in runs) == 1
    sources = sorted(HERE.parent.rglob("test_*.py"))
    read = [source for source in sources if not levels.left_out(source)]
    assert len(read) < len(sources)
    parts_of.cache_clear()


@pytest.mark.parametrize("parts", [1, 2, 3])
def test_parts_take_equally_long(parts: int) -> None:
    assert SECONDS.keys() <= parts_of(parts).keys()
    lengths = [
        sum(
            SECONDS.get(module, USUAL_SECONDS)
            for module, of_module in parts_of(parts).items()
            if of_module == part and module not in IN_EVERY_PART
        )
        for part in range(1, parts + 1)
    ]
    assert max(lengths) - min(lengths) < 0.1 * max(lengths)
    assert all(in_part(module, part, parts) for module in IN_EVERY_PART for part in range(1, parts + 1))


def test_the_jobs_of_the_workflow_have_all_parts() -> None:
    """Each change is tested by all parts, of which each has another Python; a release by all in one."""
    workflows = HERE.parents[1] / ".github" / "workflows"
    text = (workflows / "ci.yml").read_text(encoding="utf-8")
    assert re.findall(r'python: "3\.(\d+)", part: "(\d/\d)"', text) == [
        ("11", "1/3"), ("12", "2/3"), ("13", "3/3"),
    ]  # fmt: skip
    assert "CI_PART: 1/1" in (workflows / "release.yml").read_text(encoding="utf-8")


def test_a_sample_is_a_tenth_of_what_only_the_night_runs_by_its_seed(
    level: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(FEWER, "test_levels::test_few", (10, "for this test"))
    few, usual = cases(HERE, 210, "test_few"), cases(HERE, 50)
    level(AT_NIGHT=True, SAMPLE="2026-11-28")
    first, again = of_this_level([*few, *usual]), of_this_level([*few, *usual])
    level(AT_NIGHT=True, SAMPLE="2026-11-29")
    other = of_this_level([*few, *usual])
    assert first == again != other
    assert len(first) == len(other) == 20
    level()
    assert not {id(one) for one in first} & {id(one) for one in of_this_level([*few, *usual])}


def test_modules_of_a_sample_come_in_a_drawn_order_each_in_its_own() -> None:
    """Time ends a sample: modules whose names come last would else never be reached."""
    places = [HERE.parent / name for name in ("test_a.py", "test_b.py", "test_c.py")]
    items = [one for place in places for one in cases(place, 100)]
    orders = {tuple(dict.fromkeys(one.path for one in drawn(items, str(seed)))) for seed in range(40)}
    assert len(orders) == 6
    chosen = drawn(items, "1")
    assert [items.index(one) for one in chosen if one.path == places[0]] == sorted(
        items.index(one) for one in chosen if one.path == places[0]
    )


@pytest.mark.parametrize("name", [*FEWER, *NOT_UNCOMPILED, *(name for name in NOT_BY_DAY if "::" in name)])
def test_tests_that_are_named_exist(name: str) -> None:
    module, _, test = name.partition("::")
    source = (HERE.parent / module).with_suffix(".py").read_text(encoding="utf-8")
    assert test in {node.name for node in ast.parse(source).body if isinstance(node, ast.FunctionDef)}


def test_modules_that_are_listed_exist_and_stand_in_a_list_once() -> None:
    tables = [levels.FAST, levels.NOT_FAST + NOT_BY_DAY, levels.ONLY_AT_NIGHT, levels.NOT_SAMPLED, [*SECONDS]]
    for names in tables:
        assert len(set(names)) == len(names)
        assert [name for name in names if not list(HERE.parent.glob(f"{name.partition('::')[0]}.py"))] == []


@pytest.mark.parametrize(("retained", "reason"), FEWER.values(), ids=list(FEWER))
def test_what_is_left_to_the_night_has_a_reason(retained: int, reason: str) -> None:
    assert retained >= 0
    assert len(reason) > 20
