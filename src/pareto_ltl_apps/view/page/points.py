"""The points of the front: a row for each, and the complete paths of as many as the page can hold."""

from __future__ import annotations

from typing import Any

import numpy as np

from careful_io.files import plain_data
from pareto_ltl import Scene
from pareto_ltl.extend import (
    Deployment,
    Front,
    Objectives,
    PlannedPath,
    Problem,
    cost_named,
    law_seeds,
    simulate_flights,
)
from pareto_ltl.support.counts import clopper_pearson
from pareto_ltl_apps.exports.ellipses import axes_of, ellipse_scale
from pareto_ltl_apps.exports.navigation_log import SHARE, navigation_log
from pareto_ltl_apps.view.page.ground import DEGREES, map_places, metre_digits, north_turn, rounded
from pareto_ltl_apps.view.records import ShownRun

MAX_LEGS = 3000  # legs of all complete paths, at most: 200 bytes each
MAX_PLAIN_LEGS = 40_000  # legs of all paths, with or without a navigation log: 40 bytes each
MAX_FLIGHTS = 100  # flights drawn, at most
MAX_PLACES = 6000  # positions of all flights drawn, at most
JUDGED = ("failure", "failure_low", "failure_high", "runs", "law")  # columns of a rate, or of a bound
LOG_DIGITS = {
    "heading": 3, "airspeed": 4, "calibrated": 4, "wind_speed": 3, "wind_from": 2, "wind_sd": 3, "track": 3,
    "ground_speed": 3, "distance": 1, "lat": DEGREES + 1, "lon": DEGREES + 1, "radius": 1, "major": 1,
    "minor": 1, "azimuth": 2,
}  # fmt: skip


def shown_points(front: Front) -> list[dict[str, Any]]:
    """The row of ``front.csv`` for each path."""
    rates = front.rates or (None,) * len(front.paths)
    rows = []
    for path, rate in zip(front.paths, rates, strict=True):
        cost = path.objectives
        judged = (
            (bound_of(cost), None, None, None, front.models.law) if rate is None
            else (rate.failure, rate.low, rate.high, rate.runs, rate.law)
        )  # fmt: skip
        row = {
            "length_m": cost.length, "mission_risk": cost.mission_risk,
            "collision_risk": cost.collision_risk, "duration_s": float(path.t[-1] - path.t[0]),
            "steps": len(path.u), "order": path.order, "origin": path.origin,
            "costs": [cost_named(name).text(value) for name, value in cost.further_costs.items()],
            **dict(zip(JUDGED, judged, strict=True)),
        }  # fmt: skip
        rows.append(plain_data(row))
    return rows


def bound_of(cost: Objectives) -> float:
    """The bound on the failure that a path without flights is judged by, at most 1."""
    return min(1.0, cost.mission_risk + cost.collision_risk)


def told_points(front: Front, chosen: int | None, limit: int = MAX_LEGS) -> list[int]:
    """The points whose paths have room in ``limit`` legs: all, or the chosen one and others spread evenly."""
    longest = max(len(path.u) for path in front.paths)
    room = max(1, limit // max(longest, 1))
    if room >= len(front.paths):
        return list(range(len(front.paths)))
    spread = np.unique(np.linspace(0, len(front.paths) - 1, room).round().astype(int)).tolist()
    return sorted({*spread, *([] if chosen is None else [chosen])})


def shown_path(
    run: ShownRun, problem: Problem, path: PlannedPath, given: Deployment | None, *, logged: bool = True
) -> dict[str, Any]:
    """A path step by step, its navigation log if it is ``logged``, and when flights of it fail.

    ``given`` are its flights if there are any; otherwise ``run.runs`` flights are simulated in the same
    winds.
    """
    shown = {
        "t": rounded(path.t, 3),
        "line": map_places(problem.scene, path.x),
        "spread": plan_spread(problem.scene, path),
        "q": path.q.tolist(),
        "label": [sorted(names) for names in path.label],
        "fixes": list(path.fixes),
        "utc": problem.scene.frame.utc(path.t),
        "risk": _risk(problem, given or flown_path(run, problem, path)),
    }
    if logged and problem.scene.crs is not None:
        log = navigation_log(problem, path, run.air)  # NaN of a drifting robot's heading is null
        shown["log"] = {name: np.round(getattr(log, name), digits) for name, digits in LOG_DIGITS.items()}
    plain: dict[str, Any] = plain_data(shown)
    return plain


def plan_spread(scene: Scene, path: PlannedPath) -> list[Any]:
    """For each step the semi-axes [m] of the ellipse of 95 % of the positions, and its azimuth [deg]."""
    major, minor, direction = axes_of(path.cov)
    azimuth = direction + north_turn(scene, path.x)
    scale, digits = ellipse_scale(SHARE), metre_digits(scene)
    axes = np.column_stack([scale * major, scale * minor]).round(digits) + 0.0
    return [[*pair, turn] for pair, turn in zip(axes.tolist(), rounded(np.rad2deg(azimuth), 1), strict=True)]


def flown_path(run: ShownRun, problem: Problem, path: PlannedPath) -> Deployment:
    """``run.runs`` flights of ``path``, in the winds of the deployment of the plan."""
    law = problem.fidelity.law
    return simulate_flights(problem, path.u, run.runs, law, law_seeds(run.seeds)[law], path.x)


def _risk(problem: Problem, flown: Deployment) -> dict[str, Any]:
    """Number of flights failed by each step, for each cause, and the 95 % interval of their share."""
    counts = flown.failure_times(problem).counts()
    total, runs = counts.sum(axis=0), len(flown.x)
    ends = {int(k): clopper_pearson(int(k), runs) for k in np.unique(total)}
    return {
        "law": flown.law,
        "runs": runs,
        "failed": counts.tolist(),
        **{end: [round(ends[int(k)][n], 6) for k in total] for n, end in enumerate(("low", "high"))},
    }


def shown_flights(
    scene: Scene, problem: Problem, flown: Deployment, count: int | None = None
) -> dict[str, Any]:
    """The first flights of ``flown``, not selected: their share of failures estimates the rate.

    ``failed`` is the step at which a flight fails, or -1; ``why`` says why, or is None. There are ``count``
    flights, by default as many as a page has room for.
    """
    if count is None:
        count = int(np.clip(MAX_PLACES // flown.x.shape[1], 10, MAX_FLIGHTS))
    some = Deployment(
        flown.law, flown.x[:count], flown.accepted[:count], flown.collided[:count], flown.off_map[:count],
        flown.walled,
    )  # fmt: skip
    times = some.failure_times(problem)
    return {
        "law": flown.law,
        "runs": len(flown.x),
        "failures": int(flown.failed.sum()),
        "at": map_places(scene, some.x, coarser=1),
        "failed": times.step.tolist(),
        "why": [Deployment.CAUSES[cause] if cause >= 0 else None for cause in times.cause],
    }
