"""Bounds on the risk of missions as named tuples, and the world of all models."""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

from pareto_ltl.kernels.data import Law, Logic
from pareto_ltl.support.arrays import BoolArray, FloatArray, Int32Array, IntArray
from plane_kernels.types import Cells, CollisionBound, Corners, Faces


class Theorem2(NamedTuple):
    """The paper's bound f_o.

    ``faces`` are the faces of the convex parts of the regions, ``atom`` is the proposition of each part,
    ``holds`` (E, C, P) whether a proposition holds in a cell in each epoch of ``logic``.
    """

    faces: Faces
    atom: IntArray
    holds: BoolArray
    cells: Cells
    logic: Logic


class StateLists(NamedTuple):
    """For each automaton state q the states ``state[ptr[q]:ptr[q + 1]]``."""

    ptr: IntArray
    state: IntArray


class Ordered(NamedTuple):
    """The ordered bound V: cells that have a label, all cells, the automaton.

    ``targets`` are the states to which an entry of V at q can lead, ``begin`` the states of the first entries
    (:mod:`pareto_ltl.kernels.ordered_bound`); ``targets`` is empty for a large automaton. States with the
    same ``kind`` (Q,) are lost by the same labels.
    """

    labelled: Corners
    cells: Cells
    logic: Logic
    targets: StateLists
    begin: IntArray
    kind: IntArray


class LiveRows(NamedTuple):
    """Rows of entries (automaton state, V).

    Row v consists of the ``size[v]`` entries (at most ``most``) of ``state`` and ``value`` from ``first[v]``.
    """

    first: IntArray
    size: Int32Array
    state: Int32Array
    value: FloatArray
    most: int


class Letters(NamedTuple):
    """Probabilities of the letters of one step, in the epoch ``epoch`` (1,), and scratch memory.

    ``seen`` (L + 1,) = P(each labelled cell), last P(no label); ``met`` (H,) = P(each hazard is met).
    Scratch: ``parts`` and ``hazards`` list those with a probability above 0, ``listed`` (2,) is the number of
    each; ``place`` (Q,) is the position of a state's entry in its row, -1 if it has none.
    """

    seen: FloatArray
    met: FloatArray
    parts: IntArray
    hazards: IntArray
    listed: IntArray
    place: Int32Array
    epoch: IntArray


MissionBound: TypeAlias = Theorem2 | Ordered


class World(NamedTuple):
    """The planning problem: its three models, whose types select the code.

    Cells and automaton are fields of the mission bound only: kernels pass the world by value, and a second
    copy of them made the growth of trees with ``fidelity=full`` twice as slow.
    """

    law: Law
    mission: MissionBound
    collision: CollisionBound
