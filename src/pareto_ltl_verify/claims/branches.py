"""Claims about a plan that branches at a position fix: its cells, their law, and the rates with branches.

Cells, moments and flights are derived from the numbers of ``plan.json`` by sampling: measured positions from
the covariance at the fix, and new flights that are sorted into cells and fly on with the controls of each.
"""

from __future__ import annotations

import csv
import math
from functools import partial
from itertools import pairwise, product
from typing import Any, NamedTuple

import numpy as np

from careful_io.texts import distance_text
from pareto_ltl_verify import laws
from pareto_ltl_verify.arrays import BoolArray, FloatArray, IntArray
from pareto_ltl_verify.claims import Claim, Verdict, close, likely, no_fault, within
from pareto_ltl_verify.evidence import Evidence
from pareto_ltl_verify.flights import RARE, fly, same_rate
from pareto_ltl_verify.gaussians import ON_EDGE
from pareto_ltl_verify.geometry import azimuths, convex, deepest

FILES = ("plan.json", "scene.json", "cells.json", "automaton.json", "wind.nc")
DRAWS = 400_000  # positions drawn for the moments of cells
RUNS = 4000  # new flights of the plan and of each branch
SEED = 20181013
LARGEST = 0.03  # standard deviations by which means may differ, and share by which covariances may
SPREAD = 6.0  # standard errors that a share may be off
STILL, TURNED = 1e-3, 0.01  # airspeed [m/s] below which there is no heading; its largest error [deg]


class Node(NamedTuple):
    """A fix of ``plan.json`` with its branches.

    Step of the fix, axes (2, 2), cells (4,) each: along, left; the controls (T, 2) and the expected positions
    (T+1, 2) [m] of the flights that come to it, from the departure on; the fixes before with the number of
    the branch that was taken at each.
    """

    stated: dict[str, Any]
    step: int
    axes: FloatArray
    boxes: FloatArray
    u: FloatArray
    x: FloatArray
    before: tuple[tuple[Node, int], ...]

    @property
    def rows(self) -> list[dict[str, Any]]:
        """What is stated of each branch."""
        return list(self.stated["branches"])

    @property
    def title(self) -> str:
        """What the fix is called in findings: two fixes may be at the same step."""
        if not self.before:
            return "first fix"
        parent, number = self.before[-1]
        return f"fix of branch {parent.rows[number]['name']}"

    @property
    def fix(self) -> dict[str, Any]:
        """What is stated of the fix."""
        return dict(self.stated["fix"])

    def number(self, y: FloatArray) -> IntArray:
        """The branch of each position ``y`` (n, 2) [m]; -1 in no cell, -2 in several."""
        along, left = ((y - np.array(self.fix["place"])) @ self.axes.T).T
        held = np.stack([(a <= along) & (along < b) & (c <= left) & (left < d) for a, b, c, d in self.boxes])
        count = held.sum(axis=0)
        return np.where(count == 1, held.argmax(axis=0), np.where(count == 0, -1, -2))

    def taken(self, x: FloatArray, luck: FloatArray) -> BoolArray:
        """Which robots at ``x`` (n, 2) [m] take the fix, by their ``luck`` (n,), uniform in [0, 1)."""
        able = luck < self.fix["available"]
        if self.fix["landmark"] is None:
            return np.asarray(able, bool)
        return np.asarray(able & (deepest([convex(self.fix["landmark"])], x) >= -ON_EDGE), bool)

    @property
    def rejoin(self) -> int:
        """The number of steps in which the distance from the planned position is flown off; 0: it is not."""
        return int(self.fix.get("rejoin_steps", 0))

    @property
    def counter(self) -> float:
        """The rate [1/s] at which the robot goes on against the drift that the distance tells of."""
        return float(self.fix.get("counter_per_s", 0.0))

    def on(self, row: dict[str, Any]) -> FloatArray:
        """The controls (T, 2) of a branch, from the departure on."""
        return np.vstack([self.u[: self.step], np.array(row["u"], float)])

    def after(self, number: int) -> Node | None:
        """The second fix on branch ``number``; None if it has none."""
        row = self.rows[number]
        if "branches" not in row:
            return None
        x = np.vstack([self.x[: self.step], np.array(row["x"], float)])
        return _node(row["branches"], self.on(row), x, (*self.before, (self, number)))


def _node(
    stated: dict[str, Any], u: FloatArray, x: FloatArray, before: tuple[tuple[Node, int], ...] = ()
) -> Node:
    east, north = stated["fix"]["ahead"]
    boxes = [
        [-math.inf if low is None else low, math.inf if high is None else high]
        for row in stated["branches"]
        for low, high in (row["along"], row["left"])
    ]
    axes = np.array([[east, north], [-north, east]])
    return Node(stated, stated["fix"]["step"], axes, np.array(boxes, float).reshape(-1, 4), u, x, before)


def nodes_of(result: Evidence) -> list[Node]:
    """The fixes at which the plan branches, the first one first; none if the plan has no branches."""
    stated = result.plan.get("branches")
    if stated is None:
        return []
    nodes = [_node(stated, result.u, result.x)]
    for node in nodes:  # grows on the way
        nodes += filter(None, map(node.after, range(len(node.rows))))
    return nodes


def _letters(node: Node) -> list[str]:
    """The names of the branches of a fix."""
    if not node.before:
        return list("ABCD"[: len(node.rows)])
    parent, number = node.before[-1]
    return [f"{parent.rows[number]['name']}{k}" for k in range(1, len(node.rows) + 1)]


def where(result: Evidence) -> Verdict | None:
    """Fixes are at times of branch.at or in landmarks, at the planned position, along the track."""
    if not (nodes := nodes_of(result)):
        return None
    faults = dict[str, Any]()
    for node in nodes:
        faults |= _where_faults(result, node)
    return no_fault(f"{len(nodes)} fixes", faults)


def _where_faults(result: Evidence, node: Node) -> dict[str, Any]:
    cfg, fix, x, k = result.settings["branch"], node.fix, node.x, node.step
    name = node.title
    first = node.before[-1][0].step + 1 if node.before else 1
    if not first <= k < len(node.u):
        return {f"{name}: step {k} is not within the plan": True}
    ahead = x[k] - x[k - 1]
    marks = result.scene.get("landmarks") or []
    at_times = bool(cfg["at"])
    sd = cfg["fix_sd"] if at_times else result.robot.fix_sd
    steps = [round(3600.0 * hours / result.robot.dt) for hours in cfg["at"]]
    rejoin, least = node.rejoin, 1 if node.rejoin else 2
    return {
        f"{name}: {len(node.rows)} branches": not least <= len(node.rows) <= cfg["leaves"],
        f"{name}: {rejoin} steps to rejoin": not 0 <= rejoin <= (len(node.u) - k) * cfg.get("rejoin", False),
        f"{name}: counters {node.counter:g} /s": node.counter < 0.0 or bool(node.counter and not rejoin),
        f"{name}: a fix after {len(node.before)} others": len(node.before) >= cfg.get("fixes", 1),
        f"{name}: step {k} is at no time of branch.at": at_times and k not in steps,
        f"{name}: the outline is no landmark": not at_times and fix["landmark"] not in marks,
        f"{name}: a landmark although branch.at is set": at_times and fix["landmark"] is not None,
        f"{name}: place": not np.allclose(fix["place"], x[k], atol=1e-6 + result.grain),
        f"{name}: direction": not np.allclose(fix["ahead"], ahead / max(np.hypot(*ahead), 1e-9), atol=1e-6),
        f"{name}: sd {fix['sd']:g}": not close(fix["sd"], sd),
        f"{name}: probability": not close(fix["available"], cfg["available"]),
        f"{name}: names": [row["name"] for row in node.rows] != _letters(node),
    }


def division(result: Evidence) -> Verdict | None:
    """Every measured position lies in exactly one cell: one point of each box between all lines is tried."""
    if not (nodes := nodes_of(result)):
        return None
    count, faults = 0, dict[str, Any]()
    for node in nodes:
        middles = []
        for ends in (node.boxes[:, :2], node.boxes[:, 2:]):
            cuts = np.unique(ends[np.isfinite(ends)])
            rim = [-1e9, *cuts.tolist(), 1e9]
            middles.append([*(0.5 * (a + b) for a, b in pairwise(rim)), *cuts.tolist()])
        points = np.array(list(product(*middles)))
        number = node.number(np.array(node.fix["place"]) + points @ node.axes)
        count += len(points)
        faults |= {
            f"{node.title}: in no cell": (number == -1).any(),
            f"{node.title}: in two": (number == -2).any(),
        }
    return no_fault(f"{count} places", faults)


def words(result: Evidence) -> Verdict | None:
    """The words of each cell say what its numbers do."""
    if not (nodes := nodes_of(result)):
        return None
    faults = {}
    for node in nodes:
        for row, (a, b, c, d) in zip(node.rows, node.boxes.tolist(), strict=True):
            parts = [
                _side(c, d, "left of", "right of", "the planned track"),
                _side(a, b, "ahead of", "behind", "the planned position (along the track)"),
            ]
            text = ", and ".join(part for part in parts if part) or "anywhere"
            faults[f"branch {row['name']}: {row['where']}"] = row["where"] != text
    return no_fault(f"{len(faults)} cells", faults)


def _side(low: float, high: float, up: str, down: str, what: str) -> str:
    """What it means that a distance lies between ``low`` and ``high`` [m]."""
    told = distance_text
    match (math.isfinite(low), math.isfinite(high)):
        case (False, False):
            return ""
        case (True, False) if low < 0:
            return f"{up} {what}, or less than {told(-low)} {down} it"
        case (True, False):
            return f"{f'more than {told(low)} ' if low > 0 else ''}{up} {what}"
        case (False, True) if high > 0:
            return f"{down} {what}, or less than {told(high)} {up} it"
        case (False, True):
            return f"{f'more than {told(-high)} ' if high < 0 else ''}{down} {what}"
    if low < 0 < high:
        return f"less than {told(-low)} {down}, or {told(high)} {up}, {what}"
    near, far, side = (low, high, up) if low >= 0 else (-high, -low, down)
    if near == 0:
        return f"{side} {what} by less than {told(far)}"
    return f"between {told(near)} and {told(far)} {side} {what}"


# --- the law in each cell ---------------------------------------------------------------------------


class Told(NamedTuple):
    """What cells say, of ``draws`` flights that come to the last fix.

    Share of the last cell; mean (2n,) and covariance (2n, 2n) of y - x at the n fixes in the cells, with y as
    it would be if nothing were flown off.
    """

    share: float
    mean: FloatArray
    cov: FloatArray
    draws: int

    @property
    def doubt(self) -> float:
        """Standard error of a mean in standard deviations."""
        return 1.0 / math.sqrt(max(self.share * self.draws, 1.0))


class Course(NamedTuple):
    """Flights of one set of controls without fixes: means (T+1, 2), covariances at and between all steps."""

    x: FloatArray
    cov: FloatArray
    across: FloatArray
    F: FloatArray
    dt: float

    @classmethod
    def of(cls, result: Evidence, u: FloatArray) -> Course:
        """The flights of the controls ``u`` (T, 2)."""
        law = result.law("coherent", len(u))
        course = laws.fly_controls(law, result.start, u)
        return cls(course.x, course.cov, laws.covariance_across(law, course), course.F, result.robot.dt)

    def pushed(self, node: Node, until: int) -> FloatArray:
        """Where (T+1, 2, 2) a metre east or north that is flown off after the fix of ``node`` has led to.

        ``until`` is the step of a later fix, from which on its own distance is flown off instead.
        """
        off = np.zeros((len(self.x), 2, 2))
        for t in range(node.step, len(self.F)):
            off[t + 1] = self.F[t] @ off[t]
            if t < until:
                share = 1.0 / node.rejoin if t < node.step + node.rejoin else 0.0
                off[t + 1] += (share + node.counter * self.dt) * np.eye(2)
        return off

    def between(self, steps: list[int], others: list[int]) -> FloatArray:
        """Covariance (2n, 2m) of the deviations at ``steps`` with those at ``others``."""
        rows = [[self.across[t, s] if t >= s else self.across[s, t].T for s in others] for t in steps]
        return np.vstack([np.hstack(row) for row in rows])


def _chain(node: Node) -> list[Node]:
    """The fixes to ``node``, the first one first."""
    return [*(one for one, _ in node.before), node]


def told_by_cells(result: Evidence, node: Node) -> list[Told]:
    """The moments of measured positions in each cell, by sampling from the covariances at the fixes."""
    key = f"branch cells {[number for _, number in node.before]}"
    known = result.remembered.get(key)
    if not isinstance(known, list):
        known = result.remembered[key] = _sampled(node, Course.of(result, node.u))
    return known


def _sampled(node: Node, course: Course) -> list[Told]:
    rng, fixes = np.random.default_rng(SEED), _chain(node)
    steps = [one.step for one in fixes]
    S = course.between(steps, steps)
    e = rng.standard_normal((DRAWS, len(S))) @ np.linalg.cholesky(S + 1e-9 * np.trace(S) * np.eye(len(S))).T
    y, come = e.copy(), np.ones(DRAWS, bool)
    number, gone = np.zeros(DRAWS, int), np.zeros((DRAWS, 2))
    for n, one in enumerate(fixes):
        own, middle = slice(2 * n, 2 * n + 2), course.x[one.step]
        y[:, own] += one.fix["sd"] * rng.standard_normal((DRAWS, 2))
        come &= one.taken(middle + e[:, own] - gone, np.zeros(DRAWS))
        seen = middle + y[:, own] - gone
        number = one.number(seen)
        if one.rejoin and one is not node:
            gone = (seen - one.fix["place"]) @ course.pushed(one, steps[n + 1])[steps[n + 1]].T
        if one is not node:
            come &= number == node.before[n][1]
    y, number = y[come], number[come]
    found = []
    for k in range(len(node.rows)):
        held = y[number == k]
        enough = len(held) > 1
        mean = held.mean(axis=0) if enough else np.zeros(len(S))
        cov = np.cov(held.T) if enough else np.zeros(S.shape)
        found.append(Told(len(held) / max(len(y), 1), mean, cov, len(y)))
    return found


def shares(result: Evidence) -> Verdict | None:
    """The share of each cell follows from the covariances at the fixes."""
    if not (nodes := nodes_of(result)):
        return None
    faults = {}
    for node in nodes:
        for row, told in zip(node.rows, told_by_cells(result, node), strict=True):
            error = math.sqrt(max(told.share * (1.0 - told.share), 1e-6) / max(told.draws, 1))
            off = abs(row["share"] - told.share)
            faults[f"branch {row['name']}: {row['share']:.4g} is {told.share:.4g}"] = (
                off > 2e-3 + SPREAD * error
            )
    return no_fault(f"{len(faults)} shares", faults)


def positions(result: Evidence) -> Verdict | None:
    """Means and covariances of each branch come from flights in its cells that fly its controls."""
    if not (nodes := nodes_of(result)):
        return None
    worst, count = 0.0, 0
    for node in nodes:
        for row, told in zip(node.rows, told_by_cells(result, node), strict=True):
            off = _off(result, node, row, told)
            if off is None:
                return Verdict(f"branch {row['name']}", "another number of steps", False)
            worst, count = max(worst, off), count + 1
    return within(f"{count} branches", worst, LARGEST, " sd")


def _off(result: Evidence, node: Node, row: dict[str, Any], told: Told) -> float | None:
    """How far stated means and covariances are from derived ones, beyond the error of the sampling."""
    u, fixes, k = node.on(row), _chain(node), node.step
    course, steps = Course.of(result, u), [one.step for one in fixes]
    S = course.between(steps, steps) + np.diag(np.repeat([one.fix["sd"] ** 2 for one in fixes], 2))
    inverse = np.linalg.inv(S)
    W = inverse @ (S - told.cov) @ inverse
    x, cov = np.array(row["x"], float), np.array(row["cov"], float)
    if x.shape != (len(u) - k + 1, 2) or cov.shape != (len(u) - k + 1, 2, 2):
        return None
    worst = 0.0
    off, middle = _flown_off(course, fixes)
    for t in range(k, len(u) + 1):
        D = course.between([t], steps)
        mean, left = course.x[t] + D @ inverse @ told.mean, course.cov[t] - D @ W @ D.T
        if off is not None:
            mean = mean - off[t] @ (told.mean - middle)
            both = D @ inverse - off[t]
            left = course.cov[t] - D @ inverse @ D.T + both @ told.cov @ both.T
        sd = math.sqrt(max(float(np.trace(left)), result.grain**2))
        worst = max(worst, float(np.linalg.norm(x[t - k] - mean)) / sd)
        worst = max(worst, float(np.abs(cov[t - k] - left).max()) / sd**2)
    return max(worst - SPREAD * told.doubt, 0.0)


def _flown_off(course: Course, fixes: list[Node]) -> tuple[FloatArray | None, FloatArray]:
    """H (T+1, 2, 2n) or None, and c (2n,): H (a - c) is flown off, a the distances y - x without that."""
    middle = np.concatenate([np.array(one.fix["place"]) - course.x[one.step] for one in fixes])
    if not any(one.rejoin for one in fixes):
        return None, middle
    first = course.pushed(fixes[0], fixes[1].step if len(fixes) > 1 else len(course.x))
    if len(fixes) == 1:
        return first, middle
    last = course.pushed(fixes[1], len(course.x))
    # What the second fix measures is less by what the first one has led to until then.
    return np.concatenate([first - last @ first[fixes[1].step], last], axis=2), middle


def navigation(result: Evidence) -> Verdict | None:
    """Times, airspeeds, length, labels and the tables of the branches follow from their steps."""
    if not (nodes := nodes_of(result)):
        return None
    faults, count = dict[str, Any](), 0
    for node in nodes:
        for row in node.rows:
            faults |= _row_faults(result, node, row)
            count += 1
    return no_fault(f"{count} branches", faults)


def _row_faults(result: Evidence, node: Node, row: dict[str, Any]) -> dict[str, Any]:
    """What a branch states other than what follows from its steps."""
    dt, robot, begin = result.robot.dt, result.robot, node.step
    x, u, t = (np.array(row[key], float) for key in ("x", "u", "t"))
    speed = np.hypot(*u.T)
    name = f"branch {row['name']}"
    orders = result.orders(np.vstack([node.x[: begin + 1], x[1:]]))
    return {
        f"{name}: order {row['order']}": not any(order.endswith(row["order"]) for order in orders),
        f"{name}: times": not np.allclose(t, dt * (begin + np.arange(len(x))), rtol=1e-9),
        f"{name}: airspeed": not np.allclose(row["airspeed"], speed, rtol=1e-6),
        f"{name}: airspeed above u_max": (speed > robot.u_max * (1 + 1e-5)).any(),
        f"{name}: airspeed below u_min": (speed < robot.u_min * (1 - 1e-5)).any(),
        f"{name}: energy": robot.capacity is not None
        and float(robot.spent(node.on(row)).sum()) > robot.capacity * (1 + 1e-6),
        f"{name}: length": not close(row["length"], float(np.hypot(*np.diff(x, axis=0).T).sum()), 1e-6),
        f"{name}: headings": row["heading_true"] is not None
        and not _same_headings(row["heading_true"], azimuths(result.scene["crs"], x[:-1], u), speed),
        f"{name}: labels": result.ground.labels(x[1:-1]) != [frozenset(one) for one in row["label"][1:-1]]
        and not _near_edge(result, x, row["label"]),
    } | _table_faults(result, row)


def _same_headings(stated: list[float | None], derived: FloatArray, speed: FloatArray) -> bool:
    """Whether stated headings [deg] belong to the controls, where there is an airspeed."""
    told = np.array([math.nan if value is None else value for value in stated])
    turned = np.abs((told - derived + 180.0) % 360.0 - 180.0)
    return len(told) == len(derived) and bool((turned[speed >= STILL] <= TURNED).all())


def _near_edge(result: Evidence, x: FloatArray, stated: list[list[str]]) -> bool:
    """Whether labels differ at places near an edge only."""
    slack = 1e-3 * result.grain + 1e-6
    choices = [result.ground.labels(x, sign * slack) for sign in (-1.0, 0.0, 1.0)]
    return all(frozenset(one) in found for one, *found in zip(stated, *choices, strict=True))


def _table_faults(result: Evidence, row: dict[str, Any]) -> dict[str, Any]:
    """What ``branch_A.csv`` has other than the plan; its headings and times turn with ``robot.bank``."""
    file = result.directory / f"branch_{row['name']}.csv"
    if not file.is_file():
        return {}
    with file.open(encoding="utf-8", newline="") as text:
        table = list(csv.DictReader(text))
    name = file.name
    if len(table) != len(row["x"]):
        return {f"{name}: {len(table)} rows": True}
    if result.robot.bank or row["lat"] is None:
        return {}
    x, u = np.array(row["x"], float), np.array(row["u"], float)
    heading = azimuths(result.scene["crs"], 0.5 * (x[:-1] + x[1:]), u)
    wanted = {
        "lat_deg": row["lat"],
        "lon_deg": row["lon"],
        "t_s": row["t"],
        "airspeed_tas_m_s": row["airspeed"],
    }
    faults = {
        f"{name}: {column}": not np.allclose(
            [float(one[column]) for one in table[: len(values)]], values, atol=1e-6
        )
        for column, values in wanted.items()
    }
    told = np.array([float(one["heading_true_deg"] or "nan") for one in table[:-1]])
    turned = (told - heading + 180.0) % 360.0 - 180.0
    still = np.hypot(*u.T) < STILL
    faults[f"{name}: heading_true_deg"] = bool((np.abs(turned[~still]) > TURNED).any())
    return faults


# --- how often it fails -------------------------------------------------------------------------------


class Flown(NamedTuple):
    """New flights that come to a fix: their numbers, the branch of each, -1 without the fix, and failures.

    ``failed`` is with this fix and later ones, ``alone`` without them.
    """

    rows: IntArray
    number: IntArray
    failed: BoolArray
    alone: BoolArray


def flown(result: Evidence) -> list[Flown]:
    """New flights at each fix of :func:`nodes_of`: all branches are flown in the same winds as the plan."""
    known = result.remembered.get("branches")
    if isinstance(known, list):
        return known
    found = dict[tuple[int, ...], Flown]()
    nodes = nodes_of(result)
    root = nodes[0]
    steps = max(len(node.on(row)) for node in nodes for row in node.rows)
    change = np.zeros((max(steps, len(root.u)), RUNS, 2))
    _fly(result, root, change, np.arange(RUNS), found)
    ordered = [found[tuple(number for _, number in node.before)] for node in nodes]
    result.remembered["branches"] = ordered
    return ordered


def _new_flights(result: Evidence, u: FloatArray, change: FloatArray) -> FloatArray:
    """Positions (RUNS, T+1, 2) [m] of the controls ``u`` (T, 2), in the same winds for all controls.

    ``change`` (S, RUNS, 2) [m/s] is what each flight adds to them.
    """
    law = result.law("coherent", len(u))
    held = np.vstack([result.start] * (len(u) + 1))
    return fly(law, held, u, RUNS, np.random.default_rng(SEED), change=change[: len(u)])


def _fly(
    result: Evidence, node: Node, change: FloatArray, rows: IntArray, found: dict[tuple[int, ...], Flown]
) -> BoolArray:
    """Sort the flights ``rows`` at a fix; which of them fail with all branches.

    ``change`` (S, RUNS, 2) [m/s] is added to the controls after earlier fixes.
    """
    rng = np.random.default_rng([SEED, 1 + len(node.before)])
    error, luck = rng.standard_normal((RUNS, 2)), rng.random(RUNS)
    x = _new_flights(result, node.u, change)
    at = x[rows, node.step]
    y = at + node.fix["sd"] * error[rows]
    number = np.where(node.taken(at, luck[rows]), node.number(y), -1)
    alone = result.ground.failed(x[rows])
    failed, robot, met = alone.copy(), result.robot, number >= 0
    if node.rejoin or node.before:
        change = change.copy()
        change[node.step :, rows[met]] = 0.0
    if node.rejoin:
        back = np.linalg.solve(robot.b, (np.array(node.fix["place"]) - y[met]).T).T
        change[node.step :, rows[met]] = node.counter * back
        change[node.step : node.step + node.rejoin, rows[met]] += back / (node.rejoin * robot.dt)
    for j, row in enumerate(node.rows):
        own, later = number == j, node.after(j)
        if later is None:
            failed[own] = result.ground.failed(_new_flights(result, node.on(row), change)[rows[own]])
        else:
            failed[own] = _fly(result, later, change, rows[own], found)
    found[tuple(number for _, number in node.before)] = Flown(rows, number, failed, alone)
    return failed


def rates(name: str, result: Evidence) -> Verdict | None:
    """The rate of the plan with branches, alone, or of one branch, agrees with new flights."""
    if not (nodes := nodes_of(result)):
        return None
    new = flown(result)
    if name == "each branch":
        tests = [
            (row["rate"], own.failed[own.number == j])
            for node, own in zip(nodes, new, strict=True)
            for j, row in enumerate(node.rows)
        ]
    else:
        key = "rate" if name == "with branches" else "alone"
        tests = [
            (node.stated[key], own.failed if key == "rate" else own.alone)
            for node, own in zip(nodes, new, strict=True)
        ]
    chance = min(1.0, *(len(tests) * _chance(stated, failed) for stated, failed in tests))
    return likely(", ".join(f"{stated['failure']:.3g}" for stated, _ in tests), chance, RARE)


def _chance(stated: dict[str, Any], failed: BoolArray) -> float:
    """p value of the stated rate in new flights."""
    if not len(failed):
        return 1.0
    count = round(stated["failure"] * stated["runs"])
    return same_rate(count, stated["runs"], int(failed.sum()), len(failed))


def gain(result: Evidence) -> Verdict | None:
    """Differences belong to their two rates, below 0 with their intervals, and lengths are expected."""
    if not (nodes := nodes_of(result)):
        return None
    faults = dict[str, Any]()
    for node in nodes:
        faults |= _gain_faults(node)
    return no_fault(f"{nodes[0].stated['difference']['middle']:.3g}", faults)


def _gain_faults(node: Node) -> dict[str, Any]:
    stated, fix = node.stated, node.fix
    told, rate, alone = stated["difference"], stated["rate"], stated["alone"]
    since = node.before[-1][0].step if node.before else 0
    begun = float(np.hypot(*np.diff(node.x[since : node.step + 1], axis=0).T).sum())
    whole = float(np.hypot(*np.diff(node.x[since:], axis=0).T).sum())
    rests = sum(
        row["share"] * (begun + (row["branches"]["length"] if "branches" in row else row["length"]))
        for row in node.rows
    )
    taken = fix["available"]
    length = (1.0 - taken) * whole + taken * rests
    known = fix["landmark"] is None
    slack = 6.0 * math.sqrt(0.25 / rate["runs"]) * abs(whole - rests) + 1.0  # of flights that take the fix
    faults = {
        f"difference {told['middle']:.4g}": not close(
            told["middle"], rate["failure"] - alone["failure"], 1e-6, 1e-9
        ),
        "an interval without its difference": not told["low"] <= told["middle"] <= told["high"],
        "no gain": not node.before and told["high"] >= 0.0,
        "other numbers of flights": rate["runs"] != alone["runs"],
        "a branch fails otherwise than its branches": bool(node.before)
        and node.before[-1][0].rows[node.before[-1][1]]["rate"] != rate,
        f"length {stated['length']:.6g} is {length:.6g}": known and abs(stated["length"] - length) > slack,
    }
    return {f"{node.title}: {fault}": found for fault, found in faults.items()}


CLAIMS = (
    Claim("branches: where the plan branches", FILES, where),
    Claim("branches: cells divide the plane", ("plan.json",), division),
    Claim("branches: cells in words", ("plan.json",), words),
    Claim("branches: shares", FILES, shares),
    Claim("branches: positions given the cell", FILES, positions),
    Claim("branches: steps and tables", FILES, navigation),
    *(
        Claim(f"branches: failure rate {name}", FILES, partial(rates, name))
        for name in ("with branches", "alone", "each branch")
    ),
    Claim("branches: gain and expected length", FILES, gain),
)
