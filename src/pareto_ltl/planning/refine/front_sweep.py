"""The front of failure and length: sweeps of the length cap in the best classes of paths.

Every start is polished cheaply, and the best classes once more, to see which lengths pay. From the longest of
these the cap falls until no path holds it, and rises until a longer path fails no less. A level of the sweep
begins with the best classes of the level before, in several numbers of steps from the fewest upwards. What
nothing else beats is polished once more on more flights.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from pareto_ltl.planning.evaluate import completes_mission, evaluate_path
from pareto_ltl.planning.margin_model import margin_model
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.records import Forest, PlannedPath
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
from pareto_ltl.planning.refine.step_programme import StepProgrammes
from pareto_ltl.settings import RefineConfig
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.cores import cores
from pareto_ltl.support.errors import InfeasibleError

COARSE = (0.020, 0.007)  # widths of a first look, as shares of the map's size
WARM = (0.008, 0.004)  # those of a step of a sweep
FINE = (0.005, 0.003, 0.002)  # those of the last polish
LOOSE = 1.1  # a start may become this much longer at first
SPARE = (0, 1, 3)  # steps beyond the fewest that are tried
SPACING = 1.03  # ratio of neighbouring length caps
PLATEAU = 1.5  # levels between two paths of a front: more are a plateau
KEPT = 1.002  # a path may exceed its cap by this factor
HOPELESS = 0.7  # smoothed failure beyond which shorter paths are not looked for
WORTH = 0.95  # of the failure before: more ends the rising sweep, where it happens twice
SHORT = 0.87  # of its length, where a start is looked at once more
FLIPPED = 2  # of the first candidates are tried on the other side of obstacles
FLIP_EVERY = 3  # levels of the falling sweep between looks at other sides
SECOND_LOOKS = 8  # classes that are looked at again to see where to begin
PAYS = 0.95  # of the failure of a shorter path is worth a longer one to begin with
RISING = 2  # classes of a level that the rising sweep goes on with

Progress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True)
class Sweep:
    """What all polishes of a front share: the common ``flights``, and the first of them for rough looks."""

    cfg: RefineConfig
    problem: Problem
    refiner: Refiner
    flights: CommonFlights
    few: CommonFlights

    def polish_of(self, widths: Iterable[float], outer: int, inner: int) -> Polish:
        """Widths in metres from shares of the map."""
        size = float(np.ptp(self.problem.scene.bounds, axis=0).mean())
        return Polish(tuple(size * w for w in widths), outer, inner)


def sampled_paths(
    cfg: RefineConfig, problem: Problem, forest: Forest, flights: CommonFlights,
    progress: Progress | None = None,
) -> tuple[PlannedPath, ...]:  # fmt: skip
    """Paths of many lengths that few of the common ``flights`` fail on, shortest first.

    Raises
    ------
    InfeasibleError
        Where there were starts and none became a path: what is wrong with the nearest.
    """
    return planned_paths(
        problem, refine_front(cfg, problem, first_starts(problem, forest), flights, progress)
    )


def planned_paths(problem: Problem, found: Iterable[Candidate]) -> tuple[PlannedPath, ...]:
    """The candidates that can be flown and whose expected path completes the mission, as paths.

    Raises
    ------
    InfeasibleError
        Where there are candidates and none of them is one.
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
            f"of the lines that were refined, the nearest ({k.origin}, {k.length / 1e3:.1f} km, "
            f"{k.steps} steps) cannot be flown: {fault}"
        )
    return tuple(paths)


def new_sweep(cfg: RefineConfig, problem: Problem, flights: CommonFlights) -> Sweep:
    """A sweep with all ``flights``, or the first ``sweep_flights`` of them."""
    refiner = Refiner(problem, margin_model(problem), StepProgrammes(problem))
    few = flights.only(np.arange(min(cfg.sweep_flights, len(flights))))
    return Sweep(cfg, problem, refiner, flights, few)


def refine_front(
    cfg: RefineConfig, problem: Problem, starts: Mapping[PathClass, Start], flights: CommonFlights,
    progress: Progress | None = None,
) -> list[Candidate]:  # fmt: skip
    """Candidates of many lengths, shortest first: none is longer than another that fails no more."""
    sweep = new_sweep(cfg, problem, flights)
    told = progress or (lambda done, total: None)
    with ThreadPoolExecutor(cores()) as pool:
        seen = _first_looks(sweep, pool, starts)
        told(1, 4)
        levels = _swept_down(sweep, pool, seen)
        told(2, 4)
        levels += _swept_up(sweep, pool, levels)
        told(3, 4)
        front = front_of(k for level in levels for k in level) or seen[:1]
        found = front_of(pool.map(lambda job: _finished(sweep, *job), spread_points(front, cfg.points)))
        told(4, 4)
    return found


def _first_looks(
    sweep: Sweep, pool: ThreadPoolExecutor, starts: Mapping[PathClass, Start]
) -> list[Candidate]:
    """Every start polished cheaply at two lengths, and the best of them on the other side of obstacles."""
    found = [k for pair in pool.map(lambda s: _first_look(sweep, s), starts.values()) for k in pair]
    best = sorted(front_of(found), key=lambda k: k.smoothed)[:FLIPPED]
    new = _on_other_sides(sweep.problem, best, starts)
    found += [k for pair in pool.map(lambda s: _first_look(sweep, s), new) for k in pair]
    return sorted(found, key=lambda k: k.smoothed)


def _first_look(sweep: Sweep, start: Start) -> list[Candidate]:
    """A start polished cheaply in few steps, about as long as it is, and clearly shorter."""
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
    while beam or cap >= shortest:
        entering = [k for k in seen if cap / SPACING < k.length <= cap]
        made = _polished_at(sweep, pool, [*beam, *entering], cap, SPARE[:2])
        if len(levels) % FLIP_EVERY == 0:
            made += _other_sides(sweep, pool, made, cap)
        beam = best_of_classes(sweep.problem, made, sweep.cfg.classes)
        levels.append(beam)
        cap /= SPACING
    return levels


def _second_looks(sweep: Sweep, pool: ThreadPoolExecutor, seen: Sequence[Candidate]) -> Iterable[Candidate]:
    """The best classes polished again at their own lengths, to see where to begin."""
    how = sweep.polish_of(WARM, 1, 3)

    def again(k: Candidate) -> Candidate:
        return sweep.refiner.polish(k.flight.x, sweep.few, how, k.length, k.origin)

    return pool.map(again, best_of_classes(sweep.problem, seen, SECOND_LOOKS))


def _longest_worth(seen: Iterable[Candidate]) -> float:
    """The longest length [m] at which more length still pays."""
    front = front_of(seen)
    longest = front[0]
    for k in front[1:]:
        if k.smoothed < PAYS * longest.smoothed:
            longest = k
    return longest.length


def _swept_up(
    sweep: Sweep, pool: ThreadPoolExecutor, below: Sequence[Sequence[Candidate]]
) -> list[list[Candidate]]:
    """The same at rising caps, from the levels ``below``, and on until longer paths fail no less."""
    kept = [list(level) for level in reversed(below) if level]
    if not kept:
        return []
    levels, beam, vain, k = list[list[Candidate]](), kept[0], 0, 1
    cap = max(c.length for c in beam)
    while k < len(kept) or vain < 2:
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
    """``begun`` polished at a length cap in several numbers of steps; those that keep within it."""
    lines = [(k.flight.x, more, k.origin) for k in begun for more in spare]
    return _held(sweep, pool, lines, sweep.polish_of(WARM, 1, 3), cap)


def _other_sides(
    sweep: Sweep, pool: ThreadPoolExecutor, made: Sequence[Candidate], cap: float
) -> list[Candidate]:
    """The best of ``made`` on the other side of every near obstacle, where no other is of that class."""
    best = sorted(made, key=lambda k: k.smoothed)[:1]
    new = _on_other_sides(sweep.problem, best, {path_class(sweep.problem, k.flight.x) for k in made})
    lines = [(start.x, 1, start.origin) for start in new]
    return _held(sweep, pool, lines, sweep.polish_of((*COARSE[:1], *WARM), 1, 3), cap)


def _held(
    sweep: Sweep, pool: ThreadPoolExecutor, lines: Sequence[tuple[FloatArray, int, str]], how: Polish,
    cap: float,
) -> list[Candidate]:  # fmt: skip
    """Lines (means, steps beyond the fewest, origin) polished at a length cap; those that keep within it."""

    def one(line: tuple[FloatArray, int, str]) -> Candidate:
        x, more, origin = line
        return sweep.refiner.polish(_timed(sweep.problem, x, more), sweep.few, how, cap, origin)

    made = pool.map(one, lines)
    return [k for k in made if k.length <= KEPT * cap and k.smoothed < HOPELESS]


def best_of_classes(problem: Problem, found: Iterable[Candidate], most: int) -> list[Candidate]:
    """The best candidate of each class, least failure first, ``most`` at most."""
    best: dict[PathClass, Candidate] = {}
    for k in sorted(found, key=lambda k: k.smoothed):
        best.setdefault(path_class(problem, k.flight.x), k)
    return list(best.values())[:most]


# --- fronts -----------------------------------------------------------------------------------


def front_of(found: Iterable[Candidate]) -> list[Candidate]:
    """Those that no other is shorter and fails less than, by length."""
    kept: list[Candidate] = []
    for k in sorted(found, key=lambda k: (k.length, k.smoothed)):
        if not kept or k.smoothed < kept[-1].smoothed:
            kept.append(k)
    return kept


def spread_points(front: Sequence[Candidate], most: int) -> list[tuple[Candidate, float]]:
    """``most`` length caps at even ratios along the front, each with the path to begin with.

    A gap between neighbours that is wider than a level of the sweep is a plateau, where longer paths do not
    pay: no cap lies in it. The path to begin with fails least of those that one step of the sweep is enough
    to shorten.
    """
    if not front:
        return []
    lengths = np.log([k.length for k in front])
    rise = np.diff(lengths)
    way = np.concatenate([[0.0], np.cumsum(np.where(rise <= PLATEAU * np.log(SPACING), rise, 0.0))])
    along = way[-1] / max(most - 1, 1) * np.arange(most)
    at = np.searchsorted(way, along * (1.0 - 1e-12), side="right") - 1
    caps = np.exp(lengths[at] + along - way[at])
    caps[-1], caps[0] = front[-1].length, front[0].length
    kept = [float(caps[0])]
    for cap in caps[1:].tolist():
        if cap > KEPT * kept[-1]:
            kept.append(cap)
    return [
        (min((k for k in front if k.length <= SPACING * cap), key=lambda k: k.smoothed), cap) for cap in kept
    ]


def _finished(sweep: Sweep, k: Candidate, cap: float) -> Candidate:
    """``k`` polished on all flights at a length cap."""
    how = sweep.polish_of(FINE, 1, 4)
    return sweep.refiner.polish(_fitting(sweep.problem, k, cap), sweep.flights, how, cap, k.origin)


def _fitting(problem: Problem, k: Candidate, cap: float) -> FloatArray:
    """The means of ``k``, in fewer steps where a shorter length needs fewer."""
    steps = k.steps if k.length <= KEPT * cap else max(2, round(k.steps * cap / k.length))
    return k.flight.x if steps == k.steps else resampled_means(problem, k.flight.x, steps)
