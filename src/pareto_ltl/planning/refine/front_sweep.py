"""The front of failure rate and length: sweeps of the length cap in the best classes of paths.

Every start is polished cheaply, and the best classes once more, to find the lengths that reduce the failure
rate. From the longest of these the cap falls until no path satisfies it, and rises until a longer path has no
lower failure rate. A level of the sweep begins with the best classes of the level before, in several numbers
of steps from the fewest upwards. The non-dominated paths are polished once more on more flights.

For a robot with a power curve, points of the front are also polished in more steps: at lower airspeeds a path
may take less energy.

With a time budget the sweeps end when most of it is spent. If some is left after them, paths of the front are
varied and polished again until it is spent.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import chain, count

import numpy as np

from pareto_ltl.planning.evaluate import completes_mission, evaluate_path
from pareto_ltl.planning.margin_model import margin_model
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.records import Forest, PlannedPath
from pareto_ltl.planning.refine.length_caps import KEPT, SPACING, front_of, spread_points
from pareto_ltl.planning.refine.path_classes import PathClass, path_class
from pareto_ltl.planning.refine.sampled import (
    Candidate,
    CommonFlights,
    Polish,
    Refiner,
    path_length,
    resampled_means,
    steps_needed,
)
from pareto_ltl.planning.refine.starts import Start, first_starts, flipped_starts, unlike_starts
from pareto_ltl.planning.selection import hypervolume
from pareto_ltl.settings import RefineConfig
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.budget import UNLIMITED, Budget
from pareto_ltl.support.cores import cores
from pareto_ltl.support.errors import InfeasibleError

COARSE = (0.020, 0.007)  # widths τ of the first polish of a start, as shares of the map's size
WARM = (0.008, 0.004)  # widths τ in a sweep
FINE = (0.005, 0.003, 0.002)  # widths τ of the last polish
LOOSE = 1.1  # factor by which the first polish may lengthen a start
SPARE = (0, 1, 3)  # numbers of steps tried, beyond the fewest
HOPELESS = 0.7  # smoothed failure above which candidates are dropped
WORTH = 0.95  # the rising sweep ends after two consecutive levels above this share of the failure before
SHORT = 0.87  # length cap of the second polish of a start, as a share of its length
FLIPPED = 2  # candidates that are tried on the other side of obstacles
FLIP_EVERY = 3  # levels of the falling sweep between trials of other sides
SECOND_LOOKS = 8  # classes that are polished again to find the length to begin at
PAYS = 0.95  # a longer path is worth it if its failure is below this share of a shorter one's
RISING = 2  # classes of a level that the rising sweep continues
ROUND = 4  # points of a front that are varied between two reports
MORE = (0, 1, 2, 3, 5, 8)  # numbers of steps beyond the fewest, tried in the rest of a budget
BUMP = 0.03  # standard deviation of a random bend, as a share of the map's size

SLOWER = (1.2, 1.45, 1.75)  # factors on the number of steps, where lower airspeeds may save energy
ECONOMIC = 8  # points of a front, at most, that are tried at lower airspeeds

SWEEP_SHARE = 0.75  # share of a budget after which only the last polish is left

Progress = Callable[..., None]


@dataclass(frozen=True, slots=True)
class Sweep:
    """What all polishes of a front share.

    The common ``flights``, the first ``few`` of them for the sweeps, and the time ``budget``.
    """

    cfg: RefineConfig
    problem: Problem
    refiner: Refiner
    flights: CommonFlights
    few: CommonFlights
    budget: Budget = UNLIMITED

    @property
    def over(self) -> bool:
        """Whether the share ``SWEEP_SHARE`` of the budget is spent: only the last polish is left to do."""
        return self.budget.over(SWEEP_SHARE)

    def polish_of(self, widths: Iterable[float], outer: int, inner: int) -> Polish:
        """A polish whose ``widths`` are shares of the map's size."""
        size = float(np.ptp(self.problem.scene.bounds, axis=0).mean())
        return Polish(tuple(size * w for w in widths), outer, inner)


def sampled_paths(
    cfg: RefineConfig, problem: Problem, forest: Forest, flights: CommonFlights,
    progress: Progress | None = None, budget: Budget = UNLIMITED,
) -> tuple[PlannedPath, ...]:  # fmt: skip
    """Paths of many lengths on which few of the common ``flights`` fail, shortest first.

    Raises
    ------
    InfeasibleError
        If there were starts and none became a path; the message says what is wrong with the best one.
    """
    return planned_paths(
        problem, refine_front(cfg, problem, first_starts(problem, forest), flights, progress, budget)
    )


def planned_paths(problem: Problem, found: Iterable[Candidate]) -> tuple[PlannedPath, ...]:
    """The candidates that can be flown and whose expected path completes the mission, as paths.

    Raises
    ------
    InfeasibleError
        If there are candidates and none of them is such a path.
    """
    paths, faults = list[PlannedPath](), list[tuple[Candidate, str]]()
    for k in found:
        try:
            path = evaluate_path(problem, k.flight.x, f"{k.origin}, refined")
        except InfeasibleError as error:  # rounding at a limit, or no start can be flown
            faults.append((k, str(error)))
            continue
        if completes_mission(problem, path):
            paths.append(path)
        else:
            faults.append((k, "the expected path does not complete the mission"))
    if faults and not paths:
        k, fault = min(faults, key=lambda row: row[0].smoothed)
        raise InfeasibleError(
            f"none of the refined paths can be flown; the best of them ({k.origin}, {k.length / 1e3:.1f} km, "
            f"{k.steps} steps): {fault}"
        )
    return tuple(paths)


def new_sweep(
    cfg: RefineConfig, problem: Problem, flights: CommonFlights, budget: Budget = UNLIMITED
) -> Sweep:
    """A sweep with all ``flights``, or the first ``sweep_flights`` of them."""
    refiner = Refiner(problem, margin_model(problem))
    few = flights.only(np.arange(min(cfg.sweep_flights, len(flights))))
    return Sweep(cfg, problem, refiner, flights, few, budget)


def refine_front(
    cfg: RefineConfig, problem: Problem, starts: Mapping[PathClass, Start], flights: CommonFlights,
    progress: Progress | None = None, budget: Budget = UNLIMITED,
) -> list[Candidate]:  # fmt: skip
    """Non-dominated candidates in length and smoothed failure, shortest first.

    With a power curve, slower ones that take less energy follow them.
    """
    sweep = new_sweep(cfg, problem, flights, budget)
    told = _Teller(progress)
    with ThreadPoolExecutor(cores()) as pool:
        seen = _first_looks(sweep, pool, starts)
        told(1, seen)
        levels = _swept_down(sweep, pool, seen)
        told(2, [*seen, *chain(*levels)])
        levels += _swept_up(sweep, pool, levels)
        front = front_of(chain(*levels)) or seen[:1]
        told(3, front)
        for better in improved_fronts(sweep, pool, front):
            front = better
            told(3, front)
        found = front_of(_finished_points(sweep, pool, front))
        told(4, found)
        found += _slower_points(sweep, pool, found)
    return found


class _Teller:
    """Reports the progress of a front: its least failure rate, the length of that path, its hypervolume.

    The hypervolume is that of smoothed failure and length, up to 1 and twice the longest path of the first
    front.
    """

    def __init__(self, progress: Progress | None) -> None:
        self.progress = progress
        self.longest = 0.0

    def __call__(self, done: int, found: Iterable[Candidate]) -> None:
        front = front_of(found)
        if self.progress is None or not front:
            return
        safest = front[-1]
        self.longest = self.longest or 2.0 * safest.length
        rows = np.array([[k.smoothed, k.length] for k in front])
        volume = hypervolume(rows, np.array([1.0, self.longest]))
        state = (
            f"fails {100 * safest.failed:.2g} % at {safest.length / 1e3:,.0f} km, hypervolume {volume:.4f}"
        )
        self.progress(done, 4, state)


def _finished_points(sweep: Sweep, pool: ThreadPoolExecutor, front: Sequence[Candidate]) -> list[Candidate]:
    """Points along the front polished on all flights; when time is up, the rest unchanged."""
    points = spread_points(front, sweep.cfg.points)

    def one(point: tuple[Candidate, float]) -> Candidate:
        return point[0] if sweep.budget.over() else _finished(sweep, *point)

    return list(pool.map(one, [*points[::2], *points[1::2]]))  # with little time, every other one


def _slower_points(sweep: Sweep, pool: ThreadPoolExecutor, found: Sequence[Candidate]) -> list[Candidate]:
    """Points along the front polished in more steps, those of them that then take less energy.

    The list is empty without a power curve.
    """
    problem, energy = sweep.problem, sweep.problem.energy
    if energy is None or not found:
        return []
    how, dt = sweep.polish_of(FINE, 1, 4), problem.motion.dt

    def slower(pair: tuple[Candidate, float]) -> Candidate | None:
        k, times = pair
        steps = min(int(np.ceil(times * k.steps)), problem.horizon)
        if steps <= k.steps or sweep.budget.over():
            return None
        x = resampled_means(problem, k.flight.x, steps)
        made = sweep.refiner.polish(x, sweep.flights, how, k.length, f"{k.origin}, slower")
        return made if energy.of(made.flight.u, dt) < energy.of(k.flight.u, dt) else None

    chosen = found[:: -(-len(found) // ECONOMIC)]
    made = pool.map(slower, [(k, times) for k in chosen for times in SLOWER])
    return [k for k in made if k is not None and k.smoothed < HOPELESS]


def _first_looks(
    sweep: Sweep, pool: ThreadPoolExecutor, starts: Mapping[PathClass, Start]
) -> list[Candidate]:
    """Every start polished cheaply at two lengths, and the best of them on the other side of obstacles.

    The first start is polished even if the time budget is spent.
    """
    first = next(iter(starts.values()), None)

    def looks(some: Iterable[Start]) -> list[Candidate]:
        pairs = pool.map(lambda s: _first_look(sweep, s) if s is first or not sweep.over else [], some)
        return [k for pair in pairs for k in pair]

    found = looks(starts.values())
    best = sorted(front_of(found), key=lambda k: k.smoothed)[:FLIPPED]
    return sorted([*found, *looks(_on_other_sides(sweep.problem, best, starts))], key=lambda k: k.smoothed)


def _first_look(sweep: Sweep, start: Start) -> list[Candidate]:
    """Candidates from one start: polished with few flights, at about its own length and clearly shorter."""
    how, flights, refiner = sweep.polish_of(COARSE, 1, 4), sweep.few, sweep.refiner
    x = _timed(sweep.problem, start.x, 1)
    long = refiner.polish(x, flights, how, LOOSE * path_length(x), start.origin)
    cap = long.length * SHORT
    short = refiner.polish(_timed(sweep.problem, long.flight.x, 1), flights, how, cap, start.origin)
    return [long, short]


def _on_other_sides(problem: Problem, found: Iterable[Candidate], known: Container[PathClass]) -> list[Start]:
    """``found`` bent past every near obstacle on its other side; one start of each class not known."""
    others = [f for k in found for f in flipped_starts(problem, k.flight.x, k.origin)]
    return [start for kind, start in unlike_starts(problem, others).items() if kind not in known]


def _timed(problem: Problem, x: FloatArray, spare: int) -> FloatArray:
    """The line of ``x`` in the fewest steps and ``spare`` more."""
    steps = int(np.ceil(steps_needed(problem, x).sum() * 1.01)) + spare
    return resampled_means(problem, x, min(max(steps, 2), problem.horizon))


# --- sweeps -----------------------------------------------------------------------------------


def _swept_down(sweep: Sweep, pool: ThreadPoolExecutor, seen: Sequence[Candidate]) -> list[list[Candidate]]:
    """The best classes at falling caps, from the longest length that pays."""
    seen = [k for k in (*seen, *_second_looks(sweep, pool, seen)) if k.smoothed < HOPELESS]
    if not seen:
        return []
    cap, levels = KEPT * _longest_worth(seen), list[list[Candidate]]()
    shortest = min(k.length for k in seen)
    beam: list[Candidate] = []
    while (beam or cap >= shortest) and not sweep.over:
        entering = [k for k in seen if cap / SPACING < k.length <= cap]
        made = _polished_at(sweep, pool, [*beam, *entering], cap, SPARE[:2])
        if len(levels) % FLIP_EVERY == 0:
            made += _other_sides(sweep, pool, made, cap)
        beam = best_of_classes(sweep.problem, made, sweep.cfg.classes)
        levels.append(beam)
        cap /= SPACING
    return levels


def _second_looks(sweep: Sweep, pool: ThreadPoolExecutor, seen: Sequence[Candidate]) -> Iterable[Candidate]:
    """The best classes polished again at their own lengths, to find the length cap to begin with."""
    how = sweep.polish_of(WARM, 1, 3)

    def again(k: Candidate) -> Candidate:
        return k if sweep.over else sweep.refiner.polish(k.flight.x, sweep.few, how, k.length, k.origin)

    return pool.map(again, best_of_classes(sweep.problem, seen, SECOND_LOOKS))


def _longest_worth(seen: Iterable[Candidate]) -> float:
    """The longest length [m] of the front that reduces the failure by a factor ``PAYS`` or better."""
    front = front_of(seen)
    longest = front[0]
    for k in front[1:]:
        if k.smoothed < PAYS * longest.smoothed:
            longest = k
    return longest.length


def _swept_up(
    sweep: Sweep, pool: ThreadPoolExecutor, below: Sequence[Sequence[Candidate]]
) -> list[list[Candidate]]:
    """The best classes at rising caps: the levels ``below``, then until longer paths do not fail less."""
    kept = [list(level) for level in reversed(below) if level]
    if not kept:
        return []
    levels, beam, vain, k = list[list[Candidate]](), kept[0], 0, 1
    cap = max(c.length for c in beam)
    while (k < len(kept) or vain < 2) and not sweep.over:
        known = kept[k] if k < len(kept) else []
        cap = max([c.length for c in known], default=cap * SPACING)
        made = _polished_at(sweep, pool, beam[:RISING], cap, SPARE[1:])
        least = beam[0].smoothed
        beam = best_of_classes(sweep.problem, [*made, *known, *beam], sweep.cfg.classes)
        vain = 0 if beam[0].smoothed < WORTH * least else vain + 1
        levels.append(beam)
        k += 1
    return levels


def _polished_at(
    sweep: Sweep, pool: ThreadPoolExecutor, begun: Sequence[Candidate], cap: float, spare: Sequence[int]
) -> list[Candidate]:
    """``begun`` polished at a length cap in several numbers of steps; those within the cap are returned."""
    lines = [(k.flight.x, more, k.origin) for k in begun for more in spare]
    return _held(sweep, pool, lines, sweep.polish_of(WARM, 1, 3), cap)


def _other_sides(
    sweep: Sweep, pool: ThreadPoolExecutor, made: Sequence[Candidate], cap: float
) -> list[Candidate]:
    """The best of ``made`` bent to the other side of every near obstacle, in classes not among ``made``."""
    best = sorted(made, key=lambda k: k.smoothed)[:1]
    new = _on_other_sides(sweep.problem, best, {path_class(sweep.problem, k.flight.x) for k in made})
    lines = [(start.x, 1, start.origin) for start in new]
    return _held(sweep, pool, lines, sweep.polish_of((*COARSE[:1], *WARM), 1, 3), cap)


def _held(
    sweep: Sweep, pool: ThreadPoolExecutor, lines: Sequence[tuple[FloatArray, int, str]], how: Polish,
    cap: float,
) -> list[Candidate]:  # fmt: skip
    """Lines (means, steps beyond the fewest, origin) polished at a length cap; returns those within it."""

    def one(line: tuple[FloatArray, int, str]) -> Candidate | None:
        if sweep.over:
            return None
        x, more, origin = line
        return sweep.refiner.polish(_timed(sweep.problem, x, more), sweep.few, how, cap, origin)

    made = pool.map(one, lines)
    return [k for k in made if k is not None and k.length <= KEPT * cap and k.smoothed < HOPELESS]


def best_of_classes(problem: Problem, found: Iterable[Candidate], most: int) -> list[Candidate]:
    """The best candidate of each class, least failure first, ``most`` at most."""
    best: dict[PathClass, Candidate] = {}
    for k in sorted(found, key=lambda k: k.smoothed):
        best.setdefault(path_class(problem, k.flight.x), k)
    return list(best.values())[:most]


# --- what is left of a budget -----------------------------------------------------------------


def improved_fronts(
    sweep: Sweep, pool: ThreadPoolExecutor, front: Sequence[Candidate]
) -> Iterator[list[Candidate]]:
    """Improved fronts, one after another, until most of the budget is spent; none without a time budget.

    An iteration takes random points of the front. Each is polished again at its length, from its neighbours,
    from a line on the other side of an obstacle, in other numbers of steps, and from itself, bent at random.
    """
    rounds = count() if sweep.budget.seconds is not None and front else iter(())
    kept = list(front)
    for number in rounds:
        if sweep.over:
            return
        rng = np.random.default_rng(number)
        for at in rng.permutation(len(kept))[:ROUND].tolist():
            kept = front_of([*kept, *_varied(sweep, pool, kept, min(at, len(kept) - 1), rng)])
        yield kept


def _varied(
    sweep: Sweep, pool: ThreadPoolExecutor, front: Sequence[Candidate], at: int, rng: np.random.Generator
) -> list[Candidate]:
    """One point of a front varied, and polished at its own length."""
    k, problem = front[at], sweep.problem
    near = [front[i] for i in (at - 1, at + 1) if 0 <= i < len(front)]
    lines = [(n.flight.x, 0, n.origin) for n in near]
    lines += [(k.flight.x, more, k.origin) for more in rng.choice(MORE, 2, replace=False).tolist()]
    lines += [(start.x, 1, start.origin) for start in flipped_starts(problem, k.flight.x, k.origin)[:FLIPPED]]
    lines += [(_bent(sweep, k.flight.x, rng), 1, k.origin)]
    return _held(sweep, pool, lines, sweep.polish_of((*COARSE[:1], *WARM), 1, 3), k.length)


def _bent(sweep: Sweep, x: FloatArray, rng: np.random.Generator) -> FloatArray:
    """``x`` with a bump of random place and size; its start does not move, and it stays on the map."""
    low, high = sweep.problem.scene.bounds
    t = np.linspace(0.0, 1.0, len(x))
    bump = np.exp(-0.5 * ((t - rng.random()) / rng.uniform(0.03, 0.15)) ** 2) * np.minimum(t / 0.05, 1.0)
    aside = rng.normal(0.0, BUMP * (high - low).mean(), 2)
    return np.clip(x + bump[:, None] * aside, low, high)


# --- the last polish ---------------------------------------------------------------------------


def _finished(sweep: Sweep, k: Candidate, cap: float) -> Candidate:
    """``k`` polished on all flights at a length cap."""
    how = sweep.polish_of(FINE, 1, 4)
    return sweep.refiner.polish(_fitting(sweep.problem, k, cap), sweep.flights, how, cap, k.origin)


def _fitting(problem: Problem, k: Candidate, cap: float) -> FloatArray:
    """The means of ``k``, in fewer steps if ``k`` is longer than the cap."""
    steps = k.steps if k.length <= KEPT * cap else max(2, round(k.steps * cap / k.length))
    return k.flight.x if steps == k.steps else resampled_means(problem, k.flight.x, steps)
