"""A prepared target of fuzzing, and a row of the table of targets."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hypothesis import strategies as st

from pareto_ltl.support.errors import ParetoLtlError

CASES = 2000  # of a target in one block, which the suite reads
Read = Callable[[Any], object]
Case = tuple[str, Any]  # a kind and its case


@dataclass(frozen=True, slots=True)
class Fuzz:
    """One prepared target.

    Attributes
    ----------
    cases : SearchStrategy
        Makes one case: bytes of a file, a text, or words.
    read : callable
        The function under test.
    """

    cases: st.SearchStrategy[Any]
    read: Read


@dataclass(frozen=True, slots=True)
class Target:
    """A row of the table; ``prepare`` gets an empty folder and returns None if the target cannot run here.

    ``share`` is the part of :data:`CASES` that the suite runs: below 1 if one case takes long.
    """

    name: str
    prepare: Callable[[Path], Fuzz | None]
    allowed: tuple[type[Exception], ...] = (ParetoLtlError, OSError)
    share: float = 1.0
