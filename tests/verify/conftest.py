"""The honest results that several tests of ``verify`` falsify."""

from __future__ import annotations

from pathlib import Path

import pytest

from honest_results import honest_results


@pytest.fixture(scope="session")
def honest(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A small result of each preset, made once."""
    return honest_results(tmp_path_factory.mktemp("honest"))
