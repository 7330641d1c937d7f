"""What numba makes of kernels and helpers; not beside the tests of kernels, which also run uncompiled."""

from __future__ import annotations

import math
import subprocess
import sys

import numpy as np
import pytest
from llvmlite.binding import Linkage
from numba import njit
from scipy.stats import norm

from typed_kernels.jit import ENTRY, PLAIN, SHARED_ENTRY, kernel
from unmeasured import untraced


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


# Of two kernels one calls the other, so that LLVM leaves out arguments of the copy in the second; then numba
# compiles the helper in a function as usual. The process is new: what others compiled would matter.
LEFT_OUT = """
import numpy as np
from plane_kernels.polygon import polygon_probability
from plane_kernels.types import Corners, Cov, Gaussian, Point
from typed_kernels.jit import entry, kernel, shared_entry

@shared_entry
def inner(corners, here):
    return polygon_probability(corners, 0, here)

@entry
def outer(corners, x, y):
    return inner(corners, Gaussian(Point(x, y), Cov(1.0, 0.0, 1.0)))

@kernel
def called_later(corners, here):
    return 1.0 * polygon_probability(corners, 0, here)

square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
corners = Corners(np.array([0]), np.array([[0.5, 0.5]]), np.array([1.0]), np.array([0, 4]), square)
here = Gaussian(Point(0.5, 0.5), Cov(1.0, 0.0, 1.0))
print(outer(corners, 0.5, 0.5), called_later(corners, here), polygon_probability(corners, 0, here))
"""


def test_code_of_numbas_usual_compiler_calls_no_copy_whose_arguments_were_left_out(tmp_path):
    """It took the copy of the kernel that was compiled last, and read memory that is not its own."""
    program = tmp_path / "program.py"  # Numba wants the source of what it keeps on disk
    program.write_text(LEFT_OUT)
    surroundings = untraced(NUMBA_DISABLE_JIT="0", NUMBA_CACHE_DIR=str(tmp_path / "code"))
    done = subprocess.run(
        [sys.executable, program], env=surroundings, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    exact = (2.0 * norm.cdf(0.5) - 1.0) ** 2
    assert [float(word) for word in done.stdout.split()] == pytest.approx([exact] * 3, rel=1e-12)
