"""Importance sampling of rare failures: the computations for each flight.

A flight is a vector z ~ N(0, I): its start, the white part of its winds, the innovations of its field and the
coefficients κ of the robot's own errors. In the law linearised about the plan, its deviation e is a linear
function of z, so a half-space of deviations is a half-space of z, ω' z >= τ with |ω| = 1.
``tests/oracle/importance.py`` has the same in plain Python.
"""

from __future__ import annotations

from typing import NamedTuple

from pareto_ltl.kernels.interpolation import F32
from pareto_ltl.support.arrays import Float32Array, FloatArray, IntArray
from typed_kernels.jit import allocating, vector


class LinearLaw(NamedTuple):
    """The coherent law linearised about a path of T steps, e' = F e + dt (ψ' θ + E κ + white).

    ``F`` (T, 2, 2); ``psi`` (T, 2, P) [m/s]; ``white`` (T, 2): standard deviations [m/s]; ``epoch`` (T,):
    the epoch of the field at each step; ``kept`` (E, P): the share of θ that is kept at the beginning of each
    epoch, 0 for the first; ``dt`` [s]; ``start_sd`` [m]; ``push`` (T, 2, Q) = E [m/s]; ``lean``
    (2, Q): the part of the start by κ [m].
    """

    F: FloatArray
    psi: Float32Array
    white: FloatArray
    epoch: IntArray
    kept: Float32Array
    dt: float
    start_sd: float
    push: FloatArray
    lean: FloatArray


class NormalDraws(NamedTuple):
    """z of n flights: ``start`` (n, 2), ``white`` (T, n, 2), innovations ``field`` (E, n, 2, P) of θ, and κ.

    ``errors`` (n, Q) = κ.
    """

    start: FloatArray
    white: FloatArray
    field: Float32Array
    errors: FloatArray


class Directions(NamedTuple):
    """Unit vectors ω of J half-spaces of z, split as in :class:`NormalDraws`.

    ``start`` (J, 2), ``white`` (J, T, 2), ``field`` (J, E, 2, P), ``errors`` (J, Q).
    """

    start: FloatArray
    white: FloatArray
    field: FloatArray
    errors: FloatArray


class Mixture(NamedTuple):
    """Density ratio of the proposal to N(0, I): plain + Σ_l share_il #{j : c_i ω_j' z >= level_l τ_j}.

    Half-space j has τ = ``threshold[j]``, and ω_j' z = Σ_k ``weight[k]``' e at ``step[k]`` over the rows k
    from ``ptr[j]`` to ``ptr[j + 1]``. ``level`` (L,) descends from 1. Flight i has the ``scale`` c_i (n,) of
    its errors, and the ``share`` (n, L).
    """

    ptr: IntArray
    step: IntArray
    weight: FloatArray
    threshold: FloatArray
    level: FloatArray
    scale: FloatArray
    share: FloatArray
    plain: float


@allocating
def push_draws(directions: Directions, event: IntArray, size: FloatArray, draws: NormalDraws) -> None:
    """Shift the draws z of flight i along ω of half-space ``event[i]`` to ω' z = ``size[i]``; -1: none."""
    for i in range(len(event)):
        j = event[i]
        if j < 0:
            continue
        push = size[i] - along_direction(directions, j, draws, i)
        for c in range(2):
            draws.start[i, c] += push * directions.start[j, c]
            for t in range(len(draws.white)):
                draws.white[t, i, c] += push * directions.white[j, t, c]
            for k in range(len(draws.field)):
                for m in range(draws.field.shape[3]):
                    draws.field[k, i, c, m] += F32(push * directions.field[j, k, c, m])
        for q in range(draws.errors.shape[1]):
            draws.errors[i, q] += push * directions.errors[j, q]


@vector
def along_direction(directions: Directions, j: int, draws: NormalDraws, i: int) -> float:
    """ω_j' z of flight ``i``."""
    total = 0.0
    for c in range(2):
        total += directions.start[j, c] * draws.start[i, c]
        for t in range(len(draws.white)):
            total += directions.white[j, t, c] * draws.white[t, i, c]
        for k in range(len(draws.field)):
            for m in range(draws.field.shape[3]):
                total += directions.field[j, k, c, m] * draws.field[k, i, c, m]
    for q in range(draws.errors.shape[1]):
        total += directions.errors[j, q] * draws.errors[i, q]
    return total


@allocating
def mixture_density(mixture: Mixture, e: FloatArray, density: FloatArray) -> None:
    """Fill ``density`` (n,), the density ratio of :class:`Mixture`, for deviations ``e`` (n, T+1, 2) [m].

    Eq. (M64) of docs/mathematics_methods.md.
    """
    ptr, step, weight = mixture.ptr, mixture.step, mixture.weight
    threshold, level, scale, share = mixture.threshold, mixture.level, mixture.scale, mixture.share
    for i in range(len(e)):
        total = mixture.plain
        for j in range(len(threshold)):
            reached = 0.0
            for k in range(ptr[j], ptr[j + 1]):
                reached += weight[k, 0] * e[i, step[k], 0] + weight[k, 1] * e[i, step[k], 1]
            reached *= scale[i]
            for l in range(len(level) - 1, -1, -1):  # noqa: E741
                if reached < level[l] * threshold[j]:
                    break
                total += share[i, l]
        density[i] = total
