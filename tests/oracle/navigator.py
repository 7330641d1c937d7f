"""One robot with position fixes in plain NumPy: a Kalman filter of (e_t, e_{t-1}, θ) as one matrix."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pareto_ltl.kernels.data import Landmarks
from pareto_ltl.kernels.pilots import SHARES, FilterLaw
from pareto_ltl.support.arrays import FloatArray


@dataclass(slots=True)
class Filtered:
    """Estimates (e_t, e_{t-1}, θ) before the control of each step, the last covariance, and the fixes.

    ``fixes`` lists the step, the landmark and the share of each.
    """

    estimates: list[FloatArray]
    joint: FloatArray
    fixes: list[tuple[int, int, float]]


def last_share(marks: Landmarks, k: int, begin: FloatArray, end: FloatArray) -> float:
    """The last share of the segment in landmark ``k``, from a fine sampling; -1 for none."""
    own = slice(marks.faces.ptr[k], marks.faces.ptr[k + 1])
    shares = np.linspace(0.0, 1.0, 20_001)
    points = begin + shares[:, None] * (end - begin)
    inside = (points @ marks.faces.normal[own].T <= marks.faces.offset[own]).all(axis=1)
    return float(shares[inside].max()) if inside.any() else -1.0


def filtered(
    law: FilterLaw, marks: Landmarks, root: FloatArray, noise: FloatArray, x: FloatArray,
    control: Callable[[int, FloatArray], FloatArray], b: FloatArray, dt: float,
) -> Filtered:  # fmt: skip
    """What a robot knows that has flown ``x`` (T+1, 2).

    ``noise`` (T+1, 2) ~ N(0, 1) of its fixes; ``control`` gives what it commands at a step once it has taken
    a fix, from its estimate.
    """
    u = law.u.copy()
    modes = law.psi.shape[2]
    n = 4 + 2 * modes
    mean, joint = np.zeros(n), np.eye(n)
    joint[:4, :4] = law.variance * np.tile(np.eye(2), (2, 2))
    done = Filtered([], joint, [])
    for t in range(len(u)):
        if t:
            M, kept = np.zeros((n, n)), np.tile(law.kept[t], 2)
            M[:2, :2], M[2:4, :2], M[4:, 4:] = law.F[t - 1], np.eye(2), np.diag(kept)
            for c in (0, 1):
                M[c, 4 + c * modes : 4 + (c + 1) * modes] = dt * law.psi[t - 1, c]
            mean = M @ mean
            mean[:2] += dt * b @ (u[t - 1] - law.u[t - 1])
            fresh = np.concatenate([dt**2 * law.white[t - 1], np.zeros(2), 1.0 - kept**2])
            joint = M @ joint @ M.T + np.diag(fresh)
        begin = x[max(t - 1, 0)]
        shares = [last_share(marks, k, begin, x[t]) for k in range(len(root))]
        mark = int(np.argmax(shares))
        if shares[mark] >= 0.0:
            share = shares[mark] if t else 1.0
            s = min(max(round(share * SHARES), 1), SHARES) / SHARES
            H = np.zeros((2, n))
            H[:, :2], H[:, 2:4] = s * np.eye(2), (1.0 - s) * np.eye(2)
            R = root[mark] @ root[mark].T
            gain = np.linalg.solve(H @ joint @ H.T + R, H @ joint).T
            read = begin + share * (x[t] - begin) + root[mark] @ noise[t]
            planned = share * law.x[t] + (1.0 - share) * law.x[max(t - 1, 0)]
            mean = mean + gain @ (read - planned - share * mean[:2] - (1.0 - share) * mean[2:4])
            joint = joint - gain @ H @ joint
            done.fixes.append((t, mark, share))
        if done.fixes:
            u[t] = control(t, mean)
        done.estimates.append(mean)
    done.joint = joint
    return done
