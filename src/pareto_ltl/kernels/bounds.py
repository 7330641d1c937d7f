"""Bounds on the risk of missions and collisions as named tuples, their memories, and the world of all models.

Rows of a memory belong to the vertices of a tree or the steps of a path.
"""

from __future__ import annotations

from typing import Any, NamedTuple, TypeAlias

from pareto_ltl.kernels.data import Cells, Corners, Faces, Law, Logic, Nearby
from pareto_ltl.support.arrays import BoolArray, Float32Array, FloatArray, Int32Array, IntArray

# --- mission bounds ---------------------------------------------------------------------------


class Theorem2(NamedTuple):
    """The paper's bound f_o.

    ``faces`` are the faces of the convex parts of the regions, ``atom`` is the proposition of each part,
    ``holds`` (E, C, P) whether a proposition holds in a cell in each epoch of ``logic``. Its memory is None,
    as the risks of the propositions are objectives of the vertex.
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
    """Rows of entries (automaton state, V); several rows may refer to the same entries.

    Row v consists of the ``size[v]`` entries (at most ``most``) of ``state`` and ``value`` from ``first[v]``
    on; ``first[v]`` is -1 before the row is stored. Entries from ``used[0]`` on are free.
    """

    first: IntArray
    size: Int32Array
    state: Int32Array
    value: FloatArray
    used: IntArray
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


class OrderedMemory(NamedTuple):
    """``rows`` of V; ``letters`` is scratch memory, None in trees.

    ``same`` (2,) belongs to the two scratch rows: the row of the tree with the same V, -1 if the scratch row
    has separate entries.
    """

    rows: LiveRows
    same: IntArray
    letters: Any


MissionBound: TypeAlias = Theorem2 | Ordered


# --- collision bounds -------------------------------------------------------------------------


class StepBound(NamedTuple):
    """Eqs. (9) and (10): epsilon is divided equally among the m barriers (obstacles and walls).

    ``z`` is the quantile of 1 - epsilon / m. Its memory is None.
    """

    barriers: Faces
    nearby: Nearby
    z: float


class PathBound(NamedTuple):
    """R of whole paths, with limits for all barriers together: ``epsilon`` in a step, ``delta`` on a path."""

    barriers: Faces
    nearby: Nearby
    epsilon: float
    delta: float


class PathMemory(NamedTuple):
    """Runs with a cost above 0, up to K per row.

    ``face`` (N, K): the separating face of each run, -1 after the last one; ``run`` (N, K, 3): Σ p, smallest
    gap [m] and largest variance [m²] of its steps.
    """

    face: Int32Array
    run: Float32Array


CollisionBound: TypeAlias = StepBound | PathBound
CollisionMemory: TypeAlias = PathMemory | None


class World(NamedTuple):
    """The planning problem: its three models, whose types select the code.

    Cells and automaton are fields of the mission bound only: kernels pass the world by value, and a second
    copy of them made the growth of trees with ``fidelity=full`` twice as slow.
    """

    law: Law
    mission: MissionBound
    collision: CollisionBound
