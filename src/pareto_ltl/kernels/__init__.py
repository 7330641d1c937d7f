"""Compiled kernels on named tuples of arrays (``data``).

Kernels do not check their arguments: the calling packages check shapes and ranges, allocate the arrays and
pack the results. :mod:`typed_kernels` compiles them, keeps their machine code, and lets the type of a model
select its code.
With ``NUMBA_DISABLE_JIT=1`` all of them run as plain Python.
"""

from pareto_ltl.support.machine import check_kernel_threads

check_kernel_threads()  # before numba, which raises a ValueError
