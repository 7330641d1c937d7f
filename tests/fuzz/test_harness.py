"""The harness sees what it is there to see, and the same numbers spoil a file in the same way."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from fuzz import harness, mutations
from fuzz.harness import SlowCaseError
from fuzz.records import Fuzz, Target
from pareto_ltl.support.errors import DataError


def read_with(reader: Callable[[str], object], place: Path) -> int:
    """Read 50 cases with ``reader``; the number of cases that came to it."""
    counted: list[int] = []
    target, prepared = Target("test", lambda place: None), Fuzz(st.text(max_size=3), reader)
    try:
        harness.read_block(target, prepared, place, 0, 50, counted)
    finally:
        harness.faulthandler.cancel_dump_traceback_later()
    return len(counted)


def refuse(message: str) -> object:
    raise DataError(message)


def test_a_reader_that_understands_or_refuses_has_no_fault(tmp_path: Path) -> None:
    assert read_with(lambda text: refuse("a.json: not JSON; run the plan again"), tmp_path) >= 40


@pytest.mark.parametrize(
    ("reader", "fault"),
    [
        (lambda text: {}["key"], KeyError),
        (lambda text: [].pop(), IndexError),
        (lambda text: bytearray(2**62), (MemoryError, OverflowError)),
        (lambda text: refuse("two\nlines"), AssertionError),
        (lambda text: refuse(""), AssertionError),
        (lambda text: refuse("x" * 5000), AssertionError),
        (lambda text: refuse("half of a character \ud800"), UnicodeEncodeError),
    ],
)
def test_anything_but_an_error_of_ours_in_one_line_is_a_fault(reader, fault, tmp_path: Path) -> None:
    with pytest.raises(fault):
        read_with(reader, tmp_path)


def test_a_reader_that_does_not_come_back_is_a_fault(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(harness, "SECONDS", 0.2)
    with pytest.raises(SlowCaseError):
        read_with(lambda text: time.sleep(60), tmp_path)


@pytest.mark.parametrize("kind", range(len(mutations.BYTE_STEPS)))
@given(data=st.binary(max_size=40), where=st.integers(0, 2**16 - 1), what=st.integers(0, 2**16 - 1))
def test_bytes_are_spoilt_in_the_same_way_by_the_same_numbers(
    kind: int, data: bytes, where: int, what: int
) -> None:
    spoilt = mutations.spoil_bytes(data, [(kind, where, what)])
    assert isinstance(spoilt, bytes)
    assert mutations.spoil_bytes(data, [(kind, where, what)]) == spoilt


TREE = {"a": [1, {"b": [0.5, "x"]}, []], "c": {"d": None}}


@given(mutation=mutations.steps())
def test_trees_are_spoilt_in_the_same_way_and_stay_as_they_are(mutation: list[mutations.Step]) -> None:
    before = json.dumps(TREE)
    spoilt = mutations.spoil_tree(TREE, mutation)
    assert json.dumps(TREE) == before
    for write in (mutations.json_bytes, mutations.yaml_bytes):
        assert write(spoilt) == write(mutations.spoil_tree(TREE, mutation))


def test_a_tree_that_is_not_spoilt_reads_back() -> None:
    assert json.loads(mutations.json_bytes(TREE)) == TREE
    assert yaml.safe_load(mutations.yaml_bytes(TREE)) == TREE
    assert mutations.json_bytes({"a": f"{mutations.RAW}NaN", "b": 1}) == b'{"a": NaN, "b": 1}'
