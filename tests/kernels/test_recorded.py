"""Kernels have the recorded numbers (``tests/recorded_kernels.py``), compiled and run as Python."""

from __future__ import annotations

import json
from typing import Any

import pytest

import recorded
import recorded_kernels

KEPT: dict[str, dict[str, list[Any]]] = json.loads(recorded_kernels.KEPT.read_text())


@pytest.mark.parametrize("case", recorded_kernels.CASES)
def test_the_numbers_of_a_small_problem_are_those_that_are_recorded(case: str) -> None:
    assert recorded.differences(KEPT[case], recorded_kernels.found(case)) == []


def test_every_case_is_recorded() -> None:
    assert KEPT.keys() == recorded_kernels.CASES.keys()
