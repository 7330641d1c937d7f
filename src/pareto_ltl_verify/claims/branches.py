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

from pareto_ltl.support.arrays import BoolArray, FloatArray, IntArray
from pareto_ltl.support.display import distance_text
from pareto_ltl_verify import laws
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


class Tree(NamedTuple):
    """The branches of ``plan.json``: step of the fix, axes (2, 2), cells (4,) each: along, left."""

    stated: dict[str, Any]
    step: int
    axes: FloatArray
    boxes: FloatArray

    @property
    def rows(self) -> list[dict[str, Any]]:
        """What is stated of each branch."""
        return list(self.stated["branches"])

    def number(self, y: FloatArray) -> IntArray:
        """The branch of each position ``y`` (n, 2) [m]; -1 in no cell, -2 in several."""
        along, left = ((y - np.array(self.stated["fix"]["place"])) @ self.axes.T).T
        held = np.stack([(a <= along) & (along < b) & (c <= left) & (left < d) for a, b, c, d in self.boxes])
        count = held.sum(axis=0)
        return np.where(count == 1, held.argmax(axis=0), np.where(count == 0, -1, -2))

    def taken(self, x: FloatArray, luck: FloatArray) -> BoolArray:
        """Which robots at ``x`` (n, 2) [m] take the fix, by their ``luck`` (n,), uniform in [0, 1)."""
        fix = self.stated["fix"]
        able = luck < fix["available"]
        if fix["landmark"] is None:
            return np.asarray(able, bool)
        return np.asarray(able & (deepest([convex(fix["landmark"])], x) >= -ON_EDGE), bool)


def tree_of(result: Evidence) -> Tree | None:
    """The branches; None if the plan has none."""
    stated = result.plan.get("branches")
    if stated is None:
        return None
    east, north = stated["fix"]["ahead"]
    boxes = [
        [-math.inf if low is None else low, math.inf if high is None else high]
        for row in stated["branches"]
        for low, high in (row["along"], row["left"])
    ]
    axes = np.array([[east, north], [-north, east]])
    return Tree(stated, stated["fix"]["step"], axes, np.array(boxes, float).reshape(-1, 4))


def where(result: Evidence) -> Verdict | None:
    """The fix is at a time of branch.at or in a landmark, at the planned position, along the track."""
    tree = tree_of(result)
    if tree is None:
        return None
    cfg, fix, x, k = result.settings["branch"], tree.stated["fix"], result.x, tree.step
    if not 1 <= k < len(result.u):
        return Verdict(f"step {k}", "not within the plan", False)
    ahead = x[k] - x[k - 1]
    marks = result.scene.get("landmarks") or []
    at_times = bool(cfg["at"])
    sd = cfg["fix_sd"] if at_times else result.robot.fix_sd
    steps = [round(3600.0 * hours / result.robot.dt) for hours in cfg["at"]]
    faults = {
        f"{len(tree.rows)} branches": not 2 <= len(tree.rows) <= cfg["leaves"],
        f"step {k} is at no time of branch.at": at_times and k not in steps,
        "the outline is no landmark": not at_times and fix["landmark"] not in marks,
        "a landmark although branch.at is set": at_times and fix["landmark"] is not None,
        "place": not np.allclose(fix["place"], x[k], atol=1e-6 + result.grain),
        "direction": not np.allclose(fix["ahead"], ahead / max(np.hypot(*ahead), 1e-9), atol=1e-6),
        f"sd {fix['sd']:g}": not close(fix["sd"], sd),
        "probability": not close(fix["available"], cfg["available"]),
        "names": [row["name"] for row in tree.rows] != list("ABCD"[: len(tree.rows)]),
    }
    return no_fault(f"step {k}, {len(tree.rows)} branches", faults)


def division(result: Evidence) -> Verdict | None:
    """Every measured position lies in exactly one cell: one point of each box between all lines is tried."""
    tree = tree_of(result)
    if tree is None:
        return None
    middles = []
    for ends in (tree.boxes[:, :2], tree.boxes[:, 2:]):
        cuts = np.unique(ends[np.isfinite(ends)])
        rim = [-1e9, *cuts.tolist(), 1e9]
        middles.append([*(0.5 * (a + b) for a, b in pairwise(rim)), *cuts.tolist()])
    points = np.array(list(product(*middles)))
    number = tree.number(np.array(tree.stated["fix"]["place"]) + points @ tree.axes)
    return no_fault(
        f"{len(points)} places", {"in no cell": (number == -1).any(), "in two": (number == -2).any()}
    )


def words(result: Evidence) -> Verdict | None:
    """The words of each cell say what its numbers do."""
    tree = tree_of(result)
    if tree is None:
        return None
    faults = {}
    for row, (a, b, c, d) in zip(tree.rows, tree.boxes.tolist(), strict=True):
        parts = [
            _side(c, d, "left of", "right of", "the planned track"),
            _side(a, b, "ahead of", "behind", "the planned position (along the track)"),
        ]
        text = ", and ".join(part for part in parts if part)
        faults[f"branch {row['name']}: {row['where']}"] = row["where"] != text
    return no_fault(f"{len(tree.rows)} cells", faults)


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
    """Share of a cell, and mean (2,) and covariance (2, 2) of y - x in it, of ``draws`` positions."""

    share: float
    mean: FloatArray
    cov: FloatArray
    draws: int


def told_by_cells(result: Evidence) -> list[Told]:
    """The moments of measured positions in each cell, by sampling from the covariance at the fix."""
    tree = tree_of(result)
    assert tree is not None
    rng, fix = np.random.default_rng(SEED), tree.stated["fix"]
    cov = result.course.cov[tree.step]
    e = rng.standard_normal((DRAWS, 2)) @ np.linalg.cholesky(cov + 1e-9 * np.trace(cov) * np.eye(2)).T
    y = e + fix["sd"] * rng.standard_normal((DRAWS, 2))
    place = np.array(fix["place"])
    taken = tree.taken(place + e, np.zeros(DRAWS))
    number = tree.number(place + y)[taken]
    y = y[taken]
    found = []
    for k in range(len(tree.rows)):
        held = y[number == k]
        enough = len(held) > 1
        found.append(
            Told(
                len(held) / max(len(y), 1), held.mean(axis=0) if enough else np.zeros(2),
                np.cov(held.T) if enough else np.zeros((2, 2)), len(y),
            )
        )  # fmt: skip
    return found


def shares(result: Evidence) -> Verdict | None:
    """The share of each cell follows from the covariance at the fix."""
    tree = tree_of(result)
    if tree is None:
        return None
    faults = {}
    for row, told in zip(tree.rows, told_by_cells(result), strict=True):
        error = math.sqrt(max(told.share * (1.0 - told.share), 1e-6) / max(told.draws, 1))
        off = abs(row["share"] - told.share)
        faults[f"branch {row['name']}: {row['share']:.4g} is {told.share:.4g}"] = off > 2e-3 + SPREAD * error
    return no_fault(f"{len(tree.rows)} shares", faults)


def positions(result: Evidence) -> Verdict | None:
    """Means and covariances of each branch come from flights in its cell that fly its controls."""
    tree = tree_of(result)
    if tree is None:
        return None
    k, fix, worst = tree.step, tree.stated["fix"], 0.0
    for row, told in zip(tree.rows, told_by_cells(result), strict=True):
        u = np.vstack([result.u[:k], np.array(row["u"], float)])
        law = result.law("coherent", len(u))
        course = laws.fly_controls(law, result.start, u)
        across = laws.covariance_across(law, course)
        S = course.cov[k] + fix["sd"] ** 2 * np.eye(2)
        inverse = np.linalg.inv(S)
        W = inverse @ (S - told.cov) @ inverse
        x, cov = np.array(row["x"], float), np.array(row["cov"], float)
        if x.shape != (len(u) - k + 1, 2) or cov.shape != (len(u) - k + 1, 2, 2):
            return Verdict(f"branch {row['name']}", "another number of steps", False)
        for t in range(k, len(u) + 1):
            D = across[t, k]
            mean, left = course.x[t] + D @ inverse @ told.mean, course.cov[t] - D @ W @ D.T
            sd = math.sqrt(max(float(np.trace(left)), result.grain**2))
            worst = max(worst, float(np.linalg.norm(x[t - k] - mean)) / sd)
            worst = max(worst, float(np.abs(cov[t - k] - left).max()) / sd**2)
    return within(f"{len(tree.rows)} branches", worst, LARGEST, " sd")


def navigation(result: Evidence) -> Verdict | None:
    """Times, airspeeds, length, labels and the tables of the branches follow from their steps."""
    tree = tree_of(result)
    if tree is None:
        return None
    dt, robot, faults = result.robot.dt, result.robot, dict[str, Any]()
    for row in tree.rows:
        x, u, t = (np.array(row[key], float) for key in ("x", "u", "t"))
        speed = np.hypot(*u.T)
        name = f"branch {row['name']}"
        faults |= {
            f"{name}: times": not np.allclose(t, dt * (tree.step + np.arange(len(x))), rtol=1e-9),
            f"{name}: airspeed": not np.allclose(row["airspeed"], speed, rtol=1e-6),
            f"{name}: airspeed above u_max": (speed > robot.u_max * (1 + 1e-5)).any(),
            f"{name}: airspeed below u_min": (speed < robot.u_min * (1 - 1e-5)).any(),
            f"{name}: energy": robot.capacity is not None
            and float(robot.spent(np.vstack([result.u[: tree.step], u])).sum()) > robot.capacity * (1 + 1e-6),
            f"{name}: length": not close(row["length"], float(np.hypot(*np.diff(x, axis=0).T).sum()), 1e-6),
            f"{name}: headings": row["heading_true"] is not None
            and not _same_headings(row["heading_true"], azimuths(result.scene["crs"], x[:-1], u), speed),
            f"{name}: labels": result.ground.labels(x[1:-1]) != [frozenset(one) for one in row["label"][1:-1]]
            and not _near_edge(result, x, row["label"]),
        }
        faults |= _table_faults(result, row)
    return no_fault(f"{len(tree.rows)} branches", faults)


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
    """New flights: the branch of each, -1 without a fix, and whether it fails with branches, and alone."""

    number: IntArray
    failed: BoolArray
    alone: BoolArray


def flown(result: Evidence) -> Flown:
    """New flights of the plan with its branches: all branches are flown in the same winds as the plan."""
    known = result.remembered.get("branches")
    if isinstance(known, Flown):
        return known
    tree = tree_of(result)
    assert tree is not None
    k, fix = tree.step, tree.stated["fix"]

    def one(u: FloatArray) -> FloatArray:
        law = result.law("coherent", len(u))
        return fly(law, np.vstack([result.start] * (len(u) + 1)), u, RUNS, np.random.default_rng(SEED))

    x = one(result.u)
    rng = np.random.default_rng(SEED + 1)
    y = x[:, k] + fix["sd"] * rng.standard_normal((RUNS, 2))
    number = np.where(tree.taken(x[:, k], rng.random(RUNS)), tree.number(y), -1)
    alone = result.ground.failed(x)
    failed = alone.copy()
    for j, row in enumerate(tree.rows):
        rows = np.flatnonzero(number == j)
        u = np.vstack([result.u[:k], np.array(row["u"], float)])
        failed[rows] = result.ground.failed(one(u)[rows])
    found = Flown(number, failed, alone)
    result.remembered["branches"] = found
    return found


def rates(name: str, result: Evidence) -> Verdict | None:
    """The rate of the plan with branches, alone, or of one branch, agrees with new flights."""
    tree = tree_of(result)
    if tree is None:
        return None
    new = flown(result)
    if name == "each branch":
        chance, text = 1.0, []
        for j, row in enumerate(tree.rows):
            own = new.failed[new.number == j]
            chance = min(chance, len(tree.rows) * _chance(row["rate"], own))
            text.append(f"{row['rate']['failure']:.3g}")
        return likely(", ".join(text), chance, RARE)
    stated = tree.stated["rate" if name == "with branches" else "alone"]
    return likely(
        f"{stated['failure']:.4g}",
        _chance(stated, new.failed if name == "with branches" else new.alone),
        RARE,
    )


def _chance(stated: dict[str, Any], failed: BoolArray) -> float:
    """p value of the stated rate in new flights."""
    if not len(failed):
        return 1.0
    count = round(stated["failure"] * stated["runs"])
    return same_rate(count, stated["runs"], int(failed.sum()), len(failed))


def gain(result: Evidence) -> Verdict | None:
    """The difference belongs to the two rates, below 0 with its interval, and the length is expected."""
    tree = tree_of(result)
    if tree is None:
        return None
    stated = tree.stated
    told, rate, alone, fix = stated["difference"], stated["rate"], stated["alone"], stated["fix"]
    begun = float(np.hypot(*np.diff(result.x[: tree.step + 1], axis=0).T).sum())
    whole = float(np.hypot(*np.diff(result.x, axis=0).T).sum())
    rests = sum(row["share"] * (begun + row["length"]) for row in tree.rows)
    taken = fix["available"]
    length = (1.0 - taken) * whole + taken * rests
    known = fix["landmark"] is None
    slack = 6.0 * math.sqrt(0.25 / rate["runs"]) * abs(whole - rests) + 1.0  # of flights that take the fix
    faults = {
        f"difference {told['middle']:.4g}": not close(
            told["middle"], rate["failure"] - alone["failure"], 1e-6, 1e-9
        ),
        "an interval without its difference": not told["low"] <= told["middle"] <= told["high"],
        "no gain": told["high"] >= 0.0,
        "other numbers of flights": rate["runs"] != alone["runs"],
        f"length {stated['length']:.6g} is {length:.6g}": known and abs(stated["length"] - length) > slack,
    }
    return no_fault(f"{told['middle']:.3g}", faults)


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
