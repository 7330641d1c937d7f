"""A plan without compiled kernels is the plan with them: two roads from the settings to every number."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numba import config

import small_plans
from unmeasured import untraced

TESTS = Path(small_plans.__file__).parent


@pytest.fixture(scope="module")
def uncompiled(tmp_path_factory: pytest.TempPathFactory) -> dict[str, np.ndarray]:
    """The numbers of all missions from a process that compiles nothing."""
    file = tmp_path_factory.mktemp("uncompiled") / "numbers.npz"
    path = os.pathsep.join([str(TESTS), *sys.path])
    environment = untraced(NUMBA_DISABLE_JIT="1", PYTHONPATH=path)
    command = [sys.executable, str(TESTS / "small_plans.py"), str(file)]
    done = subprocess.run(
        command, env=environment, cwd=file.parent, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    with np.load(file) as stored:
        return dict(stored)


@pytest.mark.skipif(config.DISABLE_JIT, reason="compares with compiled kernels")
@pytest.mark.parametrize("name", small_plans.MISSIONS)
def test_a_plan_is_the_same_without_compiled_kernels(name: str, uncompiled: dict[str, np.ndarray]) -> None:
    """To rounding, enlarged by the search: compiled code fuses multiplications and additions."""
    compiled = small_plans.numbers(name)
    keys = [key.removeprefix(f"{name}.") for key in uncompiled if key.startswith(f"{name}.")]
    assert sorted(keys) == sorted(compiled)
    for key, value in compiled.items():
        other = uncompiled[f"{name}.{key}"]
        np.testing.assert_allclose(
            value, other, rtol=1e-5, atol=1e-5 * np.abs(other).max() + 1e-9, err_msg=key
        )
    assert len(compiled["tree_x"]) > 100
