"""Input of kernels as named tuples, so that loops read ``wind.mean``, not ``arr[3]``.

Models (a wind law here, a mission bound of :mod:`plane_logic`, a collision bound of :mod:`plane_kernels`) are
named tuples too, and their types select the code (``typed_kernels.jit.by_type``). Memory that a model does
not need is None.
"""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy as np

from pareto_ltl.support.arrays import BoolArray, Float32Array, FloatArray, IntArray
from plane_kernels.types import CollisionBound, Corners, Cov, Faces, Point
from plane_logic.types import MissionBound


class RobotErrors(NamedTuple):
    """Law of the errors of a robot's airspeed [relative], heading [rad] and clock [s], one for a flight.

    They are ``mean`` (Q,) + ``root`` (Q, Q) κ with κ ~ N(0, I) and a lower triangular root of their
    covariance; Q = 3, or 0 for a robot without errors. The start deviates by ``start`` (2, Q) κ [m], if a fix
    shows both, and beyond it independently.
    """

    mean: FloatArray
    root: FloatArray
    start: FloatArray


EXACT = RobotErrors(np.zeros(0), np.zeros((0, 0)), np.zeros((2, 0)))  # a robot without errors


# --- wind and motion --------------------------------------------------------------------------


class Square(NamedTuple):
    """The square (i, j) of a lattice that contains a point, and the fractions (fx, fy) within it."""

    i: int
    j: int
    fx: float
    fy: float


class Ahead(NamedTuple):
    """One step ahead: mean with zero airspeed [m], covariance [m²], airspeed left for the control [m/s]."""

    mean: Point
    cov: Cov
    speed: float


class Wind(NamedTuple):
    """Wind on a lattice; step n is interpolated between slots ``slot[n]`` and ``slot[n] + 1``, ``weight[n]``.

    ``mean`` (K, NX, NY, 2): expected wind [m/s]; ``latent`` (K, NX, NY, 2): variance of its smooth error
    [m²/s²]; ``gust`` (K, 2): variance of the white part [m²/s²]; ``slot``, ``weight`` (S,), where S is the
    number of steps that the data cover; ``between`` (S,): variance of interpolation in time [m²/s²];
    ``per_metre`` = 1 / spacing of the lattice.
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
    """Modes of the coherent wind error, in G parts that differ in persistence.

    At step n the modes are ``psi[slot[n]]`` times ``scale[n]``: ``slot`` (S,), ``scale`` (S, P), ``psi`` (K,
    MX, MY, 2, P) on the lattice of the modes [m/s]; P = 0 if the wind is known. The coefficients θ of the
    modes of part g keep the share ``keep[n, g]`` (S + 1, G) of their value at step n - 1; ``kept`` (S + 1, P)
    is the same by mode, ``part`` (P,) the part of each mode; ``epoch`` (S,) is the number of changes of θ up
    to each step. On the lattice of the expected wind, ``slope`` (K, NX, NY, 4) = ∂μ_x/∂x, ∂μ_x/∂y, ∂μ_y/∂x,
    ∂μ_y/∂y and ``bend`` (K, NX, NY, 6) = the second derivatives xx, xy, yy of μ_x, then of μ_y. ``white`` is
    the variance of a gust averaged over a step, relative to the variance of the gust, ``rest`` the same ratio
    for the smooth error that the modes do not represent.
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

    ``a`` = A, ``b`` = B, ``b_inv`` = B^-1; ``gain`` = K; ``closed`` = A - K I propagates deviations;
    ``exposed`` is the share of a step's wind error that feedback leaves, 1 without it; ``effort`` is the
    quantile r / √λ of :func:`~pareto_ltl.kernels.motion.airspeed_left`, which reserves airspeed for
    feedback; ``ball`` is the radius of the maximum-trace rule in standard deviations.
    """

    a: FloatArray
    closed: FloatArray
    gain: float
    exposed: float
    effort: float
    b: FloatArray
    b_inv: FloatArray
    dt: float
    u_min: float
    u_max: float
    ball: float


class Landmarks(NamedTuple):
    """Convex polygons in which the robot measures its position: as faces and as corners.

    ``disc`` (K, 3) is the middle of each and the distance of its farthest corner [m], ``cov`` (K, 3) the
    covariance (xx, xy, yy) of the error of its fix [m²], ``gain`` the share of a known deviation that is
    corrected in one step.
    """

    faces: Faces
    corners: Corners
    disc: FloatArray
    cov: FloatArray
    gain: float


# --- models: wind laws and their memory for a path or tree -------------------------------------


class IndependentLaw(NamedTuple):
    """The paper's law: the wind of every step is drawn independently. Its memory is None."""

    wind: Wind
    motion: Motion


class CoherentLaw(NamedTuple):
    """The coherent law: a flight meets one wind field, w(x) = μ(x) + ψ(x)' θ plus white noise.

    ``errors`` is the law of the robot's own errors, which last for the whole flight.
    """

    wind: Wind
    modes: Modes
    motion: Motion
    errors: RobotErrors = EXACT


class LandmarkLaw(NamedTuple):
    """The coherent law with position fixes at landmarks."""

    wind: Wind
    modes: Modes
    motion: Motion
    landmarks: Landmarks
    errors: RobotErrors = EXACT


class FlightErrors(NamedTuple):
    """The robot's own errors along a path of T steps, linear in Q coefficients κ ~ N(0, I).

    ``law`` is their law; ``push`` (T, 2, Q) = E_t, the velocity over ground by each
    coefficient [m/s]; ``cross`` (T+1, 2, Q) = Cov(e_t, κ) [m], after the fixes before t; ``gain`` (M, 2, Q) =
    D of fix f, as in :class:`LandmarkMemory`. ``x`` (T+1, 2) and ``u`` (T, 2) are the means and controls of
    the path; ``steered`` (1,) whether its controls are given, or else its means.
    """

    law: RobotErrors
    push: FloatArray
    cross: FloatArray
    gain: FloatArray
    x: FloatArray
    u: FloatArray
    steered: BoolArray


class CoherentMemory(NamedTuple):
    """Row t is the input for step t + 1: ``theta`` (T+1, 2, 2, P) = Cov(e, θ)."""

    theta: Float32Array


class LandmarkMemory(NamedTuple):
    """Row t is the input for step t + 1.

    ``at`` (N, 2) is the mean [m], ``chance`` (N,) the probability of the fix that it counts on, 0 for none;
    ``theta`` (N, 2, 2, P) = Cov(ẽ, θ̃); ``known`` (N, 3) = Cov(ê). Fix f has ``gain`` (M, 2, 2, P) = s D
    (:mod:`~pareto_ltl.kernels.fixes`), which fades from step to step. ``used`` (1,) is the number of fixes
    stored. ``errors`` are the robot's errors, ``psi`` (2, P) memory for ψ at one place.
    """

    at: FloatArray
    chance: FloatArray
    theta: Float32Array
    known: FloatArray
    gain: Float32Array
    used: IntArray
    errors: FlightErrors
    psi: Float32Array


Law: TypeAlias = IndependentLaw | CoherentLaw | LandmarkLaw
Memory: TypeAlias = CoherentMemory | LandmarkMemory | None


# --- all models ---------------------------------------------------------------------------------


class World(NamedTuple):
    """The planning problem: its three models, whose types select the code.

    Cells and automaton are fields of the mission bound only: kernels pass the world by value, and a second
    copy of them made the growth of trees with ``fidelity=full`` twice as slow.
    """

    law: Law
    mission: MissionBound
    collision: CollisionBound
