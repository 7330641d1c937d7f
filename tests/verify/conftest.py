"""The honest results that several tests of ``verify`` falsify."""

from __future__ import annotations

from pathlib import Path

import pytest

from honest_results import PRESETS, honest_results
from shared import made_once


@pytest.fixture(scope="session")
def honest(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A small result of each preset, made once."""
    place = made_once(tmp_path_factory, "honest", honest_results)
    return {preset: place / preset for preset in PRESETS}
