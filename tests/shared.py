"""Results that several processes of tests share: made once, by the first that needs them."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from filelock import FileLock


def made_once(factory: pytest.TempPathFactory, name: str, make: Callable[[Path], object]) -> Path:
    """The folder ``name`` of this run of the tests, which ``make`` fills; no test changes what is in it."""
    base = factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        base = base.parent  # each process has a separate folder in it
    place = base / "shared" / name
    place.parent.mkdir(exist_ok=True)
    complete = place.with_name(f"{name}.complete")
    with FileLock(place.with_name(f"{name}.lock")):
        if not complete.exists():
            shutil.rmtree(place, ignore_errors=True)  # of a process that failed
            place.mkdir()
            make(place)
            complete.touch()
    return place
