"""An automaton on the labels of cells, and bounds on the risk of its mission, as named tuples."""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

from plane_kernels.types import BoolArray, Cells, Corners, Faces, FloatArray, Int32Array, IntArray


class Logic(NamedTuple):
    """The automaton on the labels of cells, in every epoch.

    An epoch is a span of steps in which the same propositions with time windows hold; without time windows
    there is one epoch.

    ``epoch`` (S + 1,): the epoch of each step, the last one for all later steps. ``delta`` (E, Q, C + 1): the
    next state; the last column is for no label (in an obstacle, off the map). ``distance`` (Q,): d_A, inf in
    the trap state. ``ahead`` (E, Q): the same distance with only the labels of this epoch and of later ones.
    ``covers[q, p]`` (Q, Q): whether q accepts all that p accepts (q >= p).

    Labels that lead away from acceptance are also read between two steps: they take q to ``way`` (E, Q, C +
    1), if the label of the step before does not change q. ``harm`` (E, Q, C + 1): whether the label is worse
    in q than no label, or leads to the trap state. ``hazards``: the cells that are harmful in some state of
    some epoch. ``loses`` (E, Q, C + 1): whether the label can take a state that covers q to one that does
    not.
    """

    epoch: IntArray
    delta: IntArray
    way: IntArray
    harm: BoolArray
    loses: BoolArray
    ahead: FloatArray
    distance: FloatArray
    covers: BoolArray
    initial: int
    hazards: Corners


class Theorem2(NamedTuple):
    """The bound f_o of Theorem 2 of the paper, Eq. (M36) of docs/mathematics.md.

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
    (:mod:`plane_logic.ordered_bound`); ``targets`` is empty for a large automaton. States with the
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
