"""Position fixes at landmarks: the coherent law of a robot that sometimes measures its position.

A robot inside a landmark measures its position, which also gives information on the wind field (a Kalman
update of (e, θ) by y = e + ν). From then on it knows a part of its deviation, e = ê + ẽ: it corrects a share
κ of ê in every step and steers against the wind ψ' θ̂ that it now expects. The unknown part propagates as
before, with the remaining Cov(θ),

    ẽ' = F ẽ + dt (ψ' θ̃ + gust),    Cov(θ̃) = I - Σ_f s_f² D_f' D_f,    D = L⁻¹ C,  L L' = Σ̃ + fix²,
    ê' = (F - κ) ê,                  Cov(e) = Cov(ẽ) + Cov(ê)   (orthogonal),

where s_f is the product of ρ since fix f, one for each part of the error. Missing the landmark counts as
failure: P(fail) <= P(miss) + P(fail with the fix), since flights that enter the landmark follow the law with
the fix.
"""

from __future__ import annotations

import math
from typing import TypeAlias

from pareto_ltl.kernels.data import (
    Ahead,
    CoherentLaw,
    CoherentMemory,
    Cov,
    Gaussian,
    IndependentLaw,
    LandmarkLaw,
    LandmarkMemory,
    Landmarks,
    Law,
    Linear,
    Memory,
    Modes,
    Point,
    Square,
)
from pareto_ltl.kernels.geometry import face_slack
from pareto_ltl.kernels.interpolation import F32, corner_weights, mode_square, mode_value
from pareto_ltl.kernels.jit import by_type, implements, kernel, vector
from pareto_ltl.kernels.polygon import polygon_probability
from pareto_ltl.kernels.propagation import (
    advance,
    carry,
    clear_theta,
    closed_loop,
    correction_quantile,
    forget,
    scaled_cov,
)
from pareto_ltl.support.arrays import Float32Array, FloatArray, IntArray

FADED = 1e-3  # fixes whose factors s are all below this are ignored
Shares: TypeAlias = tuple[float, float, float, float]  # factors s of a fix, one for each part of the error


@kernel
def shares_of(table: FloatArray, row: int) -> Shares:
    """Row ``row`` of ``table`` (N, 4)."""
    return table[row, 0], table[row, 1], table[row, 2], table[row, 3]


@kernel
def keep_shares(table: FloatArray, row: int, shares: Shares) -> None:
    """Write ``shares`` to row ``row`` of ``table`` (N, 4)."""
    for part in range(4):
        table[row, part] = shares[part]


@kernel
def faded_by(shares: Shares, table: FloatArray, row: int) -> Shares:
    """``shares`` times row ``row`` of ``table`` (N, 4)."""
    return (
        shares[0] * table[row, 0],
        shares[1] * table[row, 1],
        shares[2] * table[row, 2],
        shares[3] * table[row, 3],
    )


@kernel
def landmark_at(landmarks: Landmarks, at: Point) -> int:
    """Number of the landmark that contains a point, -1 for none."""
    for k in range(len(landmarks.faces.ptr) - 1):
        if face_slack(landmarks.faces, k, at) >= 0.0:
            return k
    return -1


@by_type
def fix_missed(law: Law, memory: Memory, row: int, here: Gaussian) -> float:
    """P(landmark missed) if the plan relies on a fix at ``here``, else -1.

    Eq. (M29) of docs/mathematics.md.
    """
    raise NotImplementedError


@implements(fix_missed, IndependentLaw, CoherentLaw)
def _no_fix(
    _law: IndependentLaw | CoherentLaw, _memory: CoherentMemory | None, _row: int, _here: Gaussian
) -> float:
    return -1.0


@implements(fix_missed, LandmarkLaw)
def _fix_missed(law: LandmarkLaw, memory: LandmarkMemory, row: int, here: Gaussian) -> float:
    # The plan relies on a fix only if at least half of the variance is unknown. So a robot that crosses a
    # landmark in several steps relies on the first fix.
    cov = here.cov
    if 2.0 * (memory.known[row, 0] + memory.known[row, 2]) > cov.xx + cov.yy:
        return -1.0
    k = landmark_at(law.landmarks, here.mean)
    if k < 0 or cov.xx <= 0.0 or cov.yy <= 0.0:
        return -1.0
    miss = 1.0 - polygon_probability(law.landmarks.corners, k, here)
    return miss if miss <= law.landmarks.risk else -1.0


@implements(forget, LandmarkLaw)
def _forget_fixes(_law: LandmarkLaw, memory: LandmarkMemory) -> None:
    clear_theta(memory.theta)
    memory.known[0, 0], memory.known[0, 1], memory.known[0, 2] = 0.0, 0.0, 0.0
    memory.fix[0] = -1
    keep_shares(memory.faded, 0, (1.0, 1.0, 1.0, 1.0))
    memory.used[0] = 0


@implements(advance, LandmarkLaw)
def _advance_with_fixes(
    law: LandmarkLaw, memory: LandmarkMemory, step: int, here: Gaussian, row: int, target: int
) -> Ahead:
    motion, marks = law.motion, law.landmarks
    known = Cov(memory.known[row, 0], memory.known[row, 1], memory.known[row, 2])
    unknown = without(here.cov, known)
    fix, faded = memory.fix[row], shares_of(memory.faded, row)
    if row != target:
        copy_theta(memory.theta, row, target)
    if fix_missed(law, memory, row, here) >= 0.0 and memory.used[0] < len(memory.previous):
        f = memory.used[0]
        memory.used[0] += 1
        memory.previous[f] = fix
        keep_shares(memory.share, f, faded)
        gained = learn(memory, target, f, unknown, marks.variance)
        known = Cov(known.xx + gained.xx, known.xy + gained.xy, known.yy + gained.yy)
        unknown = without(unknown, gained)
        fix, faded = f, (1.0, 1.0, 1.0, 1.0)
    mean, cov = carry(law, step, Gaussian(here.mean, unknown), memory.theta, target, target)
    steered = steer_against(law, memory, step, here.mean, fix, faded, target)
    after = known_after(closed_loop(law, step, here.mean), marks.gain, known)
    memory.known[target, 0], memory.known[target, 1], memory.known[target, 2] = after
    memory.fix[target] = fix
    keep_shares(memory.faded, target, faded_by(faded, law.modes.keep, step + 1))
    share, both, dt2 = motion.gain * motion.gain, (motion.gain + marks.gain) ** 2, motion.dt * motion.dt
    returned = Cov(
        share * unknown.xx + both * known.xx,
        share * unknown.xy + both * known.xy,
        share * unknown.yy + both * known.yy,
    )
    against = scaled_cov(dt2, steered)
    reserve = correction_quantile(motion, returned) + correction_quantile(motion, against)
    speed = max(motion.u_max - reserve, 0.0)
    total = Cov(
        cov.xx - against.xx + after.xx,
        cov.xy - against.xy + after.xy,
        cov.yy - against.yy + after.yy,
    )
    return Ahead(mean, total, speed)


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
def learn(memory: LandmarkMemory, v: int, f: int, unknown: Cov, variance: float) -> Cov:
    """Kalman update of row ``v`` of ``theta``, with Cov(ẽ) = ``unknown``; write D of fix ``f``.

    Returns Σ̃ S⁻¹ Σ̃ [m²], the covariance that moves from the unknown to the known part.

    Eq. (M26) of docs/mathematics.md.
    """
    uxx, uxy, uyy = unknown
    a, b, c = uxx + variance, uxy, uyy + variance
    l00 = math.sqrt(a)
    l10 = b / l00
    l11 = math.sqrt(max(c - l10 * l10, 1e-9 * c))
    det = a * c - b * b
    g00, g01 = (uxx * c - uxy * b) / det, (uxy * a - uxx * b) / det
    g10, g11 = (uxy * c - uyy * b) / det, (uyy * a - uxy * b) / det
    i00, i10, i11 = F32(1.0 / l00), F32(-l10 / (l00 * l11)), F32(1.0 / l11)
    k00, k01, k10, k11 = F32(g00), F32(g01), F32(g10), F32(g11)
    theta = memory.theta
    for w in range(2):
        for m in range(theta.shape[3]):
            p, q = theta[v, 0, w, m], theta[v, 1, w, m]
            memory.gain[f, 0, w, m] = i00 * p
            memory.gain[f, 1, w, m] = i10 * p + i11 * q
            theta[v, 0, w, m] = p - k00 * p - k01 * q
            theta[v, 1, w, m] = q - k10 * p - k11 * q
    return Cov(g00 * uxx + g01 * uxy, g00 * uxy + g01 * uyy, g10 * uxy + g11 * uyy)


@kernel
def steer_against(
    law: LandmarkLaw, memory: LandmarkMemory, step: int, at: Point, fix: int, faded: Shares, target: int
) -> Cov:
    """Subtract the wind that is known from fixes from row ``target`` of ``theta``.

    Returns the covariance of that wind [m²/s²]. Fixes are visited backwards from ``fix``, with factors
    ``faded``.

    Eq. (M28) of docs/mathematics.md.
    """
    modes, dt = law.modes, law.motion.dt
    kept, square = modes.kept[step + 1], mode_square(modes, at)
    xx, xy, yy = 0.0, 0.0, 0.0
    f, s = fix, faded
    while f >= 0 and max(s[0], s[1], s[2], s[3]) > FADED:
        for r in range(2):
            e = expected_wind(modes, step, square, memory.gain[f, r, 0], s, 0)
            n = expected_wind(modes, step, square, memory.gain[f, r, 1], s, 1)
            xx, xy, yy = xx + e * e, xy + e * n, yy + n * n
            subtract_fix(memory.theta[target, 0], memory.gain[f, r], dt * e, kept, modes.part, s)
            subtract_fix(memory.theta[target, 1], memory.gain[f, r], dt * n, kept, modes.part, s)
        s, f = faded_by(s, memory.share, f), memory.previous[f]
    return Cov(xx, xy, yy)


@vector
def expected_wind(
    modes: Modes, step: int, square: Square, coefficients: Float32Array, s: Shares, c: int
) -> float:
    """Σ_m ψ_m(x) s_m ``coefficients[m]`` of wind component ``c``; s_m is the factor of the mode's part."""
    weights, slot, scale, total = corner_weights(square), modes.slot[step], modes.scale[step], F32(0.0)
    for m in range(modes.psi.shape[4]):
        p = scale[m] * mode_value(modes.psi, slot, square, weights, c, m)
        total += p * coefficients[m] * F32(s[modes.part[m]])
    return total  # type: ignore[return-value]


@vector
def subtract_fix(
    theta: Float32Array, gain: Float32Array, factor: float, kept: Float32Array, part: IntArray, s: Shares
) -> None:
    """Subtract ``factor`` s_m ``kept[m]`` ``gain[c, m]`` from ``theta`` (2, P), s_m as above."""
    weight = F32(factor)
    for c in range(2):
        for m in range(theta.shape[1]):
            theta[c, m] -= weight * kept[m] * F32(s[part[m]]) * gain[c, m]
