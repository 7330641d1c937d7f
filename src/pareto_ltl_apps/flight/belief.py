"""What a robot without position fixes knows of its position and of the wind: a Kalman filter, in NumPy.

The state at step t of the plan is z = (e, θ, κ, w): the deviation of the position from its estimate, the
coefficients of the wind field and of the robot's errors of airspeed and heading, and the white part of the
wind of this step. A share s of the step later, after the displacement a through the air by the measured
headings and airspeeds, of which M(κ) a is flown (M24a),

    x_s = (I + s (A - I)) x_t + M(κ) a + s dt (μ(x_t) + ψ(x_t)' θ + w),    y = x_s + ν,    ν ~ N(0, R),

linear about the estimate. The measurements carry their times, so the robot's clock has no part in it; at the
end of a step θ fades as in (M15), and w is drawn anew. So the filter follows the law of the plan, whatever
the robot has really flown, and a fix may come at any time.

The members are simulated flights of the same law. They fly what the robot has flown, a fix moves them with
the gains of the filter and independent errors (perturbed observations, as in the ensemble Kalman filter,
Evensen 2003, doi:10.1007/s10236-003-0036-9), and the rest of the plan is flown from where they are.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator, SeedSequence

from pareto_ltl.extend import Deployment, LinearWind, LocalWind, Problem
from pareto_ltl.support.arrays import BoolArray, FloatArray

LAW = "coherent"  # the law of every belief, that in which plans of all fidelities are simulated
ROUNDING = 1e-9  # of a step


@dataclass(frozen=True, slots=True)
class Estimate:
    """Position and wind as they are believed: ``mean`` (2,) [m], ``cov`` (2, 2) [m²], and of the wind [m/s].

    The wind is the wind of this step without its white part.
    """

    mean: FloatArray
    cov: FloatArray
    wind: FloatArray
    wind_cov: FloatArray


class Belief:
    """The filter and the members of one flight, from its departure on.

    Parameters
    ----------
    problem : Problem
        The problem of the plan.
    members : int
        Number of simulated flights.
    seed : SeedSequence
        Seed of their winds; the same seed and the same readings give the same members.
    """

    def __init__(self, problem: Problem, members: int, seed: SeedSequence) -> None:
        law = problem.coherent
        self.problem, self.law, self.motion = problem, law, problem.motion
        self.seed, self.rng = seed, np.random.default_rng(seed)
        self.step, self.share = 0, 0.0
        self.air = np.zeros(2)  # displacement through the air since the step began [m]
        modes = law.modes.psi.shape[-1]
        self.error_mean, self.error_root = law.errors.mean[:2], law.errors.root[:2, :2]  # not of the clock
        self.x = np.array(problem.scene.start, float)
        # Deviation, θ east, θ north, errors of airspeed and heading (if the law has them), white part.
        self.z = np.zeros(2 * modes + len(self.error_mean) + 4)
        self.cov = np.eye(len(self.z))
        # The error of the clock is no state: what it explains of the start counts as independent.
        lean, known = law.errors.start, slice(len(self.z) - len(self.error_mean) - 2, len(self.z) - 2)
        rest = problem.start_variance * np.eye(2) + lean[:, 2:] @ lean[:, 2:].T
        self.cov[:2, :2] = rest + lean[:, :2] @ lean[:, :2].T
        self.cov[:2, known], self.cov[known, :2] = lean[:, :2], lean[:, :2].T
        spread = self.rng.standard_normal((members, 2)) @ root_of(rest)
        self.theta = self.rng.standard_normal((members, 2, modes))
        self.errors = self.rng.standard_normal((members, len(self.error_mean)))
        spread += self.errors @ lean[:, :2].T
        self.flown = (self.x + spread)[:, None]  # (n, t + 1, 2): positions of the members at the steps
        self.wind = self._begin_step()

    # --- time ---

    @property
    def time(self) -> float:
        """Seconds after departure."""
        return (self.step + self.share) * self.motion.dt

    @property
    def ended(self) -> bool:
        """Whether the wind is not known any longer."""
        return self.step >= len(self.law.wind.slot)

    def advance(self, seconds: float, air: FloatArray) -> None:
        """Fly ``seconds`` with the displacement ``air`` (2,) [m] through the air, evenly."""
        dt = self.motion.dt
        while seconds > ROUNDING * dt and not self.ended:
            part = min(seconds, (1.0 - self.share) * dt)
            self.air += air * (part / seconds)
            self.share += part / dt
            air, seconds = air * (1.0 - part / seconds), seconds - part
            if self.share > 1.0 - ROUNDING:
                self.share = 1.0
                self._end_step()

    def _local(self) -> LocalWind:
        """The law at the members at the beginning of this step; after the wind's end, of its last step."""
        return LocalWind.at(self.law, self._known_step, self.flown[:, -1])

    @property
    def _known_step(self) -> int:
        return min(self.step, len(self.law.wind.slot) - 1)

    def _begin_step(self) -> LinearWind:
        """The law about the estimate, and a new white part."""
        cross = self.cov[:2, 2 : 2 + self.theta[0].size].reshape(2, 2, -1)
        wind = LinearWind.about(self.law, self._known_step, self.x, self.cov[:2, :2], cross)
        self.cov[-2:], self.cov[:, -2:], self.z[-2:] = 0.0, 0.0, 0.0
        self.cov[-2:, -2:] = np.diag(wind.white)
        self.local = self._local()
        self.white = np.sqrt(self.local.white) * self.rng.standard_normal((len(self.theta), 2))
        return wind

    def _end_step(self) -> None:
        """Carry the state over to the next step, about the new estimate."""
        mean, members, kept = self._mean(), self._members(), self.kept(self.step)
        keep = np.concatenate([np.ones(2), kept, kept, np.ones(len(self.error_mean) + 2)])
        carry = np.diag(keep)
        carry[:2] = self._map()
        self.cov = carry @ self.cov @ carry.T + np.diag(1.0 - keep**2)
        self.z = carry @ self.z
        self.z[:2] = 0.0
        self.x, self.air, self.share, self.step = mean, np.zeros(2), 0.0, self.step + 1
        self.flown = np.concatenate([self.flown, members[:, None]], axis=1)
        self.theta = faded(self.theta, kept, self.rng)
        self.wind = self._begin_step()

    def kept(self, step: int) -> FloatArray:
        """ρ (P,) of the coefficients between ``step`` and the next."""
        return np.asarray(self.law.modes.kept[step + 1], float)

    # --- where ---

    def _by_state(self, by_place: FloatArray, seconds: float) -> FloatArray:
        """The matrix (2, 2P + Q + 4) that maps the state to ``by_place`` e + ``seconds`` ψ' θ."""
        east, north = seconds * self.wind.psi
        theta, others = np.array([[*east, *0.0 * east], [*0.0 * north, *north]]), len(self.error_mean) + 2
        return np.block([by_place, theta, np.zeros((2, others))])

    def _map(self) -> FloatArray:
        """The deviation now, by the state at the beginning of the step, (2, 2P + Q + 4)."""
        s, still = self.share, np.eye(2)
        flown = s * self.motion.dt
        H = self._by_state(still + s * (self.motion.a - still) + flown * self.wind.slope, flown)
        H[:, -2:] = flown * still
        if len(self.error_mean):
            (scale, turn), (east, north) = self.error_mean, self.air
            cos, sin = math.cos(turn), math.sin(turn)
            ahead = np.array([cos * east - sin * north, sin * east + cos * north])
            aside = (1.0 + scale) * np.array([-ahead[1], ahead[0]])
            H[:, -4:-2] = np.column_stack([ahead, aside]) @ self.error_root
        return H

    def _drifted(self, x: FloatArray, wind: FloatArray, air: FloatArray) -> FloatArray:
        """Positions now of ``x`` (n, 2) at the beginning of the step, in winds and after ``air`` (n, 2)."""
        s = self.share
        return np.asarray(x + s * (x @ (self.motion.a - np.eye(2)).T + self.motion.dt * wind) + air)

    def _mean(self) -> FloatArray:
        still = self._drifted(self.x[None], self.wind.mean[None], self._expected(self.air))[0]
        return np.asarray(still + self._map() @ self.z)

    def _expected(self, air: FloatArray) -> FloatArray:
        """The mean of what is really flown (2,) of a displacement ``air`` (2,), (M24a)."""
        if not len(self.error_mean):
            return air
        (scale, turn), S = self.error_mean, self.error_root @ self.error_root.T
        flown = np.exp(1j * turn - 0.5 * S[1, 1]) * (1.0 + scale + 1j * S[0, 1]) * complex(*air)
        return np.array([flown.real, flown.imag])

    def _members(self) -> FloatArray:
        """Positions (n, 2) of the members now [m]."""
        wind = self.local.met(self.theta, self.white)
        return self._drifted(self.flown[:, -1], wind, self._erred(self.air))

    def _erred(self, moved: FloatArray) -> FloatArray:
        """What each member really flies (n, 2) of displacements or controls (2,) or (n, 2), (M24a)."""
        if not len(self.error_mean):
            return moved
        scale, turn = (self.error_mean + self.errors @ self.error_root.T).T
        (x, y), cos, sin = moved.T, (1.0 + scale) * np.cos(turn), (1.0 + scale) * np.sin(turn)
        return np.column_stack([cos * x - sin * y, sin * x + cos * y])

    def estimate(self) -> Estimate:
        """Position and wind now."""
        G = self._by_state(self.wind.slope, 1.0)
        cov, wind_cov = (M @ self.cov @ M.T for M in (self._map(), G))
        return Estimate(
            self._mean(), 0.5 * (cov + cov.T), self.wind.mean + G @ self.z, 0.5 * (wind_cov + wind_cov.T)
        )

    # --- fixes ---

    def distance(self, place: FloatArray, R: FloatArray) -> float:
        """How far a measured ``place`` (2,) [m] with error covariance ``R`` (2, 2) [m²] is from the estimate.

        In standard deviations: under the law, P(distance > r) = exp(-r²/2).
        """
        now = self.estimate()
        gap = place - now.mean
        return math.sqrt(max(float(gap @ np.linalg.solve(now.cov + R, gap)), 0.0))

    def learn(self, place: FloatArray, R: FloatArray) -> None:
        """Condition on a measured ``place`` (2,) [m] with error covariance ``R`` (2, 2) [m²].

        Eq. (M67) of docs/mathematics_methods.md, one fix at a time.
        """
        H, n = self._map(), len(self.theta)
        S = H @ self.cov @ H.T + R
        gain = np.linalg.solve(S, H @ self.cov).T
        noise = self.rng.standard_normal((n, 2)) @ np.linalg.cholesky(R).T
        now = self._members()
        gap = place + noise - now
        past = self.flown - self.flown.mean(axis=0)
        with_now = np.einsum("nti,nj->tij", past[:, :-1], now - now.mean(axis=0)) / max(n - 1, 1)
        self.flown[:, :-1] += np.einsum("tij,jk,nk->nti", with_now, np.linalg.inv(S), gap)
        self.flown[:, -1] += gap @ gain[:2].T
        last = 2 + self.theta[0].size
        self.theta += (gap @ gain[2:last].T).reshape(self.theta.shape)
        self.errors += gap @ gain[last:-2].T
        self.white += gap @ gain[-2:].T
        self.local = self._local()
        self.z = self.z + gain @ (place - self._mean())
        left = np.eye(len(self.z)) - gain @ H
        self.cov = left @ self.cov @ left.T + gain @ R @ gain.T  # Joseph's form stays positive

    def restart(self, place: FloatArray, R: FloatArray) -> None:
        """Believe a measured ``place``: after fixes that the law cannot explain.

        What was known of the wind and of the robot's errors is forgotten.
        """
        self.theta = self.rng.standard_normal(self.theta.shape)
        self.errors = self.rng.standard_normal(self.errors.shape)
        self.cov, self.z = np.eye(len(self.z)), np.zeros(len(self.z))
        self.cov[:2, :2] = R
        for _ in range(3):  # the drift in this step depends on where it began
            self.x = self.x + place - self._mean()
            self.wind = self._begin_step()
        noise = self.rng.standard_normal((len(self.theta), 2)) @ np.linalg.cholesky(R).T
        self.flown[:, -1] += place + noise - self._members()

    # --- the rest of the plan ---

    def rest_fails(self, u: FloatArray, mean: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Fly the rest of the controls ``u`` (T, 2) [m/s] along ``mean`` (T+1, 2) [m].

        Returns the flights (n, T+1, 2) of the members that have met no obstacle so far, and which of them
        fail (n,). A robot with feedback steers towards ``mean``; fixes at landmarks are not counted on.
        """
        x, theta, seed = self.flown, self.theta, self.seed
        # One child a step: plans that are compared meet the same winds.
        rng = np.random.default_rng(SeedSequence(seed.entropy, spawn_key=(*seed.spawn_key, self.step)))
        for t in range(self.step, len(u)):
            x = np.concatenate([x, self._flown_on(t, u[t], mean, x[:, -1], theta, rng)[:, None]], axis=1)
            theta = faded(theta, self.kept(t), rng)
        x = np.ascontiguousarray(x[:, : len(u) + 1])
        past = Deployment.judged(self.problem, LAW, np.ascontiguousarray(x[:, : self.step + 1]))
        lost = past.collided | (past.off_map & past.walled)
        alive = ~lost if not lost.all() else np.ones(len(lost), bool)
        outcome = Deployment.judged(self.problem, LAW, x[alive])
        return x[alive], outcome.failed

    def _flown_on(
        self, t: int, u: FloatArray, mean: FloatArray, at: FloatArray, theta: FloatArray, rng: Generator
    ) -> FloatArray:
        """Positions (n, 2) after step ``t``, which began at ``at`` (n, 2), with the control ``u`` (2,).

        In the current step, ``u`` is flown for what is left of it.
        """
        motion = self.motion
        if t == self.step:
            law, white, share = self.local, self.white, 1.0 - self.share
            flown = self._erred(self.air)
        else:
            law, flown, share = LocalWind.at(self.law, t, at), np.zeros(2), 1.0
            white = np.sqrt(law.white) * rng.standard_normal(at.shape)
        wind = law.met(theta, white)
        flights = np.broadcast_to(u, at.shape)
        if motion.gain > 0.0:
            planned = (mean[t + 1] - motion.a @ mean[t]) / motion.dt - motion.b @ u
            met = wind + (self._erred(u) - u) @ motion.b.T
            steer = motion.gain / motion.dt * (at - mean[t]) + (1.0 - motion.exposed) * (met - planned)
            flights = _within_airspeed(u - steer @ motion.b_inv.T, motion.u_min, motion.u_max)
        flights = self._erred(flights)
        return np.asarray(at @ motion.a.T + flown + motion.dt * (share * flights @ motion.b.T + wind))


def root_of(cov: FloatArray) -> FloatArray:
    """The symmetric root of a covariance."""
    size, axes = np.linalg.eigh(cov)
    return np.asarray((axes * np.sqrt(np.maximum(size, 0.0))) @ axes.T, float)


def faded(theta: FloatArray, kept: FloatArray, rng: Generator) -> FloatArray:
    """θ (n, 2, P) a step later, of which the shares ``kept`` (P,) are left.

    Eq. (M15) of docs/mathematics.md.
    """
    return np.asarray(kept * theta + np.sqrt(1.0 - kept**2) * rng.standard_normal(theta.shape))


def _within_airspeed(u: FloatArray, least: float, limit: float) -> FloatArray:
    """Controls (n, 2) of the same directions with airspeeds in [``least``, ``limit``]; 0 stays 0."""
    size = np.linalg.norm(u, axis=1)
    wanted = np.clip(size, least, limit)
    return np.asarray(u * np.where(size > 0.0, wanted / np.maximum(size, 1e-12), 1.0)[:, None])
