"""What the kernels read: named tuples of arrays, so that loops say ``wind.mean``, not ``arr[3]``."""

from __future__ import annotations

from typing import NamedTuple

from pareto_ltl.support.arrays import BoolArray, Float32Array, FloatArray, IntArray


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


class Modes(NamedTuple):
    """Coherent wind: step n meets mode slot ``slot[n]``, where θ has kept the share ``keep[n]`` of step n -
    1.

    ``psi`` (K, MX, MY, 2, P) on the modes' own lattice, P = 0 where nothing is uncertain; on the lattice of
    the mean ``slope`` (K, NX, NY, 4) = ∂μ_x/∂x, ∂μ_x/∂y, ∂μ_y/∂x, ∂μ_y/∂y and ``bend`` (K, NX, NY, 6) = the
    second derivatives xx, xy, yy of μ_x, then of μ_y. ``white`` is the variance of a step's mean gust over
    that of a gust.
    """

    west: float
    south: float
    per_metre: float
    slot: IntArray
    keep: FloatArray
    psi: Float32Array
    slope: FloatArray
    bend: FloatArray
    white: float


class Motion(NamedTuple):
    """x' = A x + dt B (u + feedback) + dt w. ``a`` = A, ``b_inv`` = B^-1, ``closed`` = A - K I moves
    deviations,
    ``gain`` = K, ``effort`` the quantile that keeps the feedback within u_max, ``ball`` the radius of the
    maximum-trace rule in standard deviations."""

    a: FloatArray
    closed: FloatArray
    gain: float
    effort: float
    fix_gain: float  # share of a known deviation flown back in a step
    fix_variance: float  # of a position fix [m²]
    fix_risk: float  # largest probability of missing a landmark that a plan counts on
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
    spoils: (
        BoolArray  # (Q, C + 1, Q): reading the label in q does not lead to a state that accepts all p accepts
    )
    initial: int


class Labelled(NamedTuple):
    """Cells that show a label, one after another as ``corner[ptr[k]:ptr[k + 1]]``, counter-clockwise, each
    within
    ``radius`` of ``middle`` (L, 2); ``cell`` (L,) are their numbers."""

    cell: IntArray
    middle: FloatArray
    radius: FloatArray
    ptr: IntArray
    corner: FloatArray


class Tables(NamedTuple):
    """Everything about the problem. ``z`` is the quantile of 1 - epsilon / m of Eq. (9)."""

    wind: Wind
    modes: Modes
    motion: Motion
    obstacles: Faces
    cells: Cells
    regions: Regions
    labelled: Labelled
    landmarks: Faces
    spots: Labelled  # their corners
    logic: Logic
    z: float
    epsilon: float  # collision probability allowed at a step
    delta: float  # and on a path, of full fidelity
    full: bool  # whether vertices carry coherent covariances, V and R instead of the paper's
