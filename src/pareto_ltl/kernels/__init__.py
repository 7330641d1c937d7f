"""Compiled kernels on named tuples of arrays (``data``).

Kernels do not check their arguments: the packages above check shapes and ranges, allocate, call and pack
the result. ``jit`` says how they are compiled and how the type of a model picks its code.
``NUMBA_DISABLE_JIT=1`` runs all of them as plain Python.
"""
