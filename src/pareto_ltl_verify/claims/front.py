"""Claims about the front: its paths, their costs and failure rates, and the rule that picked the plan."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping
from itertools import pairwise

import numpy as np

from pareto_ltl_verify import laws
from pareto_ltl_verify.arrays import BoolArray, FloatArray
from pareto_ltl_verify.claims import Claim, Verdict, close, far_apart, likely, no_fault, number, true_of
from pareto_ltl_verify.claims.plan import LEAST_RISK, RISK, SPREAD
from pareto_ltl_verify.claims.search import tree_names, vertex_path, vertex_risk
from pareto_ltl_verify.evidence import Evidence
from pareto_ltl_verify.flights import RARE, rate_of, same_counts, same_rate

FLOWN = 1e-6  # largest difference of a control of a path and the control that its positions need, of u_max
MAX_PATHS = 6  # paths of the front whose bounds are computed again
FLOWN_PATHS = 3  # paths of the front that are simulated again
SHARED_PATHS = 10  # paths of the front that are simulated again in the same winds
NEW_RUNS = 2000  # new flights of each of these paths
LOOKS = 250  # flights after which paths are compared for the first time; then twice as many, and so on
ENOUGH, LEAST_FLIGHTS = 200, 1000  # failures of each path, and flights, after which the comparisons may end
STILL = 1e-9  # [m] shorter steps have no course
BOUNDS = ("mission_risk", "collision_risk")
INTERVAL = ("failure", "failure_low", "failure_high")


def _turned_angle(_result: Evidence, x: FloatArray, _cov: FloatArray) -> float:
    """Sum of the changes of course [deg]."""
    steps = np.diff(x, axis=0)
    steps = steps[np.linalg.norm(steps, axis=1) > STILL]
    cross = steps[:-1, 0] * steps[1:, 1] - steps[:-1, 1] * steps[1:, 0]
    along = (steps[:-1] * steps[1:]).sum(axis=1)
    return math.degrees(math.fsum(abs(math.atan2(c, a)) for c, a in zip(cross, along, strict=True)))


def _held_air(result: Evidence, x: FloatArray, cov: FloatArray) -> float:
    """Ellipses of three standard deviations swept along the steps, times their time [km² h].

    A swept ellipse is a rectangle between two halves of the ellipse, as wide as the ellipse across the step.
    """
    total = 0.0
    for here, there, one, other in zip(x[:-1], x[1:], cov[:-1], cov[1:], strict=True):
        variances, axes = np.linalg.eigh(0.5 * (one + other))
        half = 3.0 * np.sqrt(np.maximum(variances, 0.0))
        course = there - here
        length = math.hypot(*course)
        normal = np.array([-course[1], course[0]]) / (length or 1.0)
        total += math.pi * half[0] * half[1] + 2.0 * length * math.hypot(*(half * (axes.T @ normal)))
    return total * 1e-6 * result.robot.dt / 3600.0


FURTHER_COSTS: dict[str, tuple[str, Callable[[Evidence, FloatArray, FloatArray], float]]] = {
    "duration": ("arrival_s", lambda result, x, _: (len(x) - 1) * result.robot.dt),
    "turns": ("turns_deg", _turned_angle),
    "containment": ("air_km2_h", _held_air),
}  # column, and function from the result, positions (T+1, 2) [m] and covariances (T+1, 2, 2) [m²] to the cost
COLUMNS = {"length": "length_m", "energy": "energy_j"} | {k: v[0] for k, v in FURTHER_COSTS.items()}


# --- its rows ---------------------------------------------------------------------------------


def flights_judge(result: Evidence) -> bool:
    """Whether simulated flights judge the paths of the front, not bounds."""
    return str(result.settings["fidelity"]["judge"]) == "flights"


def columns(result: Evidence, *names: str) -> FloatArray:
    """Numbers of front.csv, (P, n) for n columns."""
    rows = [[float(row[name]) for name in names] for row in result.front]
    return np.array(rows).reshape(len(rows), len(names))


def cost_columns(result: Evidence) -> list[str]:
    """The columns of costs: length, and all after the last column that every front has.

    These are energy, with a power curve, and the costs that ``selection.costs`` adds.
    """
    names = list(result.front[0])
    return ["length_m", *names[names.index("origin") + 1 :]]


def judged_rows(result: Evidence) -> FloatArray:
    """Objectives of dominance: (failure rate, costs) where flights judge, otherwise all of them."""
    judged = ("failure",) if flights_judge(result) else BOUNDS
    return columns(result, *judged, *cost_columns(result))


def front_rows(result: Evidence) -> Verdict:
    """No path of the front is dominated; they are numbered and sorted by failure rate or mission risk."""
    rows = judged_rows(result)
    no_worse, better = rows[:, None] <= rows, rows[:, None] < rows
    dominated = (no_worse.all(axis=2) & better.any(axis=2)).any(axis=0)
    listed = list(map(tuple, rows))
    faults = {
        "numbers": [int(row["path"]) for row in result.front] != list(range(len(rows))),
        "order": sorted(listed) != listed,
        "two rows are equal": len(set(listed)) != len(rows),
    }
    gone = [f"path {k} is dominated" for k in np.flatnonzero(dominated)]
    return no_fault(f"{len(rows)} paths", gone, faults)


def front_numbers(result: Evidence) -> Verdict:
    """Size, shortest length and least risk of the front, raw and refined, agree with the metrics."""
    metrics, (safest, shortest) = result.metrics, columns(result, "mission_risk", "length_m").min(axis=0)
    wanted = {"front_size": len(result.front), "shortest_m": shortest, "safest": safest}
    if flights_judge(result):
        runs = int(result.front[0]["runs"])
        wanted |= {"least_failure": columns(result, "failure").min(), "front_runs": runs}
    before, rates = (result.front_arrays.get(name, ()) for name in ("raw", "raw_rates"))
    if len(before):  # length and risks
        shortest, safest = np.min(before, axis=0)[:2]
        wanted |= {"front_size_raw": len(before), "shortest_raw_m": shortest, "safest_raw": safest}
    if len(rates):
        wanted["least_failure_raw"] = np.min(rates, axis=0)[0]
    wanted = {name: value for name, value in wanted.items() if name in metrics}
    return no_fault(f"{int(metrics['front_size'])} paths", far_apart(metrics, wanted, 1e-12))


def volume(rows: FloatArray) -> float:
    """Share of the box from 0 to 1 that ``rows`` (P, f) dominate, by slices of the first axis."""
    if rows.shape[1] == 2:
        x, y = rows[np.argsort(rows[:, 0])].T
        return float(np.diff(x, append=1.0) @ (1.0 - np.minimum.accumulate(y)))
    levels: list[float] = np.append(np.unique(rows[:, 0]), 1.0).tolist()
    return sum((high - low) * volume(rows[rows[:, 0] <= low, 1:]) for low, high in pairwise(levels))


def hypervolume(result: Evidence) -> Verdict:
    """Hypervolume of the front in the box that the metrics name."""
    rows, sides = judged_rows(result), cost_columns(result)
    top = np.ones(rows.shape[1])
    top[-len(sides) :] = [result.metrics[f"hypervolume_{name}"] for name in sides]
    for side, wide, limit in zip(sides, top[-len(sides) :], rows[:, -len(sides) :].max(axis=0), strict=True):
        if wide < 2 * limit * (1 - 1e-9):
            return Verdict("a box twice as large as the front", f"{side} {wide:.6g}", False)
    return number(result.metrics["hypervolume"], volume(np.minimum(rows / top, 1.0)), rel=1e-9)


def front_risks(result: Evidence) -> Verdict:
    """The mission risk is the bound that the settings name, and the duration is steps times dt."""
    fidelity, dt = result.settings["fidelity"], result.robot.dt
    column = {"theorem2": "mission_risk_paper", "ordered": "mission_risk_ordered"}[fidelity["mission_bound"]]
    plain = column == "mission_risk_ordered" or result.planned_law == "independent"
    faults = [f"path {row['path']}" for row in result.front if plain and row["mission_risk"] != row[column]]
    late = (row for row in result.front if not close(float(row["duration_s"]), int(row["steps"]) * dt))
    risks = columns(result, *BOUNDS, "mission_risk_ordered")
    wrong = np.flatnonzero((risks < 0.0).any(axis=1) | (risks[:, -1] > 1.0 + 1e-9))
    faults += [f"path {k}: a risk beyond 0 and 1" for k in wrong]
    return no_fault(f"mission_risk is {column}", faults, (f"path {row['path']}: duration" for row in late))


# --- its paths --------------------------------------------------------------------------------


def front_paths(result: Evidence) -> Verdict:
    """Every row agrees with its path in front.npz: start, controls, costs, steps and mission order.

    A path whose origin is a vertex of a tree is the path to that vertex.
    """
    rows, stored = result.front, sum(key.endswith("/x") for key in result.front_arrays)
    faults = (f"path {k}: {fault}" for k, row in enumerate(rows) for fault in _path_faults(result, row, k))
    return no_fault(f"{len(rows)} paths", faults, {"other paths": stored != len(rows)})


def _path_faults(result: Evidence, row: Mapping[str, str], k: int) -> Iterator[str]:
    x, robot = result.front_x(k), result.robot
    costs = {"length_m": float(np.linalg.norm(np.diff(x, axis=0), axis=1).sum())}
    if robot.power is not None:
        costs["energy_j"] = math.fsum(robot.spent(result.front_u(k)))
    requested = result.settings["selection"].get("costs", ())
    cov = np.asarray(result.front_arrays[f"path_{k:03d}/cov"], float)
    costs |= {column: of(result, x, cov) for name, (column, of) in FURTHER_COSTS.items() if name in requested}
    yield from far_apart(row, costs, 1e-9)
    orders = result.orders(x)
    faults = {
        f"{row['steps']} steps are {len(x) - 1}": len(x) - 1 != int(row["steps"]),
        "it does not begin at the start": np.abs(x[0] - result.start).max() > result.grain,
        "an energy without a power curve": robot.power is None and "energy_j" in row,
        f"order {row['order']} is {orders[0]}": row["order"] not in orders,
    }
    yield from true_of(faults)
    if np.abs(result.course_of(x).u - result.front_u(k)).max(initial=0.0) > FLOWN * robot.u_max:
        yield "its controls do not fly it"
    tree = re.fullmatch(r"tree (\d+) vertex (\d+)", row["origin"])
    grown = vertex_path(result, int(tree[1]), int(tree[2])) if tree and result.has("trees.npz") else x
    if not np.array_equal(grown, x):
        yield f"it is not the path of {row['origin']}"


def front_costs(result: Evidence) -> Verdict:
    """V and R of paths of the front, from their positions; the safest and the shortest one are among them."""
    best = columns(result, "mission_risk", "length_m").argmin(axis=0).tolist()
    chosen = sorted({*_spread(len(result.front), MAX_PATHS), *best})
    faults = (f"path {k}: {fault}" for k in chosen for fault in _bound_faults(result, result.front[k], k))
    return no_fault(f"{len(chosen)} of {len(result.front)} paths", faults)


def _spread(size: int, limit: int) -> list[int]:
    """At most ``limit`` numbers from 0 to ``size`` - 1, both ends among them."""
    return [int(k) for k in np.unique(np.linspace(0, size - 1, min(size, limit)).round())]


def _bound_faults(result: Evidence, row: Mapping[str, str], k: int) -> Iterator[str]:
    x = result.front_x(k)
    law = result.law(result.planned_law, len(x) - 1)
    course = laws.fly_means(law, x)
    stored = np.asarray(result.front_arrays[f"path_{k:03d}/cov"], float)
    size = np.maximum(np.trace(course.cov, axis1=1, axis2=2), 1e-6)
    if (
        stored.shape != course.cov.shape
        or (np.abs(stored - course.cov).max(axis=(1, 2)) > SPREAD * size).any()
    ):
        yield "its covariances are others"
    computed = {
        "mission_risk_ordered": result.mission_bound(course),
        "collision_risk": float(np.clip(float(row["collision_risk"]), *result.collision_bounds(law, course))),
    }
    yield from far_apart(row, computed, RISK, LEAST_RISK)


def tree_front(result: Evidence) -> Verdict | None:
    """With the models of the paper, no accepted vertex beats all paths in mission risk and length."""
    accepted = result.trees["accepted"].tolist()
    if not accepted or flights_judge(result) or not result.planned_as_published:
        return None
    lengths = [result.trees[f"{name}/length"] for name in tree_names(result)]
    rows = np.array([[vertex_risk(result, j, v), lengths[j][v]] for j, v in accepted])
    slack = np.array([1 + RISK, 1 + 1e-9])
    better = (rows[:, None] * slack < columns(result, BOUNDS[0], "length_m")).all(axis=2).all(axis=1)
    faults = [f"tree {accepted[k]} beats all" for k in np.flatnonzero(better)]
    return no_fault(f"{len(rows)} accepted vertices", faults)


# --- its failure rates ------------------------------------------------------------------------


def front_rates(result: Evidence) -> Verdict:
    """Rates and intervals follow from the flights in front.npz; wind law and number agree with settings."""
    if not flights_judge(result):
        rated = [row["path"] for row in result.front if any(row[key] for key in (*INTERVAL, "law", "runs"))]
        return no_fault("no rates", [f"path {name} has a rate" for name in rated])
    failed, law = result.front_arrays["failed"], result.planned_law
    runs = failed.shape[1]
    faults = [*ended_too_early(result)]
    faults += [] if len(failed) == len(result.front) else [f"flights of shape {failed.shape}"]
    for row, flights in zip(result.front, failed, strict=False):
        count = int(flights.sum())
        wanted = dict(zip(INTERVAL, rate_of(count, runs).values(), strict=True))
        if far_apart(row, wanted, 1e-9) or (row["law"], row["runs"]) != (law, str(runs)):
            faults.append(f"path {row['path']}: {count} of {runs} flights fail")
    return no_fault(f"{runs} flights each, {law} winds", faults)


def ended_too_early(result: Evidence) -> Iterator[str]:
    """Faults of the number of flights of each path: fewer than the settings ask for, without the failures.

    The flights end after ``LEAST_FLIGHTS`` or more, at a comparison, once each path has failed ``ENOUGH``
    times.
    """
    failed, runs = result.front_arrays["failed"], int(result.settings["selection"]["draws"])
    ended, fewest = failed.shape[1], int(failed.sum(axis=1).min(initial=ENOUGH))
    looks = [LOOKS * 2**k for k in range(max(runs // LOOKS, 1).bit_length())]
    if ended != runs and (ended > runs or ended < LEAST_FLIGHTS or ended not in looks):
        yield f"{ended} flights of {runs}"
    elif ended < runs and fewest < ENOUGH:
        yield f"{ended} flights of {runs}, of which {fewest} of one path fail"


def _failed_again(result: Evidence, k: int, *seed: int) -> BoolArray:
    """Which of ``NEW_RUNS`` new flights of path k fail."""
    x = result.fly(result.planned_law, result.front_x(k), result.front_u(k), NEW_RUNS, *seed)
    return result.ground.failed(x)


def new_front_rates(result: Evidence) -> Verdict | None:
    """Failure rates of paths of the front agree with new flights with other random numbers."""
    if not flights_judge(result):
        return None
    chosen, faults = _spread(len(result.front), FLOWN_PATHS), []
    for k in chosen:
        again, runs = int(_failed_again(result, k, 20181009, 100 + k).sum()), int(result.front[k]["runs"])
        chance = same_rate(round(float(result.front[k]["failure"]) * runs), runs, again, NEW_RUNS)
        faults += [f"path {k}: {again} of {NEW_RUNS}, chance {chance:.1g}"] * (chance < RARE / len(chosen))
    return no_fault(f"{len(chosen)} of {len(result.front)} paths", faults)


def shared_failures(result: Evidence) -> Verdict | None:
    """Paths of the front fail in the same winds: the number of them that fail in a flight, as in new flights.

    The flights of each path alone are judged by the claims above. χ² test of homogeneity.
    """
    if not flights_judge(result):
        return None
    failed = result.front_arrays["failed"]
    uncertain = np.argsort(-failed.var(axis=1), kind="stable")  # certain ones say little
    chosen = uncertain[:SHARED_PATHS].tolist()
    flown = np.sum([_failed_again(result, k, 20181012) for k in chosen], axis=0)
    chance = same_counts(failed[chosen].sum(axis=0), flown)
    return likely(f"{len(chosen)} of {len(result.front)} paths", chance, RARE)


FILES = ("front.csv", "front.npz")
WORLD = (*FILES, "cells.json", "automaton.json", "scene.json", "wind.nc")
CLAIMS: tuple[Claim, ...] = (
    Claim("front: no path is dominated", ("front.csv",), front_rows),
    Claim("front: numbers", FILES, front_numbers),
    Claim("front: hypervolume", ("front.csv",), hypervolume),
    Claim("front: mission risk of the settings", ("front.csv",), front_risks),
    Claim("front: paths", WORLD, front_paths),
    Claim("front: V and R of its paths", WORLD, front_costs),
    Claim("front: failure rates and intervals", FILES, front_rates),
    Claim("front: failure rates of new flights", WORLD, new_front_rates),
    Claim("front: flights that fail together", WORLD, shared_failures),
    Claim("front: no vertex beats it", ("front.csv", "trees.npz"), tree_front),
)
