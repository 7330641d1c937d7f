"""What the kernels read: named tuples of arrays, so that loops say ``wind.mean``, not ``arr[3]``."""

from __future__ import annotations

from typing import NamedTuple

from pareto_ltl.arrays import BoolArray, FloatArray, IntArray


class Faces(NamedTuple):
    """Convex polygons by their half planes ``normal' x <= offset``.

    Polygon j owns rows ``ptr[j]`` to ``ptr[j + 1]``; ``normal`` (F, 2) points outwards, unit length.
    """

    ptr: IntArray
    normal: FloatArray
    offset: FloatArray


class Wind(NamedTuple):
    """Wind on a lattice; step n lies between slots ``slot[n]`` and ``slot[n] + 1`` at ``weight[n]``.

    ``mean``, ``latent`` (K, NX, NY, 2); ``gust`` (K, 2); ``slot``, ``weight`` (S,), S the number of
    steps for which the data reach.
    """

    west: float
    south: float
    per_metre: float
    slot: IntArray
    weight: FloatArray
    mean: FloatArray
    latent: FloatArray
    gust: FloatArray


class Motion(NamedTuple):
    """x' = A x + dt B u + dt w. ``a`` = A, ``b_inv`` = B^-1, ``ball`` the radius of the maximum-trace
    rule in standard deviations."""

    a: FloatArray
    b_inv: FloatArray
    dt: float
    u_max: float
    ball: float


class Cells(NamedTuple):
    """Convex cells with a bucket grid in front: bucket k lists its candidate cells in
    ``candidates[ptr[k]:ptr[k + 1]]``. ``atoms`` (C, P) says which propositions hold in a cell."""

    west: float
    south: float
    east: float
    north: float
    buckets: int
    ptr: IntArray
    candidates: IntArray
    faces: Faces
    atoms: BoolArray


class Regions(NamedTuple):
    """Convex parts of the regions; ``atom`` names the proposition of each part."""

    faces: Faces
    atom: IntArray


class Logic(NamedTuple):
    """The automaton on the cells' letters: ``delta`` (Q, C + 1), the last column for no label (obstacles, off
    the map); ``distance`` d_A (Q,), inf in the trap,
    ``covers`` (Q, Q): ``covers[q, p]`` iff q accepts all that p accepts (q >= p)."""

    delta: IntArray
    distance: FloatArray
    covers: BoolArray
    initial: int


class Tables(NamedTuple):
    """Everything about the problem. ``z`` is the quantile of 1 - epsilon / m of Eq. (9)."""

    wind: Wind
    motion: Motion
    obstacles: Faces
    cells: Cells
    regions: Regions
    logic: Logic
    z: float
