"""The environment of a process without coverage measurement, which is slow and writes its own files."""

from __future__ import annotations

import os

TRACED = "COVERAGE_PROCESS_CONFIG"  # coverage tells processes of a test by it what to measure


def untraced(**changes: str) -> dict[str, str]:
    """This environment with ``changes``, without coverage."""
    return {name: value for name, value in os.environ.items() if name != TRACED} | changes
