"""Claims about the paths that were judged for the front, of which front.npz has a row each."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from careful_io.names import joined_names
from pareto_ltl_verify.arrays import BoolArray, FloatArray
from pareto_ltl_verify.claims import Claim, Verdict, no_fault
from pareto_ltl_verify.claims.front import (
    FILES,
    LOOKS,
    WORLD,
    cost_columns,
    ended_too_early,
    flights_judge,
    judged_rows,
)
from pareto_ltl_verify.claims.plan import POSITION
from pareto_ltl_verify.evidence import Evidence
from pareto_ltl_verify.flights import RARE, same_rate

JUDGED = "judged"  # array of front.npz
CLOSE = 1e-12  # largest relative difference of two costs that are the same


def stored_rows(result: Evidence) -> FloatArray | None:
    """The rows of all judged paths (J, f); None in files of earlier versions, which have none."""
    rows = result.front_arrays.get(JUDGED)
    return None if rows is None or not np.size(rows) else np.asarray(rows, float)


def whole_front(result: Evidence) -> Verdict | None:
    """Every path of the front was judged, and no judged path is better than all paths of the front.

    If no path satisfies planner.epsilon, the front is the path that fails least often.
    """
    rows, front = stored_rows(result), judged_rows(result)
    if rows is None:
        return None
    named = f"{len(rows)} judged paths"
    if rows.shape[1] != front.shape[1] + int(flights_judge(result)):
        return no_fault(named, [f"{rows.shape[1]} numbers each"])
    if not flights_judge(result):
        missing = [f"path {k} was not judged" for k in np.flatnonzero(~_among(front, rows))]
        return no_fault(named, missing, (f"row {k} is better" for k in _better(rows, front)))
    runs = result.front_arrays["failed"].shape[1]
    full = rows[:, 0] == runs
    ended = np.column_stack([rows[full, 1] / runs, rows[full, 2:]])
    faults = [f"path {k} was not judged" for k in np.flatnonzero(~_among(front, ended))]
    faults += ended_too_early(result)
    faults += [f"row {k} has {rows[k, 0]:g} flights" for k in np.flatnonzero(~_looked(rows[:, 0], runs))]
    faults += [f"row {k} has {rows[k, 1]:g} failures" for k in np.flatnonzero(rows[:, 1] > rows[:, 0])]
    if result.has("plan.json") and result.plan.get("epsilon_kept") is False:
        return no_fault(named, faults, {"not the safest path": tuple(front[0]) != min(map(tuple, ended))})
    places = np.flatnonzero(full)
    faults += [f"row {places[k]} is better" for k in _better(ended, front)]
    return no_fault(named, faults, _left_too_early(result, rows[~full]))


def _among(some: FloatArray, rows: FloatArray) -> BoolArray:
    """Which rows (P,) of ``some`` are among ``rows``."""
    if not len(rows):
        return np.zeros(len(some), bool)
    same: BoolArray = np.abs(some[:, None] - rows) <= CLOSE * np.abs(rows)
    return np.asarray(np.any(np.all(same, axis=2), axis=1), bool)


def _better(rows: FloatArray, front: FloatArray) -> list[int]:
    """The numbers of rows that no row of the front dominates or equals."""
    slack = CLOSE * np.abs(rows)
    worse: BoolArray = front[None] <= (rows + slack)[:, None]
    return [int(k) for k in np.flatnonzero(~np.any(np.all(worse, axis=2), axis=1))]


def _looked(flights: FloatArray, runs: int) -> BoolArray:
    """Whether paths can have been left out after so many of ``runs`` flights."""
    ends = [float(runs)]
    while LOOKS * 2 ** (len(ends) - 1) < runs:
        ends.append(float(LOOKS * 2 ** (len(ends) - 1)))
    return np.isin(flights, ends)


def _left_too_early(result: Evidence, rows: FloatArray) -> Iterator[str]:
    """Paths that lost the race, although every path of the front that costs no more fails more often.

    All fly in the same winds, so that more failures are chance only once in 10⁷.
    """
    costs = judged_rows(result)[:, 1:]
    failed = np.asarray(result.front_arrays["failed"], bool)
    for flights, failures, *spent in rows.tolist():
        cheaper = (costs <= np.array(spent) * (1.0 + CLOSE)).all(axis=1)
        least = min(failed[cheaper, : int(flights)].sum(axis=1).tolist(), default=None)
        if least is None:
            yield f"no path is as short as {spent[0]:.6g} m"
        elif least > failures and same_rate(int(failures), int(flights), int(least), int(flights)) < RARE:
            yield f"{int(failures)} of {int(flights)} flights fail, of the front {int(least)}"


def box(result: Evidence) -> Verdict | None:
    """The box of the hypervolume is at least twice as large as every judged path."""
    rows, sides = stored_rows(result), cost_columns(result)
    if rows is None:
        return None
    wide = [float(result.metrics[f"hypervolume_{name}"]) for name in sides]
    faults = {
        f"{name} {side:.6g}": side < 2.0 * limit * (1.0 - 1e-9)
        for name, side, limit in zip(sides, wide, rows[:, -len(sides) :].max(axis=0), strict=True)
    }
    return no_fault("twice every judged path", faults)


def arrays(result: Evidence) -> Verdict:
    """Times, states and labels of every path in front.npz; its hypervolume, box and fidelity."""
    stored, dt, faults = result.front_arrays, result.robot.dt, list[str]()
    slack = POSITION * result.grain
    for k in range(len(result.front)):
        x, key = result.front_x(k), f"path_{k:03d}"
        t = np.asarray(stored[f"{key}/t"], float)
        late = t.shape != (len(x),) or bool(np.abs(t - dt * np.arange(len(x))).max() > 1e-6)
        faults += [f"path {k}: times"] * late
        q, text = np.asarray(stored[f"{key}/q"]), np.asarray(stored[f"{key}/label"]).tolist()
        slacks = (0.0, slack, -slack)
        right = any(np.array_equal(q, result.ground.states(x[None], one)[0]) for one in slacks)
        faults += [f"path {k}: states"] * (not right)
        shown = [[joined_names(sorted(one)) for one in result.ground.labels(x, way)] for way in slacks]
        wrong = len(text) != len(x) or any(a not in seen for a, *seen in zip(text, *shown, strict=True))
        faults += [f"path {k}: labels"] * wrong
    sides = [result.metrics[f"hypervolume_{name}"] for name in cost_columns(result)]
    box = np.asarray(stored["reference"], float)[-len(sides) :].tolist()
    numbers = {
        "hypervolume": float(np.asarray(stored["hypervolume"]).item()) != result.metrics["hypervolume"],
        "box": box != sides,
        "fidelity": str(np.asarray(stored["fidelity"]).item()) != result.run["fidelity"],
    }
    return no_fault(f"{len(result.front)} paths", faults, numbers)


CLAIMS: tuple[Claim, ...] = (
    Claim("front: no judged path is better", FILES, whole_front),
    Claim("front: box of the hypervolume", FILES, box),
    Claim("front: arrays of its paths", WORLD, arrays),
)
