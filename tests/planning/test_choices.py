"""Independent choices of models: every combination plans, and its trees cost what exact evaluation says."""

from __future__ import annotations

import os
import subprocess
import sys
from itertools import combinations
from pathlib import Path

import choices
from levels import AT_NIGHT, first_of_each
from unmeasured import untraced

TESTS = Path(choices.__file__).parent
PAIRS = list(first_of_each(choices.CHOICES, lambda choice: combinations(enumerate(choice), 2)))


def test_every_combination_of_models_prices_its_vertices_exactly(tmp_path):
    """Uncompiled, in a separate process: combinations would compile for half a minute.

    Before the night, every pair of models.
    """
    assert len(choices.CHOICES) == 16
    assert len(PAIRS) == 16 if AT_NIGHT else 4 <= len(PAIRS) <= 12
    environment = untraced(NUMBA_DISABLE_JIT="1", PYTHONPATH=os.pathsep.join([str(TESTS), *sys.path]))
    done = subprocess.run(
        [sys.executable, TESTS / "choices.py", *map(" ".join, PAIRS)],
        env=environment, cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    lines = done.stdout.splitlines()
    assert done.returncode == 0, done.stdout + done.stderr
    assert [line.split()[1:5] for line in lines] == [list(choice) for choice in PAIRS]
    assert all(line.startswith("ok ") for line in lines)
