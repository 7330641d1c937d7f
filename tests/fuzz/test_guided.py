"""Cases that led fuzzing has kept are read again, and the search finds what it is there to find."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fuzz import guided
from fuzz.guided import TARGETS, kept, packed, unpacked
from fuzz.harness import check_line
from fuzz.targets import TARGETS as EVERY

BY_NAME = {target.name: target for target in EVERY}
CASES = st.recursive(st.one_of(st.text(), st.binary()), lambda inner: st.lists(inner, max_size=3).map(tuple))


@given(CASES)
def test_a_kept_case_is_read_as_it_was(case: Any) -> None:
    assert unpacked(packed(case)) == case


def test_every_target_is_one_of_the_table() -> None:
    assert set(TARGETS) <= set(BY_NAME)
    assert {path.stem for path in guided.KEPT.glob("*.json")} <= set(TARGETS)


@pytest.mark.parametrize("name", TARGETS)
def test_kept_cases_are_understood_or_refused_in_one_line(name: str, tmp_path: Path) -> None:
    prepared, cases = BY_NAME[name].prepare(tmp_path), kept(name)
    assert prepared is not None
    for case in cases:
        try:
            prepared.read(case)
        except BY_NAME[name].allowed as error:
            check_line(str(error))


def test_new_cases_are_kept_once_the_shortest_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(guided, "KEPT", tmp_path)
    monkeypatch.setattr(guided, "MAX_KEPT", 3)
    guided.keep("telemetry", [b"longer", b"a"])
    guided.keep("telemetry", [b"a", b"bb", b"x" * 9000])
    assert kept("telemetry") == [b"a", b"longer", b"bb"]


@pytest.mark.parametrize(
    ("ended", "fault"),
    [(0, ""), (77, "case: b'x'")],
)
def test_what_libfuzzer_says_is_counted_and_a_fault_has_its_case(
    ended: int, fault: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    said = "INFO: seed\n#12\tNEW    cov: 34 ft: 50\n#250\tDONE   cov: 56 ft: 99 corp: 7/1Kb\n"

    def child(_name: str, place: Path, *_given: Any, **_more: str) -> subprocess.CompletedProcess[str]:
        (place / "case.txt").write_text("b'x'")
        return subprocess.CompletedProcess([], ended, "", said)

    monkeypatch.setattr(guided, "_child", child)
    found = guided.led("telemetry", 1, 1)
    assert (found.cases, found.reached) == (250, 56)
    assert fault in found.fault
    assert bool(found.fault) is bool(fault)
