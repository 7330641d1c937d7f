"""All faults of an input stand in one line."""

from __future__ import annotations

from pathlib import Path

import pytest

from careful_io.faults import MAX_KEPT, Faults, FaultsError
from careful_io.messages import LONGEST_LINE
from pareto_ltl.support.errors import DataError


def refusal(faults: Faults) -> str:
    with pytest.raises(DataError) as caught:
        faults.refuse()
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) <= LONGEST_LINE
    return str(caught.value)


def test_without_a_fault_nothing_is_refused() -> None:
    Faults("map a.kml").refuse()


def test_one_fault_is_its_own_message() -> None:
    assert refusal(Faults("map a.kml", ["map a.kml: no start"])) == "map a.kml: no start"


def test_several_faults_are_numbered_without_repeating_the_file_and_each_once() -> None:
    faults = Faults("map a.kml", ["map a.kml: no start", "map a.kml, row 3: no name", "map a.kml: no start"])
    assert refusal(faults) == "map a.kml has 2 faults: (1) no start; (2) row 3: no name"


def test_too_many_faults_are_counted() -> None:
    faults = Faults("w.csv", (f"w.csv, row {n}: u is 'x'; expected a number" for n in range(MAX_KEPT + 7)))
    line = refusal(faults)
    shown = line.count("expected a number")
    assert 10 < shown < 60
    assert line.startswith(f"w.csv has {MAX_KEPT + 7} faults: (1) row 0: u is 'x'")
    assert line.endswith(f"; and {MAX_KEPT + 7 - shown} more")


def test_faults_of_a_part_become_faults_of_the_whole() -> None:
    faults = Faults.of_files("wind file", (Path("a"), Path("b")))
    with faults.noted():
        Faults("wind file a", ["wind file a: x", "wind file a: y"]).refuse()
    with faults.noted():
        raise DataError("wind file b: z")
    with pytest.raises(FaultsError) as caught:
        faults.refuse()
    assert str(caught.value) == (
        "the set of 2 wind files has 3 faults: (1) wind file a: x; (2) wind file a: y; (3) wind file b: z"
    )
