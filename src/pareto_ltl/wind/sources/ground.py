"""Nodes of a field that are left out: those without a value, and at a pressure level those below ground."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.wind.levels import PRESSURE, Level


@dataclass(frozen=True, slots=True)
class LeftOut:
    """Numbers of nodes of one field: all, those without a value, those below ground (None if not known)."""

    nodes: int
    missing: int
    below: int | None


def nodes_in_the_air(
    level: Level, winds: FloatArray, pressure: FloatArray | None
) -> tuple[NDArray[np.bool_], LeftOut]:
    """Which nodes of ``winds`` (N, 2) have a value and are above ground, (N,), and the numbers of the others.

    ``pressure`` (N,) [Pa] is the surface pressure, which is used only for a pressure level.
    """
    here = np.asarray(np.isfinite(winds).all(axis=1))
    missing = len(here) - int(here.sum())
    if level.kind != PRESSURE or pressure is None or len(pressure) != len(here):
        return here, LeftOut(len(here), missing, None)
    below = here & (pressure < level.value)
    return here & ~below, LeftOut(len(here), missing, int(below.sum()))


def left_out_notes(level: Level, counts: Sequence[LeftOut]) -> Iterator[str]:
    """A line for each kind of node that is left out, and one if some fields could not be checked."""
    nodes = sum(count.nodes for count in counts)
    if missing := sum(count.missing for count in counts):
        yield f"{missing} of {nodes} values at {level.text} are missing in the file and left out"
    if level.kind != PRESSURE or not counts:
        return
    checked = [count for count in counts if count.below is not None]
    if checked:
        below = sum(count.below or 0 for count in checked)
        yield (
            f"{below} of {sum(count.nodes for count in checked)} values at {level.text} lie below ground, "
            "where the surface pressure is lower, and are left out"
        )
    if len(checked) < len(counts):
        yield (
            f"{len(counts) - len(checked)} fields at {level.text} come without surface pressure: whether "
            "nodes lie below ground could not be checked"
        )
