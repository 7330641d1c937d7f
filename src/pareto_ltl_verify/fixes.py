"""Filters of robots that measure their position in landmarks, one for each history of fixes.

The joint covariance of (e_t, e_{t-1}, θ) about the planned means is propagated as one matrix, so that a fix
between two steps is a Kalman update by a row of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from pareto_ltl.support.arrays import FloatArray, IntArray
from pareto_ltl_verify.geometry import Convex
from pareto_ltl_verify.laws import Coherent, Course, Landmark, Law

SHARES = 8  # parts of a step in which the planner puts a fix
History = tuple[tuple[int, int, int], ...]  # step, landmark and part of the step of each fix


def last_share(mark: Convex, start: FloatArray, end: FloatArray) -> FloatArray:
    """The last share of each segment (S, 2) to (S, 2) [m] in a convex polygon, (S,); -1 where none is."""
    enter, leave, along = mark.pieces(start, end)
    return np.asarray(np.where((along < 0) | (enter > leave), -1.0, leave), float)


@dataclass(slots=True)
class Robots:
    """The knowledge of n robots: ê at this step and the last, θ̂, and whether they have had a fix."""

    now: FloatArray
    ago: FloatArray
    wind: FloatArray
    fixed: FloatArray
    history: list[History]


@dataclass(slots=True)
class Filters:
    """The filters of all flights of one plan.

    Attributes
    ----------
    law : Law
        The law of the flights; under the independent law fixes measure positions only.
    guide : Course
        The law linearised about the planned means.
    joint : dict of History to (4 + 2P, 4 + 2P) float
        Covariance of the errors of (e_t, e_{t-1}, θ).
    """

    law: Law
    guide: Course
    landmarks: Sequence[Landmark]
    joint: dict[History, FloatArray] = field(default_factory=dict)

    def begin(self, runs: int) -> Robots:
        """Robots before departure."""
        modes, variance = self.guide.psi.shape[2], self.law.robot.start_sd**2
        joint = np.eye(4 + modes)
        joint[:4, :4] = variance * np.tile(np.eye(2), (2, 2))
        self.joint = {(): joint}
        none = np.zeros((runs, 2))
        return Robots(none, none.copy(), np.zeros((runs, modes)), np.zeros(runs, bool), [()] * runs)

    def _kept(self, t: int) -> FloatArray:
        return self.law.kept(t) if isinstance(self.law, Coherent) else np.ones(0)

    def carry(self, t: int) -> None:
        """All covariances from step t - 1 to t."""
        guide, dt, persistence = self.guide, self.law.robot.dt, self._kept(t)
        n = len(persistence)
        M = np.zeros((4 + n, 4 + n))
        M[:2, :2], M[:2, 4:], M[2:4, :2] = guide.F[t - 1], dt * guide.psi[t - 1], np.eye(2)
        M[4:, 4:] = np.diag(persistence)
        fresh = np.concatenate([dt**2 * guide.white[t - 1], np.zeros(2), 1.0 - persistence**2])
        self.joint = {key: M @ joint @ M.T + np.diag(fresh) for key, joint in self.joint.items()}

    def observe(self, robots: Robots, t: int, x: FloatArray, rng: np.random.Generator) -> None:
        """The fixes of all flights ``x`` (n, T+1, 2) on their way to step t."""
        if t:
            self.carry(t)
            robots.wind *= self._kept(t)
        here, begin = x[:, t], x[:, max(t - 1, 0)]
        shares = np.column_stack([last_share(mark.area, begin, here) for mark in self.landmarks])
        mark = shares.argmax(axis=1)
        share = shares[np.arange(len(x)), mark] if t else np.where(shares.max(axis=1) >= 0, 1.0, -1.0)
        groups: dict[History, list[int]] = {}
        for i in np.flatnonzero(share >= 0.0).tolist():
            part = min(max(int(share[i] * SHARES + 0.5), 1), SHARES)
            groups.setdefault((*robots.history[i], (t, int(mark[i]), part)), []).append(i)
        noise = rng.standard_normal((len(x), 2))
        for key, rows in groups.items():
            own = np.array(rows)
            self._update(robots, key, own, share[own], (begin[own], here[own], noise[own]))
        live = {robots.history[i] for i in range(len(x))}
        self.joint = {key: joint for key, joint in self.joint.items() if key in live}

    def _update(
        self, robots: Robots, key: History, rows: IntArray, share: FloatArray,
        seen: tuple[FloatArray, FloatArray, FloatArray],
    ) -> None:  # fmt: skip
        """Kalman update of the flights ``rows``, which have the history ``key`` after this fix."""
        joint, (t, mark, part) = self.joint[key[:-1]], key[-1]
        s, error = part / SHARES, self.landmarks[mark].error
        H = np.zeros((2, len(joint)))
        H[:, :2], H[:, 2:4] = s * np.eye(2), (1.0 - s) * np.eye(2)
        gain = np.linalg.solve(H @ joint @ H.T + error, H @ joint).T
        self.joint.setdefault(key, joint - gain @ (H @ joint))
        begin, here, noise = seen
        share, mean = share[:, None], self.guide.x
        read = begin + share * (here - begin) + noise @ np.linalg.cholesky(error).T
        known = share * (mean[t] + robots.now[rows])
        known += (1.0 - share) * (mean[max(t - 1, 0)] + robots.ago[rows])
        news = read - known
        robots.now[rows] += news @ gain[:2].T
        robots.wind[rows] += news @ gain[4:].T
        robots.fixed[rows] = True
        for i in rows.tolist():
            robots.history[i] = key

    def steered(self, robots: Robots, t: int, u: FloatArray) -> FloatArray:
        """Controls (n, 2) [m/s] of all flights at step t; ``u`` (2,) is the planned one."""
        robot, guide = self.law.robot, self.guide
        expected = robots.wind @ guide.psi[t].T
        wanted = u - np.linalg.solve(robot.b, (robot.fix_gain / robot.dt * robots.now + expected).T).T
        flown = np.where(robots.fixed[:, None], robot.within_speed(wanted), u)
        moved = robots.now @ guide.F[t].T + robot.dt * (expected + (flown - u) @ robot.b.T)
        robots.ago = robots.now
        robots.now = np.where(robots.fixed[:, None], moved, 0.0)
        return np.asarray(flown, float)
