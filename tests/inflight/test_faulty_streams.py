"""Telemetry with faults: no command from old data, and no robot far from its estimate without an alarm."""

from __future__ import annotations

import sys

import pytest

from levels import AT_NIGHT

if sys.platform == "win32":
    pytest.skip("pymavlink is an extra", allow_module_level=True)

from faulty_streams import FAULTS, judged

COUNT, BLOCK = (2000, 100) if AT_NIGHT else (4, 4)


@pytest.mark.parametrize("first", range(0, COUNT, BLOCK))
def test_faulty_streams_give_no_unsafe_message_and_no_silent_error(
    first: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    statuses = outside = sent = 0
    for seed in range(first, first + BLOCK):
        stream, found = judged(seed, monkeypatch)
        assert not found.unsafe, (seed, stream.faults)
        assert not found.silent, (seed, stream.faults)
        statuses, outside, sent = statuses + found.statuses, outside + found.outside, sent + found.sent
    assert statuses > 12 * BLOCK
    assert sent > 5 * BLOCK
    assert outside > 0


def test_every_fault_makes_a_stream() -> None:
    assert len(FAULTS) == 11
