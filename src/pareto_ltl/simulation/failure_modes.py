"""The ways in which flights of a plan fail, as half-spaces of their deviations.

In the law linearised about the plan, deviations are e = M z with z ~ N(0, I), so that a half-space of them,
ω' z >= τ with |ω| = 1, has the probability Φ(-τ). Flights are nonlinear: winds are curved, and a robot with
feedback reaches its largest airspeed. So only the directions ω are of the linear law, and the flights
themselves decide how far away failures begin.

1. Pilots are common flights whose draws are enlarged until they fail; those that fail first are examined.
2. Where a flight fails, one event binds its margin (:mod:`plane_logic.margin`): a point of the flight
   lies on the wrong side of a line. Its normal is a linear form of the deviations, and gives ω. A robot whose
   airspeed does not suffice deviates as one with less feedback, so the form is also taken of the deviations
   with half and with none of the feedback. Headwinds over some steps in a row are looked for as well: pilots
   whose draws are all enlarged alike seldom have them. So are tailwinds if there is a least airspeed.
3. Along each ω flights z = ω r are flown, and τ is the first r at which they fail.
4. Of half-spaces that are nearly parallel, the most likely one is retained.

With thresholds of the linear law, the half-spaces of a plan of phi2 with feedback missed the headwinds in
which the robot cannot keep up. It fails in 6.5e-5 of the flights (4 million), half of them for that reason:
20,000 weighted flights gave 2.4e-5 or, once in five seeds, 5e-4.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from scipy.special import ndtr

from pareto_ltl.kernels import data as kd
from pareto_ltl.kernels import flight as rollout
from pareto_ltl.kernels import importance as kernel
from pareto_ltl.kernels.path import Flight
from pareto_ltl.kernels.pilots import Autopilot
from pareto_ltl.planning.evaluate import propagate, propagate_controls
from pareto_ltl.planning.margin_model import margin_model, margin_scratch
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.records import PlannedPath
from pareto_ltl.simulation import flights as sim
from pareto_ltl.simulation.records import Deployment
from pareto_ltl.simulation.robot_errors import erring_pilot
from pareto_ltl.support.arrays import BoolArray, Float32Array, FloatArray, IntArray
from plane_logic.margin import Slope, smoothed_failure
from wind_laws.tails import ErrorTail

PILOTS = 500  # common flights whose events are looked for
ENLARGED = np.arange(1.0, 6.1, 0.5)  # factors of their draws
MAX_EVENTS = 200  # events that are examined
FEEDBACK = (1.0, 0.5, 0.0)  # shares of the feedback with which a failed flight may have deviated
SPANS = (3, 10, 30)  # steps of a headwind in which the robot cannot keep up; and the whole plan
FAR = 9.0  # standard deviations: a half-space farther away is left out, its probability is 1e-19
LARGE = 3.0  # scale of errors with tails up to which half-spaces are kept: they are left out beyond LARGE FAR
NEAR_RAY = np.arange(0.0, FAR + 0.01, 0.25)  # flights along a direction, then halvings between two of them
FAR_RAY = np.append(NEAR_RAY, np.arange(FAR + 1.0, LARGE * FAR + 0.01, 1.0))
HALVINGS = 24
SAME, ALIKE = 0.995, 0.9  # correlations of directions that are flown once, and of half-spaces retained once
KEPT = 1.0 - 1e-6  # share of the sum of probabilities that is retained


@dataclass(frozen=True, slots=True)
class FailureModes:
    """Half-spaces Σ_t ``weight[j, t]``' e_t >= ``threshold[j]`` near the failures of a plan.

    Attributes
    ----------
    weight : (J, T+1, 2) float
        Scaled so that the sum has the variance 1 [1/m].
    threshold : (J,) float
        Distances in standard deviations, positive.
    """

    weight: FloatArray
    threshold: FloatArray

    def __len__(self) -> int:
        return len(self.threshold)


@dataclass(frozen=True, slots=True)
class FlightEvent:
    """What may happen to a flight, other than the failure of its mission: leaving a volume, for example.

    Attributes
    ----------
    happens : callable
        From flights (n, T+1, 2) [m] to whether the event happens to each (n,).
    normals : callable
        From flights (n, T+1, 2) [m] to which it happens to directions (n, T+1, 2), of any size: a step in
        them makes it happen more. They only decide how many draws an estimate needs.
    """

    happens: Callable[[FloatArray], BoolArray]
    normals: Callable[[FloatArray], FloatArray]


@dataclass(frozen=True, slots=True)
class FlownPlan:
    """A plan, and the law linearised about its means.

    Attributes
    ----------
    event : FlightEvent or None
        What is rare; None for the failure of the mission.
    mean : (T+1, 2) float
        Means about which the law is linearised [m].
    sd : float
        Largest standard deviation of a coordinate [m].
    """

    problem: Problem
    path: PlannedPath
    linear: kernel.LinearLaw
    mean: FloatArray
    sd: float
    event: FlightEvent | None = None

    @property
    def tail(self) -> ErrorTail | None:
        """The tails of the errors that flights draw; None under the independent law, or without any."""
        return self.problem.tail if self.problem.fidelity.law == "coherent" else None

    def fly(self, z: kernel.NormalDraws, theta: Float32Array) -> tuple[FloatArray, BoolArray]:
        """Positions (n, T+1, 2) [m] of the flights ``z`` in the nonlinear law, and which the event meets.

        ``theta`` (E, n, 2, P) is the field whose innovations are in ``z``.
        """
        problem, path, law = self.problem, self.path, self.problem.fidelity.law
        x = np.empty((len(z.start), len(path.x), 2))
        own = problem.own_errors(law)
        x[:, 0] = problem.scene.start + self.linear.start_sd * z.start + z.errors @ own.start.T
        pilot = erring_pilot(Autopilot(path.u, np.ascontiguousarray(path.x)), path.u, own, z.errors)
        sim.fly_draws(problem, _winds(problem, z, theta), pilot, x, problem.energy)
        if self.event is not None:
            return x, self.event.happens(x)
        return x, Deployment.judged(problem, law, x).failed

    def fly_along(self, directions: kernel.Directions, row: IntArray, size: FloatArray) -> BoolArray:
        """Which of the flights z = ``size`` ω fail, ω the directions ``row``."""
        z = kernel.NormalDraws(
            directions.start[row] * size[:, None],
            np.moveaxis(directions.white[row] * size[:, None, None], 0, 1),
            np.moveaxis(directions.field[row] * size[:, None, None, None], 0, 1).astype(np.float32),
            directions.errors[row] * size[:, None],
        )
        return self.fly(z, linked_fields(self.linear, z))[1]


def flown_plan(problem: Problem, path: PlannedPath, event: FlightEvent | None = None) -> FlownPlan:
    """The plan, and the law of ``problem.fidelity`` linearised about it."""
    smooth = SMOOTH_LAWS[problem.fidelity.law](problem)
    # With feedback the robot steers towards the planned positions; without it, its controls decide.
    held = problem.motion.gain > 0.0
    flight = propagate(problem, path.x, smooth) if held else propagate_controls(problem, path.u, smooth)
    sd = math.sqrt(float(flight.cov[:, [0, 2]].max()))
    return FlownPlan(problem, path, linear_law(problem, flight, smooth), flight.x, sd, event)


# --- half-spaces ------------------------------------------------------------------------------


def find_failure_modes(plan: FlownPlan) -> FailureModes:
    """Half-spaces at the failures of flights of ``plan``; none if the plan itself fails."""
    none = FailureModes(np.empty((0, *plan.mean.shape)), np.empty(0))
    if plan.sd == 0.0:
        return none
    feedback = FEEDBACK if plan.problem.motion.gain > 0.0 else (1.0,)
    forms = less_held_forms(plan, _event_normals(plan, _first_failures(plan)), feedback)
    if plan.problem.motion.gain > 0.0:
        along = headwinds(plan.path.u)
        if plan.problem.motion.u_min > 0.0:
            along = np.concatenate([along, -along])
        forms = np.concatenate([forms, less_held_forms(plan, along, (0.0,))])
    omega = _joined(directions_of(plan.linear, forms))
    sd = np.linalg.norm(omega, axis=1)
    varies = sd > 0.0
    weight, omega = forms[varies] / sd[varies, None, None], omega[varies] / sd[varies, None]
    flown = _unlike(omega, SAME)
    weight, omega = weight[flown], omega[flown]
    if not len(weight):
        return none
    largest, ray = (1.0, NEAR_RAY) if plan.tail is None else (LARGE, FAR_RAY)
    threshold = _first_failing(plan, directions_of(plan.linear, weight), ray)
    if (threshold == 0.0).any():
        return none
    order = np.argsort(threshold, kind="stable")
    order = order[np.isfinite(threshold[order])]
    order = order[_unlike(omega[order], ALIKE)]
    chance = np.cumsum(ndtr(-threshold[order] / largest))
    if not len(chance):
        return none
    order = order[: int(np.searchsorted(chance, KEPT * chance[-1])) + 1]
    return FailureModes(weight[order], threshold[order])


def _first_failures(plan: FlownPlan) -> FloatArray:
    """Positions (n, T+1, 2) [m] of pilots, enlarged until they fail; the least enlarged first."""
    law = plan.linear
    z = normal_draws(law, PILOTS, np.random.default_rng(0))
    found, rows = [np.empty((0, *plan.mean.shape))], np.arange(PILOTS)
    for factor in ENLARGED:
        field = z.field[:, rows] * np.float32(factor)
        enlarged = kernel.NormalDraws(
            factor * z.start[rows], factor * z.white[:, rows], field, factor * z.errors[rows]
        )
        x, failed = plan.fly(enlarged, linked_fields(law, enlarged))
        found.append(x[failed])
        rows = rows[~failed]
        if len(rows) == 0:
            break
    return np.concatenate(found)[:MAX_EVENTS]


def _event_normals(plan: FlownPlan, x: FloatArray) -> FloatArray:
    """Gradients (n, T+1, 2) of the margins of the failed flights ``x`` (n, T+1, 2), of any size."""
    if plan.event is not None:
        return plan.event.normals(x)
    model = margin_model(plan.problem)
    normals = np.zeros(x.shape)
    scratch = margin_scratch(model, 1, len(plan.mean))
    for k, flight in enumerate(x):
        off = np.ascontiguousarray((flight - plan.mean)[:, :, None])
        slope = Slope(normals[k], np.zeros((len(plan.mean), 3)))
        smoothed_failure(model, plan.mean, off, plan.sd, slope, scratch)
    return normals


def headwinds(u: FloatArray) -> FloatArray:
    """Forms (m, T+1, 2) of the deviations without feedback: how far winds against ``u`` (T, 2) set it back.

    Each is over the steps of one of ``SPANS``, or over all.
    """
    steps, forms = len(u), []
    ahead = u / np.maximum(np.linalg.norm(u, axis=1, keepdims=True), 1e-12)
    for span in (*(n for n in SPANS if n < steps), steps):
        for first in range(0, steps - span + 1, max(1, span // 2)):
            form, within = np.zeros((steps + 1, 2)), slice(first, first + span)
            form[within] += ahead[within]
            form[first + 1 : first + span + 1] -= ahead[within]
            forms.append(form)
    return np.array(forms).reshape(-1, steps + 1, 2)


def less_held_forms(plan: FlownPlan, normals: FloatArray, feedback: tuple[float, ...]) -> FloatArray:
    """Σ_t ``normals[k, t]``' of the deviations with shares of the feedback, as forms (m, T+1, 2) of e.

    The wind of a step adds d_t = e_{t+1} - F_t e_t. With less feedback the deviations are ẽ_{t+1} = G_t ẽ_t
    + d_t. Backwards from q_T = g_T, with q_t = G_t' q_{t+1} + g_t,

        Σ_t g_t' ẽ_t = q_T' e_T + Σ_{t<T} (q_t - F_t' q_{t+1})' e_t.

    Eq. (M63) of docs/mathematics_methods.md.
    """
    made = []
    for share in feedback:
        form, q = normals.copy(), normals[:, -1]
        for t in range(len(plan.linear.F) - 1, -1, -1):
            F = plan.linear.F[t]
            G = np.eye(2) + share * (F - np.eye(2))
            later, q = q, q @ G + normals[:, t]
            form[:, t] = q - later @ F
        made.append(form)
    return np.concatenate(made)


def _first_failing(plan: FlownPlan, directions: kernel.Directions, ray: FloatArray) -> FloatArray:
    """The first r (J,) at which flights along each direction fail; 0 if the plan does, infinite if none.

    Of the lengths ``ray``, and between two of them.
    """
    count = len(directions.start)
    rows, sizes = np.repeat(np.arange(count), len(ray)), np.tile(ray, count)
    failed = plan.fly_along(directions, rows, sizes).reshape(count, -1)
    first = failed.argmax(axis=1)
    high = np.where(failed.any(axis=1), ray[first], math.inf)
    between = np.flatnonzero(np.isfinite(high) & (high > 0.0))
    low = ray[first[between] - 1]
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high[between])
        fails = plan.fly_along(directions, between, middle)
        high[between], low = np.where(fails, middle, high[between]), np.where(fails, low, middle)
    return high


def _unlike(omega: FloatArray, limit: float) -> list[int]:
    """Rows of ``omega`` (J, D), |ω| = 1, that correlate at most ``limit`` with those listed before them."""
    alike, kept = omega @ omega.T > limit, list[int]()
    for j in range(len(omega)):
        if not alike[j, kept].any():
            kept.append(j)
    return kept


def _joined(directions: kernel.Directions) -> FloatArray:
    """The directions as rows (J, D)."""
    return np.concatenate([part.reshape(len(part), math.prod(part.shape[1:])) for part in directions], axis=1)


# --- the linear law ---------------------------------------------------------------------------


def _white_law(problem: Problem) -> kd.CoherentLaw:
    """The independent law as the coherent one without modes, whose white part lasts one step."""
    modes = problem.modes
    none = modes._replace(
        part=modes.part[:0], kept=np.zeros((len(modes.kept), 0), np.float32),
        scale=np.zeros((len(modes.scale), 0), np.float32),
        psi=np.zeros((*modes.psi.shape[:-1], 0), np.float32), white=1.0, rest=1.0,
    )  # fmt: skip
    return kd.CoherentLaw(problem.wind, none, problem.motion)


SMOOTH_LAWS: Mapping[str, Callable[[Problem], kd.CoherentLaw]] = {
    "coherent": lambda problem: kd.CoherentLaw(
        problem.wind, problem.modes, problem.motion, problem.own_errors("coherent")
    ),
    "independent": _white_law,
}


def linear_law(problem: Problem, flight: Flight, law: kd.CoherentLaw) -> kernel.LinearLaw:
    """The law linearised about ``flight``, which was propagated in it."""
    steps, motion = len(flight.u), law.motion
    return kernel.LinearLaw(
        flight.F, flight.psi, np.sqrt(flight.white), law.modes.epoch[:steps],
        sim.kept_by_epoch(law.modes, steps), motion.exposed * motion.dt, math.sqrt(problem.start_variance),
        flight.errors.push, flight.errors.law.start,
    )  # fmt: skip


def directions_of(law: kernel.LinearLaw, weight: FloatArray) -> kernel.Directions:
    """ω of Σ_t ``weight[j, t]``' e_t = ω_j' z, for ``weight`` (J, T+1, 2).

    Backwards through e' = F e + dt (ψ' θ + white) with p_T = weight_T:

        p_t = F_t' p_{t+1} + weight_t,
        ω_white,t = dt white_t p_{t+1},    g_k = dt Σ_{t in epoch k} ψ_t p_{t+1},
        ω_κ = dt Σ_t E_t' p_{t+1} + D' p_0,    D the part of the start by κ,

    and through θ_k = ρ_k θ_{k-1} + √(1 - ρ_k²) η_k from the last epoch: ω_η,k = √(1 - ρ_k²) g_k, then
    g_{k-1} grows by ρ_k g_k.

    Eq. (M62) of docs/mathematics_methods.md.
    """
    J, steps, modes = len(weight), len(law.white), law.psi.shape[-1]
    white, fields = np.empty((J, steps, 2)), np.zeros((J, len(law.kept), 2, modes))
    p, errors = weight[:, steps], np.zeros((J, law.push.shape[-1]))
    for t in range(steps - 1, -1, -1):
        errors += law.dt * p @ law.push[t]
        white[:, t] = law.dt * law.white[t] * p
        fields[:, law.epoch[t]] += law.dt * p[:, :, None] * law.psi[t]
        p = p @ law.F[t] + weight[:, t]
    persistence = law.kept.astype(float)
    for k in range(len(persistence) - 1, 0, -1):
        fields[:, k - 1] += persistence[k] * fields[:, k]
        fields[:, k] *= np.sqrt(1.0 - persistence[k] ** 2)
    return kernel.Directions(law.start_sd * p, white, fields, errors + p @ law.lean)


def linear_deviations(law: kernel.LinearLaw, draws: kernel.NormalDraws, theta: Float32Array) -> FloatArray:
    """Deviations e (n, T+1, 2) [m] under the linear law.

    ``theta`` (E, n, 2, P) is the field whose innovations are in ``draws``.

    Eq. (M22) of docs/mathematics.md.
    """
    wind = np.zeros((len(law.white), len(draws.start), 2))
    rollout.winds_at_means(law.psi, law.white, law.epoch, draws.white, theta, wind)
    wind += np.einsum("tcq,nq->tnc", law.push, draws.errors)
    e = np.empty((len(draws.start), len(wind) + 1, 2))
    e[:, 0] = law.start_sd * draws.start + draws.errors @ law.lean.T
    for t, F in enumerate(law.F):
        e[:, t + 1] = e[:, t] @ F.T + law.dt * wind[t]
    return e


def normal_draws(law: kernel.LinearLaw, n: int, rng: Generator) -> kernel.NormalDraws:
    """z of ``n`` flights."""
    return kernel.NormalDraws(
        rng.standard_normal((n, 2)),
        rng.standard_normal((len(law.white), n, 2)),
        sim.draw_innovations(law.kept, n, rng),
        rng.standard_normal((n, law.push.shape[-1])),
    )


def linked_fields(law: kernel.LinearLaw, draws: kernel.NormalDraws) -> Float32Array:
    """The field θ (E, n, 2, P) whose innovations are in ``draws``."""
    theta = draws.field.copy()
    rollout.link_fields(law.kept, theta)
    return theta


def _winds(problem: Problem, z: kernel.NormalDraws, theta: Float32Array) -> rollout.Draws:
    """The winds of the flights ``z`` in the nonlinear law of the plan."""
    law = problem.laws[problem.fidelity.law]
    if isinstance(law, kd.IndependentLaw):
        return rollout.IndependentDraws(law, z.white)
    return rollout.CoherentDraws(law, z.white, theta)
