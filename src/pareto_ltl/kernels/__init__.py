"""Compiled kernels on named tuples of arrays (``data``).

Kernels do not check their arguments: the calling packages check shapes and ranges, allocate the arrays and
pack the results. ``jit`` describes how kernels are compiled and how the type of a model selects its code.
With ``NUMBA_DISABLE_JIT=1`` all of them run as plain Python.
"""

from pareto_ltl.support.machine import check_kernel_threads

check_kernel_threads()  # before numba, which raises a ValueError
