"""Time after which a test stops waiting for another process and fails."""

from __future__ import annotations

import time
from collections.abc import Callable

PATIENCE = 900.0  # [s]; no result depends on it: a busy machine is slow, not wrong


def wait_until(true: Callable[[], bool]) -> None:
    """Return when ``true()`` holds; fail after :data:`PATIENCE`."""
    end = time.monotonic() + PATIENCE
    while not true():
        assert time.monotonic() < end, "the other process hangs"
        time.sleep(0.02)
