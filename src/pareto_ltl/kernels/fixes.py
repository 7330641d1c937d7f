"""Position fixes at landmarks: the expected covariance of a robot that may measure its position.

A robot inside a landmark measures its position, which also gives information on the wind field (a Kalman
update of (e, θ) by y = e + ν). From then on it knows a part of its deviation, e = ê + ẽ: it corrects a share
κ of ê in every step and steers against the wind ψ' θ̂ that it now expects. The unknown part propagates as
before, with the remaining Cov(θ),

    ẽ' = F ẽ + dt (ψ' θ̃ + gust),    Cov(θ̃) = I - Σ_f p_f s_f² D_f' D_f,    D = L⁻¹ C,  L L' = Σ̃ + R_f,
    ê' = (F - κ) ê,                  Cov(e) = Cov(ẽ) + Cov(ê)   (orthogonal),

where s_f is the product of ρ since fix f, by which its D is multiplied step by step, p_f the probability that
the robot is inside the landmark. The update with the weight p is the expected covariance of a filter whose
measurement arrives with that probability (Sinopoli et al., IEEE Trans. Automat. Contr. 49, 2004,
doi:10.1109/TAC.2004.834121). It is smooth in the path, and the Gaussian that corridors and chance
constraints see; the failure rate of a plan comes from flights whose filters take each fix or not
(:mod:`pareto_ltl.kernels.navigator`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pareto_ltl.kernels.data import Ahead, LandmarkLaw, LandmarkMemory, Landmarks, Modes, Square
from pareto_ltl.kernels.interpolation import F32, corner_weights, dot, mode_square, mode_value, wind_at
from pareto_ltl.kernels.motion import scaled_cov
from pareto_ltl.kernels.propagation import (
    advance,
    carry,
    clear_theta,
    closed_loop,
    forget,
)
from pareto_ltl.kernels.robot_errors import (
    add_errors,
    begin_errors,
    expected_error,
    learn_errors,
    subtract_errors,
)
from pareto_ltl.support.arrays import Float32Array
from plane_kernels.gaussian import FixWeights, fix_weights
from plane_kernels.polygon import polygon_probability
from plane_kernels.types import Cov, Gaussian, Linear, Point
from typed_kernels.jit import implements, inlined, kernel, vector

OUTSIDE = 5.0  # deviations beyond which a landmark is out of reach
WORTHWHILE = 0.01  # share of the unknown variance: fixes that take less are ignored
FORGOTTEN = F32(1e-12)  # s D below this is 0: numbers below 1e-38 would take a hundred times as long


@kernel
def segment_share(begin: Point, end: Point, x: float, y: float) -> float:
    """The share s in [0, 1] of the segment at which it is nearest to (x, y)."""
    dx, dy = end.x - begin.x, end.y - begin.y
    size = dx * dx + dy * dy
    if size == 0.0:
        return 1.0
    return min(max(((x - begin.x) * dx + (y - begin.y) * dy) / size, 0.0), 1.0)


class Sight(NamedTuple):
    """The landmark that a step most probably crosses: its number, P(inside), and the share of the step."""

    number: int
    chance: float
    share: float


@kernel
def likely_sight(marks: Landmarks, begin: Point, here: Gaussian) -> Sight:
    """The most probable landmark on the segment from ``begin`` to the Gaussian ``here``; -1 for none.

    P(inside) is computed for the Gaussian moved to the point of the segment nearest to the landmark's middle.

    Eq. (M29) of docs/mathematics.md.
    """
    best = Sight(-1, 0.0, 1.0)
    cov = here.cov
    if cov.xx <= 0.0 or cov.yy <= 0.0:
        return best
    reach = OUTSIDE * math.sqrt(cov.xx + cov.yy)
    for k in range(len(marks.disc)):
        mx, my, radius = marks.disc[k, 0], marks.disc[k, 1], marks.disc[k, 2]
        s = segment_share(begin, here.mean, mx, my)
        x, y = begin.x + s * (here.mean.x - begin.x), begin.y + s * (here.mean.y - begin.y)
        if (x - mx) * (x - mx) + (y - my) * (y - my) < (radius + reach) * (radius + reach):
            chance = polygon_probability(marks.corners, k, Gaussian(Point(x, y), cov))
            if chance > best.chance:
                best = Sight(k, chance, s)
    return best


@kernel
def fix_error(law: LandmarkLaw, step: int, sight: Sight, at: Point) -> Cov:
    """Covariance R [m²] of a fix as known at the end of the step: its error and the drift since then."""
    cov, since = law.landmarks.cov, (1.0 - sight.share) * law.motion.dt
    ve, vn = wind_at(law.wind.latent, law.wind, max(step - 1, 0), at)
    k, time2 = sight.number, since * since
    return Cov(cov[k, 0] + time2 * ve, cov[k, 1], cov[k, 2] + time2 * vn)


@implements(forget, LandmarkLaw)
def _forget_fixes(_law: LandmarkLaw, memory: LandmarkMemory) -> None:
    clear_theta(memory.theta)
    memory.known[0, 0], memory.known[0, 1], memory.known[0, 2] = 0.0, 0.0, 0.0
    memory.at[0, 0], memory.at[0, 1], memory.chance[0] = 0.0, 0.0, 0.0
    memory.used[0] = 0
    begin_errors(memory.errors)


@implements(advance, LandmarkLaw)
def _advance_with_fixes(
    law: LandmarkLaw, memory: LandmarkMemory, step: int, here: Gaussian, row: int, target: int
) -> Ahead:
    motion, marks, at = law.motion, law.landmarks, here.mean
    known = Cov(memory.known[row, 0], memory.known[row, 1], memory.known[row, 2])
    unknown = without(here.cov, known)
    begin = Point(memory.at[row, 0], memory.at[row, 1]) if step > 0 else at
    memory.at[target, 0], memory.at[target, 1], memory.chance[target] = at.x, at.y, 0.0
    if row != target:
        copy_theta(memory.theta, row, target)
    sight = likely_sight(marks, begin, here)
    if sight.chance > 0.0 and memory.used[0] < len(memory.gain):
        error = fix_error(law, step, sight, at)
        if sight.chance * variance_gained(unknown, error) > WORTHWHILE * (unknown.xx + unknown.yy):
            f = memory.used[0]
            memory.used[0] += 1
            memory.chance[target] = sight.chance
            weights = fix_weights(unknown, error)
            learn(memory, target, f, weights, sight.chance)
            learn_errors(memory.errors, step, f, weights, sight.chance)
            gained = covariance_gained(weights.gain, unknown, sight.chance)
            known = Cov(known.xx + gained.xx, known.xy + gained.xy, known.yy + gained.yy)
            unknown = without(unknown, gained)
    mean, cov = carry(law, step, Gaussian(at, unknown), memory.theta, target, target)
    cov = add_errors(memory.errors, motion, step, closed_loop(law, step, at), mean, cov)
    steered = steer_against(law, memory, step, at, target)
    after = known_after(closed_loop(law, step, at), marks.gain, known)
    memory.known[target, 0], memory.known[target, 1], memory.known[target, 2] = after
    against = scaled_cov(motion.dt * motion.dt, steered)
    total = Cov(
        cov.xx - against.xx + after.xx,
        cov.xy - against.xy + after.xy,
        cov.yy - against.yy + after.yy,
    )
    return Ahead(mean, total, motion.u_max)


@kernel
def variance_gained(unknown: Cov, error: Cov) -> float:
    """Trace of Σ̃ (Σ̃ + R)⁻¹ Σ̃ [m²], what a certain fix would take from the unknown variance."""
    a, b, c = unknown.xx + error.xx, unknown.xy + error.xy, unknown.yy + error.yy
    det = a * c - b * b
    if det <= 0.0:
        return 0.0
    uxx, uxy, uyy = unknown
    xx = (c * uxx - b * uxy) * uxx + (a * uxy - b * uxx) * uxy
    yy = (c * uxy - b * uyy) * uxy + (a * uyy - b * uxy) * uyy
    return (xx + yy) / det


@kernel
def without(total: Cov, known: Cov) -> Cov:
    """Σ - Σ^ with variances of at least 0."""
    return Cov(max(total.xx - known.xx, 0.0), total.xy - known.xy, max(total.yy - known.yy, 0.0))


@kernel
def known_after(f: Linear, back: float, known: Cov) -> Cov:
    """Cov(ê') = (F - κ) Cov(ê) (F - κ)'.

    Eq. (M27) of docs/mathematics.md.
    """
    f00, f11 = f.xx - back, f.yy - back
    p0, p1 = f00 * known.xx + f.xy * known.xy, f00 * known.xy + f.xy * known.yy
    q0, q1 = f.yx * known.xx + f11 * known.xy, f.yx * known.xy + f11 * known.yy
    return Cov(p0 * f00 + p1 * f.xy, p0 * f.yx + p1 * f11, q0 * f.yx + q1 * f11)


@vector
def copy_theta(theta: Float32Array, row: int, target: int) -> None:
    """Copy row ``row`` of ``theta`` to row ``target``."""
    for r in range(2):
        for c in range(2):
            for m in range(theta.shape[3]):
                theta[target, r, c, m] = theta[row, r, c, m]


@vector
def learn(memory: LandmarkMemory, v: int, f: int, weights: FixWeights, chance: float) -> None:
    """Kalman update of row ``v`` of ``theta``, with the weights of Cov(ẽ); write √p D of fix ``f``.

    ``chance`` is p.

    Eq. (M26) of docs/mathematics.md.
    """
    l00, l10, l11, gain = weights
    root = math.sqrt(chance)
    i00, i10, i11 = F32(root / l00), F32(-root * l10 / (l00 * l11)), F32(root / l11)
    k00, k01 = F32(chance * gain.xx), F32(chance * gain.xy)
    k10, k11 = F32(chance * gain.yx), F32(chance * gain.yy)
    theta = memory.theta
    for w in range(2):
        for m in range(theta.shape[3]):
            p, q = theta[v, 0, w, m], theta[v, 1, w, m]
            memory.gain[f, 0, w, m] = i00 * p
            memory.gain[f, 1, w, m] = i10 * p + i11 * q
            theta[v, 0, w, m] = p - k00 * p - k01 * q
            theta[v, 1, w, m] = q - k10 * p - k11 * q


@kernel
def covariance_gained(gain: Linear, unknown: Cov, chance: float) -> Cov:
    """p Σ̃ S⁻¹ Σ̃ [m²], the covariance that moves from the unknown to the known part."""
    uxx, uxy, uyy = unknown
    return Cov(
        chance * (gain.xx * uxx + gain.xy * uxy),
        chance * (gain.xx * uxy + gain.xy * uyy),
        chance * (gain.yx * uxy + gain.yy * uyy),
    )


@kernel
def steer_against(law: LandmarkLaw, memory: LandmarkMemory, step: int, at: Point, target: int) -> Cov:
    """Subtract the wind and the robot's errors that are known from fixes from row ``target`` of ``theta``.

    Returns the covariance of the velocity by what is known [m²/s²]. What each fix has told fades by one step.

    Eq. (M28) of docs/mathematics.md.
    """
    modes, dt, psi = law.modes, law.motion.dt, memory.psi
    kept, theta = modes.kept[step + 1], memory.theta[target]
    xx, xy, yy = 0.0, 0.0, 0.0
    fill_wind_modes(modes, step, mode_square(modes, at), psi)
    for f in range(memory.used[0]):
        gain = memory.gain[f]
        e0, e1 = dot(psi[0], gain[0, 0]), dot(psi[0], gain[1, 0])
        n0, n1 = dot(psi[1], gain[0, 1]), dot(psi[1], gain[1, 1])
        e0 += expected_error(memory.errors, step, f, 0, 0)
        e1 += expected_error(memory.errors, step, f, 1, 0)
        n0 += expected_error(memory.errors, step, f, 0, 1)
        n1 += expected_error(memory.errors, step, f, 1, 1)
        xx, xy, yy = xx + e0 * e0 + e1 * e1, xy + e0 * n0 + e1 * n1, yy + n0 * n0 + n1 * n1
        subtract_fix(theta, gain, kept, (dt * e0, dt * e1, dt * n0, dt * n1))
        subtract_errors(memory.errors, step, f, 0, dt * e0, dt * n0)
        subtract_errors(memory.errors, step, f, 1, dt * e1, dt * n1)
    return Cov(xx, xy, yy)


@vector
def fill_wind_modes(modes: Modes, step: int, square: Square, psi: Float32Array) -> None:
    """Fill ``psi`` (2, P) with ψ(x) at a step [m/s]."""
    weights, slot, scale = corner_weights(square), modes.slot[step], modes.scale[step]
    for c in range(2):
        for m in range(psi.shape[1]):
            psi[c, m] = scale[m] * mode_value(modes.psi, slot, square, weights, c, m)


@inlined
def lasting(value: np.float32) -> np.float32:
    """``value``, or 0 if it is forgotten."""
    return value if abs(value) > FORGOTTEN else F32(0.0)


@vector
def subtract_fix(
    theta: Float32Array, gain: Float32Array, kept: Float32Array,
    moved: tuple[float, float, float, float],
) -> None:  # fmt: skip
    """Fade ``gain`` (2, 2, P) by ``kept`` (P,) and subtract it from ``theta`` (2, 2, P).

    Its rows are weighted by ``moved``: by the displacement [m] that each causes, east and then north.
    """
    e0, e1, n0, n1 = F32(moved[0]), F32(moved[1]), F32(moved[2]), F32(moved[3])
    for c in range(2):
        for m in range(theta.shape[2]):
            one, two = lasting(kept[m] * gain[0, c, m]), lasting(kept[m] * gain[1, c, m])
            theta[0, c, m] -= e0 * one + e1 * two
            theta[1, c, m] -= n0 * one + n1 * two
            gain[0, c, m], gain[1, c, m] = one, two
