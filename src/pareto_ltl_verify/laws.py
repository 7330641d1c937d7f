"""The Gaussian distribution of the position along a path, step by step, under each wind law.

Both laws use full matrices. The coherent law propagates the joint covariance of the deviation e and of the
coefficients θ of the wind field, so that a position fix is a Kalman update of (e, θ).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from pareto_ltl_verify.arrays import FloatArray
from pareto_ltl_verify.gaussians import in_polygon
from pareto_ltl_verify.geometry import Convex, convex
from pareto_ltl_verify.robot import NO_ERRORS, Errors, Robot
from pareto_ltl_verify.wind_tables import TIME, Clock, WindFile, at_step, square_of

WORTHWHILE = 0.01  # share of the unknown variance: fixes that take less are ignored
TURN = np.array([[0.0, -1.0], [1.0, 0.0]])  # by 90 degrees, anticlockwise
RIM = np.array([(math.cos(a), math.sin(a)) for a in np.arange(8) * math.pi / 4])  # of the maximum-trace ball


@dataclass(slots=True)
class Course:
    """A path of T steps under one law, filled step by step.

    Attributes
    ----------
    x (T+1, 2), cov (T+1, 2, 2)
        Mean [m] and covariance [m²].
    u (T, 2), speed (T,)
        Control and the airspeed left for it [m/s].
    F (T, 2, 2), psi (T, 2, N), white (T, 2), drift (T, 2)
        The law linearised about the path: e' = F e + φ dt (ψ θ + white) with N coefficients θ, the robot's
        errors last; drift is μ and its mean shift.
    cross : list of T+1 (2, N)
        Cov(e_t, θ_t).
    along_means : bool
        Whether the means are given, or else the controls.
    chances : dict of step to float
        Probability of the fix on the way to a step, where it matters.
    """

    x: FloatArray
    u: FloatArray
    cov: FloatArray
    speed: FloatArray
    drift: FloatArray
    F: FloatArray
    psi: FloatArray
    white: FloatArray
    along_means: bool = True
    cross: list[FloatArray] = field(default_factory=list)
    chances: dict[int, float] = field(default_factory=dict)


@dataclass(slots=True)
class Belief:
    """Covariances before a step, of estimates (ê) and of the errors of the estimates (ẽ, θ̃).

    ``unknown`` Cov(ẽ) and ``known`` Cov(ê) (2, 2), ``cross`` Cov(ẽ, θ̃) (2, N), ``theta`` Cov(θ̃) (N, N).
    """

    unknown: FloatArray
    known: FloatArray
    cross: FloatArray
    theta: FloatArray


class Landmark(NamedTuple):
    """A convex area in which the robot measures its position, and the covariance (2, 2) of the error [m²]."""

    area: Convex
    error: FloatArray


def fix_error(stated: dict[str, float] | None, usual: float) -> FloatArray:
    """Covariance (2, 2) [m²] of an entry of ``landmark_fixes``; without one, ``usual`` [m] each way."""
    stated = stated or {"sd": usual}
    along, across = (stated.get(key, stated.get("sd", math.nan)) for key in ("along", "across"))
    angle = math.radians(90.0 - stated.get("bearing", 0.0))  # anticlockwise from x
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    return np.asarray(turn @ np.diag([along**2, across**2]) @ turn.T, float)


def landmarks_of(scene: dict[str, Any], usual: float) -> tuple[Landmark, ...]:
    """The landmarks of ``scene.json``; ``usual`` as for :func:`fix_error`."""
    marks = scene.get("landmarks") or []
    fixes = scene.get("landmark_fixes") or [None] * len(marks)
    pairs = zip(marks, fixes, strict=False)
    return tuple(Landmark(convex(mark), fix_error(fix, usual)) for mark, fix in pairs)


@dataclass(frozen=True, slots=True)
class Law:
    """The wind of a flight at its steps, for a robot that measures its position at ``landmarks``."""

    wind: WindFile
    times: Clock
    robot: Robot
    landmarks: tuple[Landmark, ...] = ()

    @property
    def modes(self) -> int:
        """2P, the number of wind coefficients of both components; 0 without a field for the whole flight."""
        return 0

    @property
    def errors(self) -> Errors:
        """The robot's own errors that last for a flight; none under this law."""
        return NO_ERRORS

    @property
    def coefficients(self) -> int:
        """N, of the wind and of the robot's own errors."""
        return self.modes + len(self.errors)

    def kept(self, t: int) -> FloatArray:  # noqa: ARG002
        """Share of each coefficient that step t keeps of step t - 1, (N,)."""
        return np.ones(self.coefficients)

    def wind_at(self, t: int, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Mean [m/s] and variance without gusts of the wind at step t at ``points`` (P, 2), each (P, 2)."""
        square = square_of(self.wind.x, self.wind.y, points)
        tables = (self.wind.mean, self.wind.latent)
        mean, latent = (square.value(at_step(table, self.times, t)) for table in tables)
        return mean, latent

    def white_variance(self, t: int, latent: FloatArray, carried: FloatArray | float) -> FloatArray:
        """Variance (..., 2) of a step's mean wind without the part ``carried`` by coefficients."""
        raise NotImplementedError

    def linearise(self, course: Course, t: int, belief: Belief) -> None:
        """Fill row t of F, ψ, the white variance and the expected wind."""
        raise NotImplementedError

    def advance(self, course: Course, t: int, belief: Belief) -> Belief:
        """Fill row t of ``course`` and return what is uncertain one step later."""
        belief = self._with_fix(course, t, belief)
        robot, dt = self.robot, self.robot.exposed * self.robot.dt
        self.linearise(course, t, belief)
        self._steer(course, t)
        F, psi, keep = course.F[t], course.psi[t], self.kept(t + 1)
        mixed = dt * F @ belief.cross @ psi.T
        unknown = F @ belief.unknown @ F.T + mixed + mixed.T
        unknown += dt**2 * (psi @ belief.theta @ psi.T + np.diag(course.white[t]))
        back = F - robot.fix_gain * np.eye(2)
        course.speed[t] = robot.speed_left(robot.feedback**2 * belief.unknown)
        return Belief(
            unknown=unknown,
            known=back @ belief.known @ back.T,
            cross=keep * (F @ belief.cross + dt * psi @ belief.theta),
            theta=np.outer(keep, keep) * belief.theta + np.diag(1 - keep**2),
        )

    def _steer(self, course: Course, t: int) -> None:
        """Fill the control, or the next mean, of step t, and the columns of the robot's errors in ψ."""
        robot, errors = self.robot, self.errors
        free = robot.a @ course.x[t] + robot.dt * course.drift[t]
        now, change = errors.flown if len(errors) else (np.eye(2), np.zeros((2, 2)))
        change = change / robot.dt if t else np.zeros((2, 2))
        last = change @ course.u[t - 1] if t else np.zeros(2)
        if course.along_means:
            through_air = np.linalg.solve(robot.b, course.x[t + 1] - free) / robot.dt
            course.u[t] = np.linalg.solve(now - change, through_air - last)
        u = course.u[t]
        through_air = (now - change) @ u + last
        course.drift[t] += robot.b @ (through_air - u)
        if not course.along_means:
            course.x[t + 1] = free + robot.dt * robot.b @ through_air
        if len(errors):
            before = course.u[max(t - 1, 0)]
            course.psi[t, :, self.modes :] = robot.b @ _slopes(robot, u, before) @ errors.root

    def _with_fix(self, course: Course, t: int, belief: Belief) -> Belief:
        """The expected belief after a position fix that arrives with the probability to be in a landmark."""
        total = belief.unknown + belief.known
        if not self.landmarks or np.diag(total).min() <= 0:
            return belief
        begin, here = course.x[max(t - 1, 0)], course.x[t]
        chance, share, error = 0.0, 1.0, np.zeros((2, 2))
        for mark in self.landmarks:
            s = nearest_share(begin, here, mark.area.corners.mean(axis=0))
            p = in_polygon(mark.area, begin + s * (here - begin), total)
            if p > chance:
                chance, share, error = p, s, mark.error
        _, (latent,) = self.wind_at(max(t - 1, 0), here[None])
        drifted = ((1.0 - share) * self.robot.dt) ** 2 * latent
        S = belief.unknown + error + np.diag(drifted)
        gain = chance * np.linalg.solve(S, belief.unknown).T
        if np.trace(gain @ belief.unknown) <= WORTHWHILE * np.trace(belief.unknown):
            return belief
        course.chances[t] = chance
        learnt = chance * np.linalg.solve(S, belief.cross).T
        return Belief(
            unknown=belief.unknown - gain @ belief.unknown,
            known=belief.known + gain @ belief.unknown,
            cross=belief.cross - gain @ belief.cross,
            theta=belief.theta - learnt @ belief.cross,
        )


class Independent(Law):
    """The wind of every step is independent; Σ_w has the largest trace in a ball around the mean."""

    __slots__ = ()

    def white_variance(self, t: int, latent: FloatArray, carried: FloatArray | float) -> FloatArray:
        """Variance (..., 2) of the wind of a step, with gusts and the error of interpolation in time."""
        gust = at_step(self.wind.gust, self.times, t)
        return np.asarray(latent - carried + gust + self.times.between[t], float)

    def linearise(self, course: Course, t: int, belief: Belief) -> None:
        """Fill row t of F, the white variance and the expected wind."""
        robot = self.robot
        reach = robot.ball * math.sqrt(float(np.trace(belief.unknown)) / 2)
        around = course.x[t] + reach * np.vstack([[0.0, 0.0], RIM if reach > 0 else RIM[:0]])
        mean, latent = self.wind_at(t, around)
        course.white[t] = self.white_variance(t, latent[np.argmax(latent.sum(axis=1))], 0.0)
        course.drift[t] = mean[0]
        course.F[t] = robot.closed


class Coherent(Law):
    """One field for a whole flight, w(x) = μ(x) + ψ(x)' θ; the robot gets position fixes at ``landmarks``."""

    __slots__ = ()

    @property
    def modes(self) -> int:
        """2P, the number of coefficients of both components."""
        return 0 if self.wind.modes is None else 2 * self.wind.modes.psi.shape[-1]

    def kept(self, t: int) -> FloatArray:
        """Share of each coefficient that step t keeps of step t - 1, (N,)."""
        lasting = np.ones(len(self.errors))
        if self.wind.modes is None:
            return lasting
        return np.concatenate([np.tile(self.times.keep[t][self.wind.modes.part], 2), lasting])

    @property
    def errors(self) -> Errors:
        """Errors of the airspeed [relative], the heading [rad] and the clock [s], if any."""
        return self.robot.errors

    def modes_at(self, t: int) -> FloatArray:
        """ψ of step t at the nodes, (MX, MY, 2, P); modes of interpolation in time grow with its error."""
        modes = self.wind.modes
        assert modes is not None
        grown = np.where(modes.part == TIME, math.sqrt(self.times.between[t]), 1.0)
        return np.asarray(modes.psi[self.times.nearest[t]] * grown, float)

    def white_variance(self, t: int, latent: FloatArray, carried: FloatArray | float) -> FloatArray:
        """Variance (..., 2) of a step's mean of gusts and of the rest, ``latent`` minus ``carried``.

        The rest is the part of the error without modes. It stays correlated for the time in which a robot
        crosses its correlation length at its airspeed, at most for the whole flight.
        """
        robot, modes = self.robot, self.wind.modes
        reach = 0.0 if modes is None else 2 * modes.rest_length / (robot.u_max * robot.dt)
        left = np.maximum(latent + self.times.between[t] - carried, 0.0)
        gusts = self.wind.gust_time / robot.dt * at_step(self.wind.gust, self.times, t)
        return np.asarray(gusts + min(reach, float(self.times.known)) * left, float)

    def linearise(self, course: Course, t: int, belief: Belief) -> None:
        """F, ψ, the white variance and the expected wind with its second-order shift at the mean.

        ½ D²μ : Σ + ∂ψ : C, with central differences of μ at the nodes.
        """
        wind, robot = self.wind, self.robot
        square = square_of(wind.x, wind.y, course.x[t, None])
        mean = at_step(wind.mean, self.times, t)
        first = [np.gradient(mean, square.side, axis=axis) for axis in (0, 1)]
        D = np.stack([square.value(d)[0] for d in first], axis=1)  # (component, direction)
        course.F[t] = robot.closed + robot.exposed * robot.dt * D
        H = [[square.value(np.gradient(d, square.side, axis=axis))[0] for axis in (0, 1)] for d in first]
        bend = 0.5 * np.einsum("ijc,ij->c", np.array(H), belief.unknown)
        psi, swept = self._field_at(course.x[t], t, belief.cross[:, : self.modes])
        course.psi[t, :, : self.modes] = psi
        latent = square.value(at_step(wind.latent, self.times, t))[0]
        course.white[t] = self.white_variance(t, latent, (psi**2).sum(axis=1))
        course.drift[t] = square.value(mean)[0] + bend + swept

    def _field_at(self, x: FloatArray, t: int, cross: FloatArray) -> tuple[FloatArray, FloatArray]:
        """ψ = blkdiag(ψ_x', ψ_y') (2, 2P) and ∂ψ : C (2,)."""
        psi, modes = np.zeros((2, 2, self.modes // 2)), self.wind.modes
        if modes is None:
            return psi.reshape(2, 0), np.zeros(2)
        table, square = self.modes_at(t), square_of(modes.x, modes.y, x[None])
        psi[[0, 1], [0, 1]] = square.value(table)[0]
        slopes = np.concatenate(square.slopes(table))  # (direction, component, P)
        return psi.reshape(2, -1), np.einsum("dcp,dcp->c", slopes, cross.reshape(2, 2, -1))


def _slopes(robot: Robot, u: FloatArray, before: FloatArray) -> FloatArray:
    """Slopes (2, 3) at the mean errors of what is flown of ``u``, and of ``before`` a step ago."""
    a, b, c = robot.errors.mean
    turn = np.array([[math.cos(b), -math.sin(b)], [math.sin(b), math.cos(b)]])
    change = (before - u) / robot.dt
    ahead = turn @ (u + c * change)
    return np.column_stack([ahead, (1.0 + a) * TURN @ ahead, (1.0 + a) * turn @ change])


def nearest_share(begin: FloatArray, end: FloatArray, point: FloatArray) -> float:
    """The share in [0, 1] of a segment at which it is nearest to ``point`` (2,); 1 if it has no length."""
    along = end - begin
    size = float(along @ along)
    return float(np.clip((point - begin) @ along / size, 0.0, 1.0)) if size > 0.0 else 1.0


def fly_means(law: Law, x: FloatArray, wider: FloatArray | float = 0.0) -> Course:
    """The course along the means ``x`` (T+1, 2) [m], with the controls that they need.

    ``wider`` (2, 2) is a covariance that is added at the start [m²].
    """
    return _flown(law, x, np.empty((len(x) - 1, 2)), along_means=True, wider=wider)


def fly_controls(law: Law, start: FloatArray, u: FloatArray) -> Course:
    """The course of the controls ``u`` (T, 2) [m/s] from ``start`` (2,) [m]."""
    return _flown(law, np.vstack([start, np.empty((len(u), 2))]), u, along_means=False)


def _flown(
    law: Law, x: FloatArray, u: FloatArray, *, along_means: bool, wider: FloatArray | float = 0.0
) -> Course:
    """The course along the means ``x`` or else of the controls ``u``: each step determines the other.

    ``wider`` (2, 2) is a covariance that is added at the start [m²].
    """
    n, steps, robot = law.coefficients, len(u), law.robot
    course = Course(
        x=np.array(x, float), u=np.array(u, float), cov=np.empty((steps + 1, 2, 2)), speed=np.empty(steps),
        drift=np.empty((steps, 2)), F=np.empty((steps, 2, 2)), psi=np.zeros((steps, 2, n)),
        white=np.empty((steps, 2)), along_means=along_means,
    )  # fmt: skip
    cross = np.hstack([np.zeros((2, law.modes)), law.errors.start])
    start = robot.start_sd**2 * np.eye(2) + cross @ cross.T + wider
    belief = Belief(start, np.zeros((2, 2)), cross, np.eye(n))
    for t in range(steps):
        course.cov[t] = belief.unknown + belief.known
        course.cross.append(belief.cross)
        belief = law.advance(course, t, belief)
    course.cov[-1] = belief.unknown + belief.known
    course.cross.append(belief.cross)
    return course


def covariance_across(law: Law, course: Course) -> FloatArray:
    """Cov(e_t, e_s) for s <= t, (T+1, T+1, 2, 2), of a course without fixes."""
    n, dt = len(course.x), law.robot.exposed * law.robot.dt
    cross = np.zeros((n, n, 2, 2))
    for s in range(n):
        cross[s, s], held = course.cov[s], course.cross[s].T  # Cov(θ_s, e_s)
        for t in range(s, n - 1):
            cross[t + 1, s] = course.F[t] @ cross[t, s] + dt * course.psi[t] @ held
            held = law.kept(t + 1)[:, None] * held
    return cross
