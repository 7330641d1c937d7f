"""A case: a problem whose size is one number, and the limits at its largest size."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

GIBIBYTE = 2.0**30


@dataclass(frozen=True, slots=True)
class Case:
    """A problem of several sizes.

    Attributes
    ----------
    name : str
        For the table; the file name of its figure.
    sizes : tuple of int
        In ascending order; a case without an answer at one size is not run at larger ones.
    run : callable
        Solves one size and returns its CPU seconds, of all cores together, so that other work on the machine
        counts less; importing packages is not included.
    unit : str
        What the size counts.
    limit : float
        Seconds at the largest size.
    memory : float
        Bytes at the largest size, of the whole process.
    """

    name: str
    sizes: tuple[int, ...]
    run: Callable[[int], float]
    unit: str
    limit: float
    memory: float = GIBIBYTE


__all__ = ["GIBIBYTE", "Case"]
