"""Compiled kernels on bare arrays.

They trust their arguments: the rooms above check shapes and ranges, allocate, call and pack the
result. ``NUMBA_DISABLE_JIT=1`` runs all of them as plain Python.
"""
