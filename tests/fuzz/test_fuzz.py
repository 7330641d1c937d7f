"""No input makes a reader hang, fill the memory or raise anything but the package's errors."""

from __future__ import annotations

import os
from hashlib import sha256

import pytest

from fuzz.harness import SKIPPED, fuzz_target
from fuzz.records import CASES, Target
from fuzz.targets import TARGETS
from levels import AT_NIGHT, SAMPLE

pytestmark = pytest.mark.no_cover  # other tests run the same lines, and coverage is slow

ASKED = int(os.environ.get("PARETO_LTL_FUZZ_CASES", CASES if AT_NIGHT and not SAMPLE else CASES // 10))
FIRST = int(sha256(SAMPLE.encode()).hexdigest()[:8], 16) if SAMPLE else 0  # other cases by another seed


@pytest.mark.parametrize("target", TARGETS, ids=[target.name for target in TARGETS])
def test_whatever_is_read_is_understood_or_refused_in_one_line(target: Target) -> None:
    report = fuzz_target(target, max(1, round(ASKED * target.share)), FIRST)
    if report.skipped:
        pytest.skip(f"{target.name} {SKIPPED}: the extra `grib` is not installed")
    assert not report.faults, "\n".join([f"blocks of cases from {FIRST}", *report.faults])
    assert report.cases >= round(ASKED * target.share) // 2  # Hypothesis may run out of different cases
