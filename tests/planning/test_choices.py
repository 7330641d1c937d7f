"""Independent choices of models: every combination plans, and its trees cost what exact evaluation says."""

from __future__ import annotations

import os
import subprocess
import sys
from itertools import combinations
from pathlib import Path

import pytest
from numba import config

import choices
from levels import AT_NIGHT, first_of_each
from unmeasured import untraced

TESTS = Path(choices.__file__).parent
PAIRS = list(first_of_each(choices.CHOICES, lambda choice: combinations(enumerate(choice), 2)))
TYPES = [choice for choice in choices.CHOICES if choice[-1] in ("dominance", "mixed")]


def test_every_combination_of_models_prices_its_vertices_exactly(tmp_path):
    """Uncompiled, in a separate process: a combination would compile for half a minute.

    Before the night, every pair of models.
    """
    assert len(choices.CHOICES) == 32
    assert len(PAIRS) == 32 if AT_NIGHT else 8 <= len(PAIRS) <= 20
    environment = untraced(NUMBA_DISABLE_JIT="1", PYTHONPATH=os.pathsep.join([str(TESTS), *sys.path]))
    done = subprocess.run(
        [sys.executable, TESTS / "choices.py", *map(" ".join, PAIRS)],
        env=environment, cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    lines = done.stdout.splitlines()
    assert done.returncode == 0, done.stdout + done.stderr
    assert [line.split()[1:5] for line in lines] == [list(choice) for choice in PAIRS]
    assert all(line.startswith("ok ") for line in lines)


@pytest.mark.no_cover  # coverage slows the compiler down, and other tests run the same lines
@pytest.mark.skipif(config.DISABLE_JIT, reason="the test above covers it")
@pytest.mark.parametrize("choice", TYPES if AT_NIGHT else [choices.COMPILED], ids=" ".join)
def test_a_combination_of_both_presets_compiles(choice):
    """At night, all with kernels of their own; ``scaled`` and ``tchebycheff`` have those of ``mixed``."""
    assert "accepted" in choices.check_choice(choices.tiny_problem(*choice))
