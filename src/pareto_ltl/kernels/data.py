"""What kernels read: named tuples, so that loops say ``wind.mean`` and ``here.cov``, not ``arr[3]``.

Models are named tuples too, and their types pick the code (``jit.by_type``): a wind law, a mission bound and
a collision bound. Memory that a model does not need is None.
"""

from __future__ import annotations

from typing import Any, NamedTuple, TypeAlias

from pareto_ltl.support.arrays import BoolArray, Float32Array, FloatArray, Int32Array, IntArray

# --- geometry ---------------------------------------------------------------------------------


class Point(NamedTuple):
    """A place in the plane [m]."""

    x: float
    y: float


class Cov(NamedTuple):
    """A symmetric 2 x 2 matrix, mostly the covariance of a position [m²]."""

    xx: float
    xy: float
    yy: float


class Gaussian(NamedTuple):
    """A position: mean [m] and covariance [m²]."""

    mean: Point
    cov: Cov


class Linear(NamedTuple):
    """A 2 x 2 matrix, row by row."""

    xx: float
    xy: float
    yx: float
    yy: float


class Square(NamedTuple):
    """The square (i, j) of a lattice that holds a place, and the fractions (fx, fy) within it."""

    i: int
    j: int
    fx: float
    fy: float


class Ahead(NamedTuple):
    """One step ahead: mean with zero airspeed, covariance, and the airspeed left for the control [m/s]."""

    mean: Point
    cov: Cov
    speed: float


# --- the map ----------------------------------------------------------------------------------


class Faces(NamedTuple):
    """Convex polygons by their half planes ``normal' x <= offset``; one face alone is a half plane.

    Polygon j owns rows ``ptr[j]`` to ``ptr[j + 1]``; ``normal`` (F, 2) points outwards, unit length.
    """

    ptr: IntArray
    normal: FloatArray
    offset: FloatArray


class Nearby(NamedTuple):
    """Which of the polygons in :class:`Faces` are near a place, by a grid of squares over the map.

    ``order`` (B, m) lists the m polygons of square i * rows + j, ``gap`` (B, m) how far the square's middle
    lies beyond that of their faces which it is farthest beyond [m], ascending and rounded down; ``owner``
    (F,) is the polygon of a face.
    """

    west: float
    south: float
    side: float
    columns: int
    rows: int
    order: Int32Array
    gap: Float32Array
    owner: Int32Array


class Corners(NamedTuple):
    """Polygons as corners ``corner[ptr[k]:ptr[k + 1]]``, counter-clockwise.

    Each lies within ``radius`` of ``middle`` (L, 2); ``cell`` (L,) are their numbers.
    """

    cell: IntArray
    middle: FloatArray
    radius: FloatArray
    ptr: IntArray
    corner: FloatArray


class Cells(NamedTuple):
    """Convex cells with a bucket grid in front.

    Bucket k lists its candidate cells in ``candidates[ptr[k]:ptr[k + 1]]``.
    """

    west: float
    south: float
    east: float
    north: float
    buckets: int
    ptr: IntArray
    candidates: IntArray
    faces: Faces


class Logic(NamedTuple):
    """The automaton on the letters that cells show, in every epoch.

    An epoch is a span of steps in which the same propositions with time windows hold. Without windows there
    is one.

    ``epoch`` (S + 1,) is that of each step, the last one of all later steps; ``delta`` (E, Q, C + 1), the
    last column for no label (obstacles, off the map); ``distance`` d_A (Q,), inf in the trap, ``ahead``
    (E, Q) that of the letters which an epoch and later ones show; ``covers`` (Q, Q): ``covers[q, p]`` iff
    q accepts all that p accepts (q >= p).

    On the way from step to step letters that lead away from acceptance are read, and take q to ``way``
    (E, Q, C + 1), in states that the label of the step before leaves as they are.
    ``harm`` (E, Q, C + 1): the label is worse in q than no label, or ends in the trap; ``hazards`` are the
    cells that harm in some state of some epoch; ``loses`` (E, Q, C + 1): meeting the label may take a state
    as good as q to one that is not.
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


# --- wind and motion --------------------------------------------------------------------------


class Wind(NamedTuple):
    """Wind on a lattice; step n lies between slots ``slot[n]`` and ``slot[n] + 1`` at ``weight[n]``.

    ``mean``, ``latent`` (K, NX, NY, 2); ``gust`` (K, 2); ``slot``, ``weight`` (S,), S the number of
    steps for which the data reach; ``between`` (S,) the variance of interpolation in time.
    """

    west: float
    south: float
    per_metre: float
    slot: IntArray
    weight: FloatArray
    mean: FloatArray
    latent: FloatArray
    gust: FloatArray
    between: FloatArray


class Modes(NamedTuple):
    """Coherent wind: step n meets mode slot ``slot[n]`` times ``scale[n]``; G parts of the error persist.

    θ of the modes of part g keeps the share ``keep[n, g]`` (S + 1, G) of step n - 1; ``epoch`` (S,) counts
    the steps where any keeps less than all. ``part`` (P,) of each mode, ``kept`` (S + 1, P) and ``scale``
    (S, P) by mode; ``psi`` (K, MX, MY, 2, P) on the lattice of the modes, P = 0 where nothing is uncertain;
    on the lattice of the mean ``slope`` (K, NX, NY, 4) = ∂μ_x/∂x, ∂μ_x/∂y, ∂μ_y/∂x, ∂μ_y/∂y and ``bend``
    (K, NX, NY, 6) = the second derivatives xx, xy, yy of μ_x, then of μ_y. ``white`` is the variance of a
    step's mean gust over that of a gust, ``rest`` the same for what the modes leave of the smooth part.
    """

    west: float
    south: float
    per_metre: float
    slot: IntArray
    epoch: IntArray
    keep: FloatArray
    part: IntArray
    kept: Float32Array
    scale: Float32Array
    psi: Float32Array
    slope: FloatArray
    bend: FloatArray
    white: float
    rest: float


class Motion(NamedTuple):
    """x' = A x + dt B (u + feedback) + dt w,    u_min ≤ ‖u + feedback‖ ≤ u_max.

    ``a`` = A, ``b`` = B, ``b_inv`` = B^-1; ``closed`` = A - K I moves deviations, ``gain`` = K; ``effort``
    is the quantile that keeps the feedback within u_min and u_max; ``ball`` is the radius of the
    maximum-trace rule in standard deviations.
    """

    a: FloatArray
    closed: FloatArray
    gain: float
    effort: float
    b: FloatArray
    b_inv: FloatArray
    dt: float
    u_min: float
    u_max: float
    ball: float


class Landmarks(NamedTuple):
    """Convex polygons in which the robot learns its position: by faces and by corners.

    ``gain`` is the share of a known deviation flown back in a step, ``variance`` that of a position fix
    [m²], ``risk`` the largest probability of missing a landmark that a plan counts on.
    """

    faces: Faces
    corners: Corners
    gain: float
    variance: float
    risk: float


# --- models: wind laws and what a path or tree remembers for them ------------------------------


class IndependentLaw(NamedTuple):
    """The paper's law: every step draws its wind anew. It needs no memory (None)."""

    wind: Wind
    motion: Motion


class CoherentLaw(NamedTuple):
    """One flight meets one field, w(x) = μ(x) + ψ(x)' θ."""

    wind: Wind
    modes: Modes
    motion: Motion


class LandmarkLaw(NamedTuple):
    """The coherent law with position fixes at landmarks."""

    wind: Wind
    modes: Modes
    motion: Motion
    landmarks: Landmarks


class CoherentMemory(NamedTuple):
    """Row v is what the children of v start from: ``theta`` (N, 2, 2, P) = Cov(e, θ)."""

    theta: Float32Array


class LandmarkMemory(NamedTuple):
    """Row v is what the children of v start from.

    ``theta`` (N, 2, 2, P) = Cov(ẽ, θ̃), ``known`` (N, 3) = Cov(ê), the last fix ``fix`` (N,) and ``faded``
    (N, G), the s of it. Fix f has ``gain`` (M, 2, 2, P) = D, the fix before it ``previous`` and the ``share``
    (M, G) that the latter had then; ``used`` (1,) fixes are in use.
    """

    theta: Float32Array
    known: FloatArray
    fix: IntArray
    faded: FloatArray
    gain: Float32Array
    previous: IntArray
    share: FloatArray
    used: IntArray


Law: TypeAlias = IndependentLaw | CoherentLaw | LandmarkLaw
Memory: TypeAlias = CoherentMemory | LandmarkMemory | None


# --- models: mission bounds -------------------------------------------------------------------


class Theorem2(NamedTuple):
    """The paper's f_o. All cells, the automaton.

    ``faces`` are those of the convex parts of the regions, ``atom`` the proposition of each part, ``holds``
    (E, C, P) which propositions hold in a cell in each epoch of ``logic``. Its memory is None: the risks of
    the propositions are the vertex's own objectives.
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
    """The ordered bound V: cells that show a label, all cells, the automaton.

    ``targets`` are the states that an entry of V at q is followed to, ``begin`` those of the first entries
    (:mod:`pareto_ltl.kernels.ordered_bound`); the lists of a large automaton are empty. States of one
    ``kind`` (Q,) are lost by the same labels.
    """

    labelled: Corners
    cells: Cells
    logic: Logic
    targets: StateLists
    begin: IntArray
    kind: IntArray


class LiveRows(NamedTuple):
    """Rows of entries (automaton state, V), which rows may share.

    Those of row v begin at ``first[v]`` of ``state`` and ``value``, and there are ``size[v]``, at most
    ``most``. Places from ``used[0]`` on are free. -1 in ``first`` is a row that has no places yet.
    """

    first: IntArray
    size: Int32Array
    state: Int32Array
    value: FloatArray
    used: IntArray
    most: int


class Letters(NamedTuple):
    """What may be read in one step, that of ``epoch`` (1,), and scratch.

    ``seen`` (L + 1,) = P(each label), last no label; ``met`` (H,) = P(each hazard met). Scratch: ``parts``
    and ``hazards`` list those above 0, ``listed`` (2,) of each, and ``place`` (Q,) is the number of a state's
    entry, -1 where it has none.
    """

    seen: FloatArray
    met: FloatArray
    parts: IntArray
    hazards: IntArray
    listed: IntArray
    place: Int32Array
    epoch: IntArray


class OrderedMemory(NamedTuple):
    """``rows`` of V; ``letters`` is scratch, None in trees.

    Of two scratch rows ``same`` (2,) is the tree's row that V is equal to, -1 where the entries are its own.
    """

    rows: LiveRows
    same: IntArray
    letters: Any


MissionBound: TypeAlias = Theorem2 | Ordered


# --- models: collision bounds -----------------------------------------------------------------


class StepBound(NamedTuple):
    """Eqs. (9) and (10): equal shares of epsilon for the m barriers (obstacles and walls).

    ``z`` is the quantile of 1 - epsilon / m. Nothing is remembered (None).
    """

    barriers: Faces
    nearby: Nearby
    z: float


class PathBound(NamedTuple):
    """R of whole paths: ``epsilon`` allowed at a step by all barriers together, ``delta`` on a path."""

    barriers: Faces
    nearby: Nearby
    epsilon: float
    delta: float


class PathMemory(NamedTuple):
    """Runs that cost something, up to K a row.

    ``face`` (N, K) separates the steps of each, -1 after the last; ``run`` (N, K, 3): Σ p, least gap and
    largest variance of the steps in a row with this face.
    """

    face: Int32Array
    run: Float32Array


CollisionBound: TypeAlias = StepBound | PathBound
CollisionMemory: TypeAlias = PathMemory | None


class World(NamedTuple):
    """Everything about the problem: what is planned with, by type.

    The cells and the automaton are those of the mission bound, and stand in it alone: kernels hand the world
    on by value, and a second copy made trees of ``fidelity=full`` twice as slow.
    """

    law: Law
    mission: MissionBound
    collision: CollisionBound
