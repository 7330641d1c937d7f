"""No input makes a reader hang, fill the memory or raise anything but the package's errors."""

from __future__ import annotations

import os

import pytest

from fuzz.harness import SKIPPED, fuzz_target
from fuzz.records import CASES, Target
from fuzz.targets import TARGETS

pytestmark = pytest.mark.no_cover  # other tests run the same lines, and coverage is slow

ASKED = int(os.environ.get("PARETO_LTL_FUZZ_CASES", CASES))


@pytest.mark.parametrize("target", TARGETS, ids=[target.name for target in TARGETS])
def test_whatever_is_read_is_understood_or_refused_in_one_line(target: Target) -> None:
    report = fuzz_target(target, max(1, round(ASKED * target.share)))
    if report.skipped:
        pytest.skip(f"{target.name} {SKIPPED}: the extra `grib` is not installed")
    assert not report.faults, "\n".join(report.faults)
    assert report.cases >= round(ASKED * target.share) // 2  # Hypothesis may run out of different cases
