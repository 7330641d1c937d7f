"""The installed reader of automata in files of others."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

from pareto_ltl.logic.automaton import Automaton
from pareto_ltl.support.extensions import FORMATS


class AutomatonFormats(NamedTuple):
    """The reader of automata of others: the object ``automata`` of the entry points ``pareto_ltl.formats``.

    Attributes
    ----------
    read : callable
        The minimal automaton of a file over the given letters; DataError if it cannot be read.
    atoms : callable
        The propositions of a file.
    """

    read: Callable[[str | Path, Iterable[Iterable[str]] | None], Automaton]
    atoms: Callable[[str | Path], tuple[str, ...]]


@lru_cache
def automaton_formats() -> AutomatonFormats:
    """The installed reader of automata."""
    found: AutomatonFormats = FORMATS.required("automata")
    return found
