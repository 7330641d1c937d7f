"""What ``make test`` has run in the same way is not run again before a change is taken in."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from levels import names_by_level, same_by_day

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
    assert names_by_level(MODULE) == {
        "BY_DAY", "SIZE", "DOUBLE", "helper", "made", "test_by_fixture", "test_by_helper",
        "test_by_parameters", "TestCases",
    }  # fmt: skip


@pytest.mark.parametrize("more", ["\npytestmark = pytest.mark.skipif(BY_DAY)\n", ALL_FIXTURE])
def test_what_all_tests_of_a_module_use_makes_all_of_them_depend(more: str) -> None:
    assert "test_alike" in names_by_level(MODULE + more)


def test_a_test_with_examples_of_the_level_is_another_one_by_day() -> None:
    def plain() -> None: ...

    usual = given(st.none())(lambda _: None)
    own = settings(max_examples=7)(given(st.none())(lambda _: None))
    assert [same_by_day(test, HERE) for test in (plain, usual, own)] == [True, False, True]
    assert not same_by_day(plain, HERE.parent / "test_golden.py")
