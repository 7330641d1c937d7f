"""What numba makes of kernels and helpers; not beside the tests of kernels, which also run uncompiled."""

from __future__ import annotations

import math

import numpy as np
import pytest
from llvmlite.binding import Linkage
from numba import njit

from typed_kernels.jit import ENTRY, PLAIN, SHARED_ENTRY, kernel


@kernel
def long_helper(x):
    """Too long to be built into its callers."""
    for _ in range(3):
        x += math.sin(x) + math.cos(x) + math.exp(-x) + math.atan(x) + math.sinh(x) + math.cosh(x)
        x -= math.tan(x) + math.asin(x) + math.acos(x) + math.tanh(x) + math.log(x) + math.log1p(x)
    return x


def first_caller(x):
    return long_helper(x[0]) + long_helper(x[1]) + long_helper(x[2])


@pytest.mark.parametrize(
    ("options", "shared"), [(PLAIN, True), (PLAIN | ENTRY, False), (SHARED_ENTRY, False)]
)
def test_a_kernel_has_helpers_of_its_own(options, shared):
    """The usual ones are those of the kernel that was compiled or read first: with other last bits."""
    compiled = njit(**options)(first_caller)
    compiled(np.ones(3))
    (made,) = compiled.overloads.values()
    helpers = [f for f in made.library._final_module.functions if "long_helper" in f.name]  # noqa: SLF001
    defined = [f for f in helpers if not f.is_declaration]
    assert defined
    assert all((f.linkage == Linkage.linkonce_odr) == shared for f in defined)
