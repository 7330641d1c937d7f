"""Prices: how many failures a plan would save if one of its limits were a little easier.

At the best path for its length, a small change of the map changes the least failure rate by its partial
derivative in the Lagrangian (the envelope theorem): the change of the failures of the path as it is, and the
multipliers of the constraints. The first part comes from the binding events of flights: a flight with the
margin m fails with the weight σ(-m/τ), and a barrier that is one metre smaller raises the margin of the
flights that it binds by one metre. The second part are the multipliers of the chance constraints, of the
airspeed and of the length in the convex programme (:mod:`~.programme`) about the path, with its number of
steps. The slope of the front is no price of the length: a rule picks points whose longer neighbours, by the
shape of the front or by chance, fail hardly less.

All of it is computed for each of several blocks of flights: their mean is the price, their spread its error.

Eq. (M74) of docs/mathematics_methods.md.
"""

from __future__ import annotations

import logging
import math
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from itertools import chain
from typing import NamedTuple

import numpy as np

from pareto_ltl.kernels.descent import LEAST_VALUE
from pareto_ltl.planning.convex.programme import Descent, Solution, programme_for
from pareto_ltl.planning.evaluate import propagate
from pareto_ltl.planning.limits import Price, SegmentLimits
from pareto_ltl.planning.margin_model import margin_model, margin_scratch, shown_letters
from pareto_ltl.planning.problem import Problem, barrier_outlines, barrier_polygons, lines_of
from pareto_ltl.planning.records import PlannedPath
from pareto_ltl.planning.refine.sampled import deviations_from
from pareto_ltl.planning.separation import barrier_names, keeps_epsilon
from pareto_ltl.support.arrays import FloatArray, IntArray
from plane_logic import margin as km
from plane_logic.margin_events import NOWHERE, MarginModel, Scratch

WIDTH = 0.001  # τ as a share of the map's size: half the last width of a polish, with more flights
AFAR = 2.0  # [τ] where flights lie at any distance, those farther make up a quarter of a price
TRUST = 0.5  # trust region of the programme about the path [full steps]
LEAST_SHARE = 0.01  # prices below this share of the largest of their kind are left out
MAX_STEPS = 400  # of a path: for 1,300 steps the convex programme needs 8 GiB
FULL_SPEED = 0.98  # share of u_max from which a step uses all airspeed
LEAST_GAIN = 0.01  # relative fall of the failures by a relative length: less is rounding of the solver
LIMITS = "airspeed", "length"  # kinds whose prices are multipliers alone, in the order of the list
LOG = logging.getLogger(__name__)


class Binding(NamedTuple):
    """What binds in flights: the kind and the name of a limit, the step, and the saving per metre [1/m].

    ``afar`` is the part of the saving that flights farther than ``AFAR`` τ from the limit make up.
    """

    kind: str
    name: str
    step: int | None
    saving: float
    afar: float = 0.0


def limits_of(
    problem: Problem, path: PlannedPath, blocks: Iterable[FloatArray]
) -> tuple[SegmentLimits | None, tuple[Price, ...]]:
    """The chance constraint of each segment of ``path``, and the prices of its limits.

    Parameters
    ----------
    blocks : iterable of (n, T+1, 2) float
        Flights of ``path`` in the winds of ``fidelity.law`` [m]. With fewer than two blocks errors are 0.
    """
    if len(path.u) > MAX_STEPS:
        LOG.info("no prices of airspeed, length and epsilon: the path has more than %d steps", MAX_STEPS)
    limits = segment_limits(problem, path.x)
    found, flights = list[list[Binding]](), 0
    for positions in blocks:
        found.append(list(_block_bindings(problem, path, limits, positions)))
        flights += len(positions)
    prices = _priced([[row for row in rows if row.kind not in LIMITS] for rows in found])
    # a price p is the density of the margins at 0, and 6 n τ p the effective number of flights in it: below
    # one, or where most of it is of flights afar, it is the tail of the smoothing, not a property of flights
    least, afar = 1.0 / (6.0 * flights * _width(problem)), defaultdict[tuple[str, str], float](float)
    for row in chain(*found):
        afar[row.kind, row.name] += row.afar / len(found)
    near = [
        price for price in prices
        if price.saving >= least and 2.0 * afar[price.kind, price.name] <= price.saving
    ]  # fmt: skip
    if limits is not None:
        barriers = {price.name for price in near if price.kind in ("obstacle", "border")}
        for row in chain(*found):
            if row.kind in ("obstacle", "border") and row.name in barriers and row.step is not None:
                limits.price[row.step] += row.saving / len(found)
    places = [price for price in near if price.saving >= LEAST_SHARE * near[0].saving]
    others = (_priced([[row for row in rows if row.kind == kind] for rows in found]) for kind in LIMITS)
    return limits, tuple(price for price in (*places, *chain(*others)) if price.saving > 0.0)


def _width(problem: Problem) -> float:
    """The width τ [m] of the smoothed failure whose slopes are prices."""
    return WIDTH * float(np.ptp(problem.scene.bounds, axis=0).mean())


def _block_bindings(
    problem: Problem, path: PlannedPath, limits: SegmentLimits | None, positions: FloatArray
) -> Iterator[Binding]:
    """What binds in one block of flights (n, T+1, 2), and the multipliers of the programme."""
    if not np.ptp(positions, axis=0).any():  # all flights are the same: no rate changes with the map
        return
    model, slope = margin_model(problem), km.Slope(np.zeros((len(path.x), 2)), np.zeros((len(path.x), 3)))
    scratch = margin_scratch(model, len(positions), len(path.x))
    width, off = _width(problem), deviations_from(positions, path.x)
    value = float(km.smoothed_failure(model, path.x, off, width, slope, scratch))
    local = Descent(slope.gradient, slope.hessian, max(value, LEAST_VALUE))
    yield from _bindings(problem, model, positions, width, scratch)
    solution = _solution(problem, path, local)
    if solution is None:
        return
    if limits is not None:
        for t in np.flatnonzero(solution.clearer > 0.0).tolist():
            name = limits.nearest[t]
            yield Binding(_kind_of(name), name, t, local.value * float(solution.clearer[t]))
    speed = float(np.linalg.norm(path.u, axis=1).max())
    if speed >= FULL_SPEED * problem.motion.u_max:  # else its multiplier is rounding of the solver
        yield Binding("airspeed", "largest airspeed", None, local.value * solution.faster)
    if solution.longer * path.objectives.length >= LEAST_GAIN:
        yield Binding("length", "length", None, local.value * solution.longer)


def _solution(problem: Problem, path: PlannedPath, model: Descent) -> Solution | None:
    """The programme about ``path``; None where paths do not end in it, or it has no solution.

    Paths of more than ``MAX_STEPS`` steps do not end in it either. About a path that breaks epsilon its
    multipliers measure the breach, not failures.
    """
    if len(path.u) > MAX_STEPS or problem.fidelity.judge != "flights" or problem.fidelity.refine == "none":
        return None
    if not keeps_epsilon(problem, path):
        return None
    length = path.objectives.length
    return programme_for(problem, len(path.u)).descend(propagate(problem, path.x), model, TRUST, length)


# --- what binds -------------------------------------------------------------------------------


def _bindings(
    problem: Problem, model: MarginModel, positions: FloatArray, width: float, scratch: Scratch
) -> Iterator[Binding]:
    """The binding events of the flights; events of one limit at one step are one."""
    from scipy.special import expit

    fails = expit(-scratch.margins / width)
    weight = fails * (1.0 - fails) / (width * len(positions))
    counted = weight > 1e-6 * weight.max(initial=0.0)
    beyond = np.where(np.abs(scratch.margins) > AFAR * width, weight, 0.0)
    at_barrier = np.flatnonzero(counted & (scratch.met.t != NOWHERE))
    met = _barriers_met(problem, positions, scratch, at_barrier)
    names = barrier_names(problem)
    for (k, t), saving, afar in _totals(
        met, scratch.met.t[at_barrier], weight[at_barrier], beyond[at_barrier]
    ):
        yield Binding(_kind_of(names[k]), names[k], t, saving, afar)
    others = np.flatnonzero(counted & (scratch.met.t == NOWHERE) & (scratch.event != NOWHERE))
    for (number, _), saving, afar in _totals(
        scratch.event[others], 0 * others, weight[others], beyond[others]
    ):
        yield _mission_binding(problem, model, number, saving)._replace(afar=afar)


def _totals(
    first: IntArray, second: IntArray, *weights: FloatArray
) -> Iterator[tuple[tuple[int, int], float, float]]:
    """The sums of both weights of each pair."""
    pairs, row = np.unique(np.column_stack([first, second]), axis=0, return_inverse=True)
    sums = (np.bincount(row.ravel(), weights=one, minlength=len(pairs)).tolist() for one in weights)
    yield from zip(map(tuple, pairs.tolist()), *sums, strict=True)


def _barriers_met(problem: Problem, positions: FloatArray, scratch: Scratch, rows: IntArray) -> IntArray:
    """Number of the barrier nearest to the binding point of each flight of ``rows``."""
    import shapely

    met = scratch.met
    t, share = met.t[rows], met.share[rows, None]
    at = (1.0 - share) * positions[rows, t] + share * positions[rows, t + 1]
    if not len(rows):
        return np.empty(0, np.int64)
    outlines = [shapely.Polygon(corners) for corners in barrier_outlines(problem)]
    gaps = shapely.distance(np.asarray(shapely.points(at))[:, None], np.array(outlines)[None])
    return np.asarray(gaps.argmin(axis=1), np.int64)


def _mission_binding(problem: Problem, model: MarginModel, number: int, saving: float) -> Binding:
    """The region of a mission event, by its number (:mod:`~plane_logic.margin_events`)."""
    if number >= 0:
        t, letter = divmod(number // 2, len(model.first))
        cell, wanted = int(shown_letters(problem)[letter][0]), number % 2 == 0
    else:
        t, hazard = divmod((-2 - number) // 2, len(model.logic.hazards.cell))
        cell, wanted = int(model.logic.hazards.cell[hazard]), number % 2 == 1
    name = " and ".join(sorted(problem.labels[cell] & set(problem.atoms))) or "the free space"
    return Binding("region" if wanted else "avoided", name, t, saving)


def _kind_of(barrier: str) -> str:
    return "border" if barrier.endswith("border") else "obstacle"


def _priced(blocks: Sequence[Iterable[Binding]]) -> list[Price]:
    """One price for each limit: the mean over the blocks, with its standard error; the largest first."""
    steps: dict[tuple[str, str], dict[int | None, float]] = defaultdict(lambda: defaultdict(float))
    sums: dict[tuple[str, str], FloatArray] = defaultdict(lambda: np.zeros(len(blocks)))
    for number, rows in enumerate(blocks):
        for row in rows:
            steps[row.kind, row.name][row.step] += row.saving
            sums[row.kind, row.name][number] += row.saving
    prices = [
        Price(kind, name, max(found, key=lambda t: found[t]), *_mean_and_error(sums[kind, name]))
        for (kind, name), found in steps.items()
    ]
    return sorted(prices, key=lambda price: (-price.saving, price.name))


def _mean_and_error(sums: FloatArray) -> tuple[float, float]:
    error = sums.std(ddof=1) / math.sqrt(len(sums)) if len(sums) > 1 else 0.0
    return math.fsum(sums) / len(sums), float(error)


def segment_limits(problem: Problem, x: FloatArray) -> SegmentLimits | None:
    """The closest barrier of each segment along ``x`` (T+1, 2) [m], without prices; None without barriers."""
    flight, corners = propagate(problem, x), barrier_polygons(problem)
    if not len(corners.radius):
        return None
    everywhere = np.ones((len(flight.u), len(corners.radius)), bool)
    lines = lines_of(corners, everywhere, flight.x, flight.cov, 1, math.inf)
    names = barrier_names(problem)
    nearest = tuple(names[k] for k in lines.owner[:, 0])
    return SegmentLimits(nearest, lines.line[:, 0, 3].copy(), lines.risk, np.zeros(len(flight.u)))
