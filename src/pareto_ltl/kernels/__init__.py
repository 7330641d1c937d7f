"""Compiled kernels on named tuples of arrays (``data``): winds, flights, trees and steps of the refinement.

:mod:`plane_kernels` has plain geometry, :mod:`plane_logic` what an automaton reads.

Kernels do not check their arguments: the calling packages check shapes and ranges, allocate the arrays and
pack the results. :mod:`typed_kernels` compiles them, keeps their machine code, and lets the type of a model
select its code.
With ``NUMBA_DISABLE_JIT=1`` all of them run as plain Python.
"""

from pathlib import Path

from careful_io.machine import check_kernel_threads
from typed_kernels import packages

packages.PACKAGES[__name__], packages.PROGRAM = Path(__file__).parent, "pareto-ltl"
check_kernel_threads()  # before numba, which raises a ValueError
