"""Flights of the results are judged again, and new ones are simulated with other random numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import compress, groupby
from typing import Any, Protocol

import numpy as np
from scipy.special import betaincinv
from scipy.stats import chi2, chi2_contingency, hypergeom, ks_2samp

from pareto_ltl_verify.arrays import BoolArray, FloatArray, IntArray
from pareto_ltl_verify.formula import Dfa, Label, Timetable, harmful
from pareto_ltl_verify.gaussians import ON_EDGE
from pareto_ltl_verify.geometry import Convex, beyond_bounds, deepest, met_by_any
from pareto_ltl_verify.laws import Coherent, Independent, Landmark, Law, fly_means
from pareto_ltl_verify.robot import Robot
from pareto_ltl_verify.tails import drawn_scales, scaled_field
from pareto_ltl_verify.wind_tables import square_of

SHORTEST = 1e-12  # share of a step; shorter pieces of it are rounding
RARE = 1e-7  # significance level of each statistical claim: probability that correct results fail it
CELL = 30  # flights in a cell of a χ² test
NONE: Label = frozenset()
SHARES = 8  # parts of a step in which the planner puts a fix
History = tuple[tuple[int, int, int], ...]  # step, landmark and part of the step of each fix
NEAR = 1.0  # [m] a position that is closer to an obstacle's face may count on either side


@dataclass(frozen=True, slots=True)
class Ground:
    """The map and mission by which flights are judged.

    Bounds (2, 2) [m], convex parts of regions and obstacles, and the automaton; ``walled`` is whether the
    border is a wall. Propositions with time windows hold as in the ``timetable``.
    """

    bounds: FloatArray
    regions: Mapping[str, Sequence[Convex]]
    obstacles: Sequence[Convex]
    dfa: Dfa
    walled: bool = False
    timetable: Timetable = field(default_factory=Timetable)

    def labels(self, points: FloatArray, slack: float = 0.0) -> list[frozenset[str]]:
        """Label of each of ``points`` (P, 2) [m]; the empty label in obstacles and beyond the bounds.

        ``slack`` [m] widens the regions and the free space.
        """
        free = ((points >= self.bounds[0]) & (points <= self.bounds[1])).all(axis=1)
        free &= deepest(self.obstacles, points) <= ON_EDGE + max(slack, 0.0)
        inside = np.column_stack([
            np.zeros(len(points), bool),
            *(free & (deepest(parts, points) >= -ON_EDGE - slack) for parts in self.regions.values()),
        ])  # fmt: skip
        rows, row = np.unique(np.packbits(inside, axis=1), axis=0, return_index=True, return_inverse=True)[1:]
        named = [frozenset(compress(("", *self.regions), inside[k])) for k in rows.tolist()]
        return [named[k] for k in row.ravel().tolist()]

    def columns(self, points: FloatArray, slack: float = 0.0, holding: Label = NONE) -> IntArray:
        """Indices (P,) of the automaton's letters at ``points`` while windows ``holding`` are open."""
        place, labels = {letter: i for i, letter in enumerate(self.dfa.letters)}, self.labels(points, slack)
        number = {label: place.get(self.letter(label, holding), -1) for label in set(labels)}
        return np.array([number[label] for label in labels], int)

    def letter(self, label: Label, holding: Label) -> Label:
        """The letter of a label while windows ``holding`` are open."""
        return self.timetable.letter(label, holding) & frozenset(self.dfa.atoms)

    def accepted(self, x: FloatArray, slack: float = 0.0) -> BoolArray:
        """Which flights ``x`` (n, T+1, 2) complete the mission."""
        return np.asarray(np.array(self.dfa.accepting)[self.states(x, slack)[:, -1]], bool)

    def states(self, x: FloatArray, slack: float = 0.0) -> IntArray:
        """Automaton states of flights ``x`` (n, T+1, 2) after each step, (n, T+1)."""
        seen = [self.columns(x[:, t], slack, self.timetable.now(t)) for t in range(x.shape[1])]
        found = [np.array(self.dfa.delta)[np.full(len(x), self.dfa.initial), seen[0]]]
        for t in range(1, x.shape[1]):
            legs = Legs(x[:, t - 1], x[:, t], seen[t - 1], seen[t])
            found.append(self.after_step(found[-1], legs, slack, self.timetable.way(t)))
        return np.stack(found, axis=1)

    def after_step(self, state: IntArray, legs: Legs, slack: float = 0.0, holding: Label = NONE) -> IntArray:
        """States (n,) after steps: harmful letters between the ends are read first, then the end's letter.

        Letters between the ends are read only if the letter of the start does not change the state: otherwise
        the formula counts steps. Windows ``holding`` are open between the ends.
        """
        delta, state = np.array(self.dfa.delta), state.copy()
        harm = harmful(self.dfa, self.letter(NONE, holding))
        rows = np.flatnonzero(harm[state].any(axis=1) & (delta[state, legs.first] == state))
        for i in rows[self._near_harm(legs, rows, harm, slack)]:
            for letter in self.letters_between(legs.start[i], legs.end[i], slack, holding):
                if harm[state[i], letter]:
                    state[i] = delta[state[i], letter]
        return np.asarray(delta[state, legs.last], int)

    def _near_harm(self, legs: Legs, rows: IntArray, harm: BoolArray, slack: float) -> BoolArray:
        """Which legs meet a region of a harmful letter; all of them if a harmful letter has no region."""
        worst = [letter for letter, bad in zip(self.dfa.letters, harm.T, strict=True) if bad.any()]
        places = [{self.timetable.region(name) for name in letter} - {None} for letter in worst]
        if not all(places):
            return np.ones(len(rows), bool)
        parts = [part for name in set().union(*places) for part in self.regions.get(name or "", ())]
        return met_by_any(parts, legs.start[rows], legs.end[rows], -abs(slack) - ON_EDGE)

    def letters_between(
        self, start: FloatArray, end: FloatArray, slack: float = 0.0, holding: Label = NONE
    ) -> list[int]:
        """Indices of the letters along a segment, in order, without those at its two ends.

        The segment is cut at the line of every face; each piece has the letter of its middle. Pieces in
        obstacles and beyond the bounds have no letter.
        """
        parts = [part for several in self.regions.values() for part in several]
        parts += [*self.obstacles, *beyond_bounds(self.bounds)]
        normals = np.vstack([part.normals for part in parts])
        offsets = np.concatenate([part.offsets for part in parts])
        with np.errstate(divide="ignore", invalid="ignore"):
            cut = (offsets - normals @ start) / (normals @ (end - start))
        cut = np.unique(np.concatenate([[0.0], cut[(cut > 0) & (cut < 1)], [1.0]]))
        cut = cut[np.append(True, np.diff(cut) > SHORTEST)]
        middles = start + ((cut[:-1] + cut[1:]) / 2)[:, None] * (end - start)
        low, high = self.bounds
        free = ((middles >= low) & (middles <= high)).all(axis=1) & (deepest(self.obstacles, middles) <= 0)
        pieces = np.where(free, self.columns(middles, slack, holding), -1)
        inner = [letter for letter, _ in groupby(pieces.tolist())]
        first, last = self.columns(np.stack([start, end]), slack, holding).tolist()
        inner = inner[inner[:1] == [first] :]
        inner = inner[:-1] if inner[-1:] == [last] else inner
        return [letter for letter in inner if letter >= 0]

    def collided(self, x: FloatArray, margin: float = ON_EDGE) -> BoolArray:
        """Which flights (n,) lie deeper than ``margin`` [m] in an obstacle, at or between steps."""
        hit = np.zeros(len(x), bool)
        for t in range(x.shape[1] - 1):
            hit |= met_by_any(self.obstacles, x[:, t], x[:, t + 1], margin)
        return hit

    def off_map(self, x: FloatArray, slack: float = ON_EDGE) -> BoolArray:
        """Which flights have a position more than ``slack`` [m] beyond the bounds."""
        low, high = self.bounds
        beyond: BoolArray = ((x < low - slack) | (x > high + slack)).any(axis=(1, 2))
        return beyond

    def failed(self, x: FloatArray) -> BoolArray:
        """Which flights (n,) fail: miss the mission, meet an obstacle or, if ``walled``, leave the map."""
        return failures(self.accepted(x), self.collided(x), self.off_map(x), self.walled)


@dataclass(frozen=True, slots=True)
class Legs:
    """Steps from ``start`` (n, 2) to ``end`` (n, 2) [m], and the indices of the letters at both."""

    start: FloatArray
    end: FloatArray
    first: IntArray
    last: IntArray


def failures(accepted: BoolArray, collided: BoolArray, off_map: BoolArray, walled: bool) -> BoolArray:
    """Which flights (n,) count as failed; leaving the map counts if ``walled``."""
    failed: BoolArray = ~accepted | collided
    return failed | off_map if walled else failed


def misjudged(ground: Ground, x: FloatArray, flags: Sequence[BoolArray], grain: float) -> int:
    """Number of flights whose flags do not follow from their positions; near a face either flag is right.

    The ``flags`` are accepted, collided and off the map.
    """
    judges, near = (ground.accepted, ground.collided, ground.off_map), (-grain, grain)
    wrong = set()
    for judge, stated, slacks in zip(judges, flags, ((*near, NEAR), near, near), strict=True):
        for k in np.flatnonzero(judge(x) != stated):
            if stated[k] not in [judge(x[k, None], slack)[0] for slack in slacks]:
                wrong.add(k)
    return len(wrong)


# --- new flights ------------------------------------------------------------------------------


class Normals(Protocol):
    """A source of standard normal numbers: a generator, or numbers that stand already."""

    def standard_normal(self, size: tuple[int, ...]) -> FloatArray:
        """The next numbers, in the shape ``size``."""

    def spawn(self, number: int) -> Sequence[Any]:
        """Sources of other numbers."""


def fly(
    law: Law,
    mean: FloatArray,
    u: FloatArray,
    runs: int,
    rng: Normals,
    landmarks: Sequence[Landmark] = (),
    change: FloatArray | None = None,
) -> FloatArray:
    """Positions (runs, T+1, 2) [m] of new flights of the controls ``u`` about ``mean`` under ``law``.

    Robots measure their position at ``landmarks``, or add ``change`` (T, runs, 2) [m/s] to their controls,
    within their airspeeds. Robots that correct their course land where they have
    spent their capacity.
    """
    robot, x = law.robot, np.empty((runs, len(u) + 1, 2))
    x[:, 0] = mean[0] + robot.start_sd * rng.standard_normal((runs, 2))
    filters = Filters(law, mean, landmarks, runs) if landmarks else None
    theta, before = rng.standard_normal((runs, law.coefficients)), np.broadcast_to(u[:1], (runs, 2))
    # Other random numbers, as many as the path has slots: the winds of paths of any length stay the same.
    scales = drawn_scales(law, runs, rng.spawn(1)[0])
    x[:, 0] += theta[:, law.modes :] @ law.errors.start.T
    changed = change is not None and bool(change.any())
    limited = robot.capacity is not None and (filters is not None or robot.feedback > 0.0 or changed)
    left = np.full(runs, robot.capacity) if limited else None  # [J]
    for t, planned in enumerate(u):
        theta = next_field(law, t, theta, rng) if t else theta
        wind = _drawn_wind(law, x[:, t], t, scaled_field(law, t, theta, scales), rng)
        own = theta[:, law.modes :]
        if filters:
            wanted = filters.controls(x, t, planned, rng)
        else:
            off = _off_plan(robot, u[max(t - 1, 0)], planned, own)
            wanted = _held_controls(robot, mean[t : t + 2], planned, x[:, t], wind + off)
        if change is not None and (asked := change[t].any(axis=1)).any():
            wanted = np.where(asked[:, None], robot.within_speed(wanted + change[t]), wanted)
        flown, before = robot.flown(wanted, wanted if t == 0 else before, own), wanted
        x[:, t + 1] = x[:, t] @ robot.a.T + robot.dt * (flown @ robot.b.T + wind)
        if left is not None:
            left -= robot.spent(flown)
            x[left < 0.0, t + 1] = x[left < 0.0, t]
    return x


def _off_plan(robot: Robot, before: FloatArray, u: FloatArray, own: FloatArray) -> FloatArray:
    """Velocities (n, 2) [m/s] by which the robots' errors ``own`` (n, Q) change a planned control (2,)."""
    planned, last = (np.broadcast_to(control, (len(own), 2)) for control in (u, before))
    return np.asarray((robot.flown(planned, last, own) - planned) @ robot.b.T, float)


def _drawn_wind(law: Law, x: FloatArray, t: int, theta: FloatArray, rng: Normals) -> FloatArray:
    """Wind that each flight meets at its position, (n, 2) [m/s]."""
    (met, latent), carried, modes = law.wind_at(t, x), np.zeros(2), law.wind.modes
    if isinstance(law, Coherent) and modes is not None:
        psi = square_of(modes.x, modes.y, x).value(law.modes_at(t))
        met = met + np.einsum("ncp,ncp->nc", psi, theta[:, : law.modes].reshape(len(x), 2, -1))
        carried = (psi**2).sum(axis=2)
    white = law.white_variance(t, latent, carried)
    return np.asarray(met + np.sqrt(white) * rng.standard_normal(met.shape), float)


def _held_controls(
    robot: Robot, means: FloatArray, u: FloatArray, x: FloatArray, wind: FloatArray
) -> FloatArray:
    """Controls (n, 2) [m/s] with feedback, within the airspeeds.

    The robot returns from its deviation, and within the step also counteracts part of the wind that it
    meets, beyond the one that the plan expects, with ``means`` (2, 2) at the step's ends and control ``u``.
    """
    if robot.feedback == 0.0:
        return np.broadcast_to(u, x.shape)
    expected = (means[1] - robot.a @ means[0]) / robot.dt - robot.b @ u
    back = robot.feedback / robot.dt * (x - means[0]) + (1.0 - robot.exposed) * (wind - expected)
    return robot.within_speed(u - np.linalg.solve(robot.b, back.T).T)


def next_field(law: Law, t: int, theta: FloatArray, rng: Normals) -> FloatArray:
    """θ (n, N) of step t from θ of step t - 1: ρ θ + √(1 - ρ²) η, with ρ of the part of each mode."""
    keep = law.kept(t)
    if (keep == 1).all():
        return theta
    return np.asarray(keep * theta + np.sqrt(1 - keep**2) * rng.standard_normal(theta.shape), float)


# --- position fixes ---------------------------------------------------------------------------


class Filters:
    """Filters of robots that measure their position in landmarks, one for each history of fixes.

    The joint covariance of (e_t, e_{t-1}, θ) about the planned means is propagated as one matrix, so that a
    fix between two steps is a Kalman update by a row of it.

    Attributes
    ----------
    law, guide : Law, Course
        The law of the flights, and the law linearised about the planned means; under the independent law
        fixes measure positions only.
    joint : dict of History to (4 + N, 4 + N) float
        Covariance of the errors of (e_t, e_{t-1}, θ).
    now, ago, wind : (n, 2), (n, 2), (n, N) float
        What each robot expects: ê at this step and at the last, θ̂.
    fixed, history : (n,) bool, list of n History
        Whether each robot has had a fix, and its fixes.
    """

    def __init__(self, law: Law, mean: FloatArray, landmarks: Sequence[Landmark], runs: int) -> None:
        """Robots before departure."""
        self.law, self.landmarks, modes = law, landmarks, law.coefficients
        self.guide = fly_means(replace(law, landmarks=()), mean)
        joint = np.eye(4 + modes)
        own = np.vstack([law.errors.start, law.errors.start])
        joint[:4, :4] = law.robot.start_sd**2 * np.tile(np.eye(2), (2, 2)) + own @ own.T
        joint[:4, 4 + law.modes :], joint[4 + law.modes :, :4] = own, own.T
        self.joint: dict[History, FloatArray] = {(): joint}
        self.now, self.ago, self.wind = np.zeros((runs, 2)), np.zeros((runs, 2)), np.zeros((runs, modes))
        self.fixed, self.history = np.zeros(runs, bool), list[History]([()] * runs)

    def controls(self, x: FloatArray, t: int, u: FloatArray, rng: Normals) -> FloatArray:
        """Controls (n, 2) [m/s] of all flights ``x`` (n, T+1, 2) at step t; ``u`` (2,) is the planned one."""
        self._observe(t, x, rng)
        robot, guide, fixed = self.law.robot, self.guide, self.fixed[:, None]
        expected = self.wind @ guide.psi[t].T
        wanted = u - np.linalg.solve(robot.b, (robot.fix_gain / robot.dt * self.now + expected).T).T
        flown = np.where(fixed, robot.within_speed(wanted), u)
        moved = self.now @ guide.F[t].T + robot.dt * (expected + (flown - u) @ robot.b.T)
        self.ago, self.now = self.now, np.where(fixed, moved, 0.0)
        return np.asarray(flown, float)

    def _carry(self, t: int) -> None:
        """All covariances from step t - 1 to t."""
        guide, dt, kept = self.guide, self.law.robot.dt, self.law.kept(t)
        M = np.zeros((4 + len(kept), 4 + len(kept)))
        M[:2, :2], M[:2, 4:], M[2:4, :2] = guide.F[t - 1], dt * guide.psi[t - 1], np.eye(2)
        M[4:, 4:] = np.diag(kept)
        fresh = np.concatenate([dt**2 * guide.white[t - 1], np.zeros(2), 1.0 - kept**2])
        self.joint = {key: M @ joint @ M.T + np.diag(fresh) for key, joint in self.joint.items()}
        self.wind *= kept

    def _observe(self, t: int, x: FloatArray, rng: Normals) -> None:
        """The fixes of all flights on their way to step t."""
        if t:
            self._carry(t)
        begin, here = x[:, max(t - 1, 0)], x[:, t]
        shares = np.column_stack([_last_share(mark.area, begin, here) for mark in self.landmarks])
        mark = shares.argmax(axis=1)
        share = shares[np.arange(len(x)), mark] if t else np.where(shares.max(axis=1) >= 0, 1.0, -1.0)
        groups: dict[History, list[int]] = {}
        for i in np.flatnonzero(share >= 0.0).tolist():
            part = min(max(int(share[i] * SHARES + 0.5), 1), SHARES)
            groups.setdefault((*self.history[i], (t, int(mark[i]), part)), []).append(i)
        noise = rng.standard_normal((len(x), 2))
        for key, rows in groups.items():
            error = np.linalg.cholesky(self.landmarks[key[-1][1]].error)
            s, own = share[rows, None], np.array(rows)
            self._update(key, own, s, begin[own] + s * (here[own] - begin[own]) + noise[own] @ error.T)
        live = set(self.history)
        self.joint = {key: joint for key, joint in self.joint.items() if key in live}

    def _update(self, key: History, rows: IntArray, share: FloatArray, read: FloatArray) -> None:
        """Kalman update of the flights ``rows``, which have the history ``key`` after this fix.

        They ``read`` positions (n, 2) [m] at a ``share`` (n, 1) of their step.
        """
        joint, (t, mark, part), mean = self.joint[key[:-1]], key[-1], self.guide.x
        H = np.zeros((2, len(joint)))
        H[:, :2], H[:, 2:4] = part / SHARES * np.eye(2), (1.0 - part / SHARES) * np.eye(2)
        gain = np.linalg.solve(H @ joint @ H.T + self.landmarks[mark].error, H @ joint).T
        self.joint.setdefault(key, joint - gain @ (H @ joint))
        known = share * (mean[t] + self.now[rows]) + (1.0 - share) * (mean[max(t - 1, 0)] + self.ago[rows])
        self.now[rows] += (read - known) @ gain[:2].T
        self.wind[rows] += (read - known) @ gain[4:].T
        self.fixed[rows] = True
        for i in rows.tolist():
            self.history[i] = key


def _last_share(mark: Convex, start: FloatArray, end: FloatArray) -> FloatArray:
    """The last share of each segment (S, 2) to (S, 2) [m] in a convex polygon, (S,); -1 where none is."""
    enter, leave, along = mark.pieces(start, end)
    return np.asarray(np.where((along < 0) | (enter > leave), -1.0, leave), float)


# --- statistics -------------------------------------------------------------------------------


def clopper_pearson(failures: int, runs: int) -> tuple[float, float]:
    """Exact 95 % confidence interval (low, high) of a rate."""
    low = float(betaincinv(failures, runs - failures + 1, 0.025)) if failures else 0.0
    high = float(betaincinv(failures + 1, runs - failures, 0.975)) if failures < runs else 1.0
    return low, high


def rate_of(failures: int, runs: int) -> dict[str, float]:
    """The ``failure`` rate, and the ends ``low`` and ``high`` of its interval."""
    low, high = clopper_pearson(failures, runs)
    return {"failure": failures / runs, "low": low, "high": high}


def same_rate(failures: int, runs: int, others: int, other_runs: int) -> float:
    """p value of Fisher's exact test, two-sided, that two rates are equal."""
    law = hypergeom(runs + other_runs, failures + others, runs)
    return float(min(1.0, 2 * min(law.cdf(failures), law.sf(failures - 1))))


def same_counts(one: IntArray, other: IntArray) -> float:
    """p value that the numbers 0, 1, 2, ... of two samples have the same distribution.

    χ² test of homogeneity. Neighbouring numbers are joined until about ``CELL`` of both samples have them.
    """
    size = np.bincount(np.concatenate([one, other]))
    cell = np.unique((np.cumsum(size) - 1) // CELL, return_inverse=True)[1].ravel()
    table = np.array([np.bincount(cell[sample], minlength=cell.max() + 1) for sample in (one, other)])
    return 1.0 if table.shape[1] == 1 else float(chi2_contingency(table, correction=False).pvalue)


def same_distribution(a: FloatArray, b: FloatArray, grain: float) -> float:
    """p value that coordinates (n, T, 2) and (m, T, 2) [m] have the same distributions.

    The least of the Kolmogorov-Smirnov tests, times their number (Bonferroni). Coordinates that vary by less
    than ``grain`` [m] are compared directly: 0 or 1.
    """
    chances = []
    for one, two in zip(a.reshape(len(a), -1).T, b.reshape(len(b), -1).T, strict=True):
        if max(np.ptp(one), np.ptp(two)) < grain:
            chances.append(float(abs(one.mean() - two.mean()) < grain))
        else:
            chances.append(float(ks_2samp(one, two, method="asymp").pvalue))
    return min(1.0, min(chances) * len(chances))


def winds_as_drawn(law: Independent, x: FloatArray, u: FloatArray) -> float:
    """p value that the winds of flights ``x`` with open-loop controls ``u`` are drawn from N(μ, Σ_w).

    The wind of a step is the motion minus the control, standardised with μ and Σ_w at the position. The sum
    of squares of all winds is chi-squared, and so is, after scaling, the square of their sum at each step.
    """
    robot, squares, count, drift = law.robot, 0.0, 0, 1.0
    for t in range(len(u)):
        mean, latent = law.wind_at(t, x[:, t])
        met = (x[:, t + 1] - x[:, t] @ robot.a.T) / robot.dt - u[t] @ robot.b.T
        gap, sd = met - mean, np.sqrt(law.white_variance(t, latent, 0.0))
        if (np.abs(gap[sd <= 1e-9]) > 1e-6).any():
            return 0.0
        z = gap / np.maximum(sd, 1e-9) * (sd > 1e-9)
        squares, count = squares + float((z * z).sum()), count + int((sd > 1e-9).sum())
        drift = min(drift, len(u) * float(chi2.sf((z.sum(axis=0) ** 2).sum() / len(z), 2)))
    if not count:
        return 1.0
    spread = 2 * min(float(chi2.cdf(squares, count)), float(chi2.sf(squares, count)))
    return min(1.0, 2 * min(spread, drift))


def rates(accepted: BoolArray, collided: BoolArray, off_map: BoolArray, walled: bool) -> dict[str, float]:
    """Failure rate, its interval, and the rates of its parts; one is leaving the map, if ``walled``."""
    failed = failures(accepted, collided, off_map, walled)
    parts = {"mission": ~accepted, "collision": collided, "off_map": off_map}
    shares = {name: float(flags.mean()) for name, flags in parts.items()}
    return {"runs": float(len(failed))} | rate_of(int(failed.sum()), len(failed)) | shares
