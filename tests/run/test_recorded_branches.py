"""A small plan with branches has the numbers and texts that are recorded for it (``test_recorded``)."""

from __future__ import annotations

from pathlib import Path

import pytest

import recorded
from run.test_recorded import check

pytestmark = pytest.mark.no_cover  # other tests run the same lines, and coverage is slow


@pytest.mark.parametrize("mission", recorded.LONG)
def test_a_plan_that_takes_longer_has_the_recorded_numbers(mission: str, tmp_path: Path) -> None:
    check(mission, tmp_path)
