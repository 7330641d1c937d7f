"""Claims about the limits of a plan: the chance constraint of each segment, and the prices.

A price is judged by what it means: flights of the path as it is are judged again on a map whose limit is
moved outwards and inwards. The share of multipliers is not in those counts, so that the price of a barrier
may exceed them where it makes a segment close to epsilon.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.special import ndtr
from scipy.stats import chi2

from pareto_ltl_verify.arrays import BoolArray, FloatArray
from pareto_ltl_verify.claims import Claim, Verdict, no_fault, same, unlike
from pareto_ltl_verify.claims.plan import FILES, LEAST_RISK, RISK, step_deviations
from pareto_ltl_verify.evidence import Evidence
from pareto_ltl_verify.flights import NONE, RARE, Ground, failures
from pareto_ltl_verify.formula import losing
from pareto_ltl_verify.gaussians import segment_risks, step_margins
from pareto_ltl_verify.geometry import convex, outline_distance, within

DEVIATIONS = 2e-3  # largest allowed difference of two distances, relative to one standard deviation and more
RISK_OF_SEGMENT = 0.02  # largest allowed relative difference of two risks of a segment
MOVED = 2e-3  # how far a limit is moved to count its price, as a share of the map's size
LEAST_SHARE = 0.01  # of the largest price: smaller ones are not listed
RUNS = 2_000  # flights that are judged again for the price of a region
SIDES = ("western", "southern", "eastern", "northern")  # rows of the bounds: west and south, east and north
FACTOR = 2.5  # by which a price may differ from the counts on either side
FAR = 12.0  # [sd] with a risk below 1e-32: which of two such barriers is nearer has no meaning
SPREADS = 5.0  # standard deviations of a count, beside the factor
ROUNDING = 1e-6  # relative excess over epsilon that is rounding
BY_REGIONS = 1.25  # by which polygons around many cells of a region may raise a probability
MAX_SAVED = 30.0  # relative fall of the failures by a relative change of airspeed
TIGHT = 0.8  # share of epsilon above which multipliers of chance constraints may be part of a price
FULL_SPEED = 0.98  # share of u_max below which a step does not use all airspeed
ALIKE = 1e-3  # relative difference of lengths below which the front has no slope
SLOPE_OF = 0.05  # relative length over which slopes to longer and to shorter paths are taken
STEEPEST = 300.0  # relative fall of the failures by a relative length, where no path is shorter
PRICED = 40_000  # flights that a price is computed from
WIDTH = 1e-3  # share of the map's size within which flights count for a price
SHOWN = 4.0  # standard errors of a price that is shown, at least
LARGER, SMALLER = 4.0, 20.0  # stated over expected error and inverse: of eight blocks 2.6 and 13 by chance
BALANCED = 100.0  # for ``SMALLER`` where multipliers are part of a price
NEAR = 8.0  # [τ] a flight at this distance adds 1/3000 of what one at the limit adds


def segment_limits(result: Evidence) -> Verdict | None:
    """The closest barrier of each segment, its distance, and the probability that epsilon limits."""
    rows, fidelity, epsilon = result.plan.get("segments"), result.settings["fidelity"], result.epsilon
    if rows is None or not result.barriers:
        return None
    (z, risks), names, faults = result.segments, np.array(barrier_names(result)), []
    if len(rows) != len(z):
        return same(f"{len(rows)} segments", f"{len(z)} segments")
    for k, row in enumerate(rows):
        reported, nearest = row["deviations"], z[k].min()
        off = max(
            abs(reported - least) for least in (nearest, z[k, names == row["nearest"]].min(initial=np.inf))
        )
        if off > DEVIATIONS * (1.0 + abs(reported)) and min(reported, nearest) <= FAR:
            faults.append(f"step {k}: {row['nearest']} {reported:.4g} sd, nearest {nearest:.4g} sd")
        if abs(row["probability"] - risks[k]) > RISK_OF_SEGMENT * risks[k] + LEAST_RISK:
            faults.append(f"step {k}: probability {row['probability']:.4g}, computed {risks[k]:.4g}")
    worst = float(risks.max(initial=0.0))
    limited = fidelity["judge"] == "flights" or fidelity["collision_bound"] == "step"
    limited = limited and result.plan.get("epsilon_kept", True)  # else ``nearness`` tests it
    large = limited and worst > epsilon * (1.0 + RISK_OF_SEGMENT)
    above = {f"largest probability {worst:.4g}, above epsilon {epsilon:g}": large}
    return no_fault(f"at most {worst:.4g} a segment", faults, above)


def nearness(result: Evidence) -> Verdict | None:
    """Whether every segment keeps epsilon, and which segment is the worst; also in the metrics.

    A mission that can be lost in a region has no exact rule of which cells a path avoids at a step: there the
    probability lies between two values, of the barriers alone and with all cells that lose the mission.
    """
    stated, plan, epsilon = result.plan.get("epsilon_kept"), result.plan, result.epsilon
    if stated is None:
        return None
    worst, limit = plan["worst_segment"], epsilon * (1.0 + ROUNDING)
    low, high = _segment_risks(result)
    k, reported = worst["step"], worst["probability"]
    if k >= len(low):
        return same(f"segment {k}", f"one of {len(low)} segments")
    slack = 1.0 + RISK_OF_SEGMENT
    largest = BY_REGIONS if (high > low).any() else slack
    numbers = {"epsilon_kept": float(stated), "worst_segment_probability": reported}
    faults = {
        f"segment {k} collides {reported:.4g}, computed {low[k]:.4g} to {high[k]:.4g}": not (
            low[k] / slack - LEAST_RISK <= reported <= largest * high[k] + LEAST_RISK
        ),
        f"another segment collides {low.max(initial=0.0):.4g}": low.max(initial=0.0)
        > slack * reported + LEAST_RISK,
        f"closest to {worst['nearest']}": not _may_be_nearest(result, k, worst["nearest"]),
        f"keeps epsilon {epsilon:g}: {stated}, with {reported:.4g}": stated != (reported <= limit),
        f"metrics: {unlike(result.metrics, numbers)}": bool(unlike(result.metrics, numbers)),
    }
    return no_fault(f"at most {reported:.4g} a segment", faults)


def _may_be_nearest(result: Evidence, step: int, name: str) -> bool:
    """Whether ``name`` is the closest barrier of a segment, or a region that the mission may forbid."""
    if name.startswith("region "):
        return set(name.removeprefix("region ").split(" and ")) <= set(result.dfa.atoms)
    if not result.barriers:
        return name == "no barrier"
    z, names = result.segments[0][step], np.array(barrier_names(result))
    if result.settings["fidelity"]["collision_bound"] == "step":  # the best face, which is not the best line
        room = step_margins(result.barriers, result.x, result.course.cov, step_deviations(result))[:, step]
        return bool(room[names == name].min(initial=np.inf) <= room.min() + result.grain)
    return bool(z[names == name].min(initial=np.inf) <= z.min() + DEVIATIONS * (1.0 + abs(z.min()))) or bool(
        z.min() > FAR
    )


def _segment_risks(result: Evidence) -> tuple[FloatArray, FloatArray]:
    """The collision probability of each segment (T,): of barriers, and with cells that lose the mission."""
    steps, cov = len(result.u), result.course.cov
    low = np.minimum(result.segments[1], 1.0) if result.barriers else np.zeros(steps)
    if result.settings["fidelity"]["collision_bound"] == "step":  # faces give more than supporting lines
        return low, np.ones(steps)
    high = low.copy()
    states = result.ground.states(result.x[None])[0]
    labels, cells = result.cells["labels"], [convex(corners) for corners in result.cells["cells"]]
    for t in range(steps):
        way = result.timetable.way(t + 1)
        lost = losing(result.dfa, result.ground.letter(NONE, way))[states[t : t + 2]].any(axis=0)
        letters = result.letter_numbers(labels, way)
        parts = [cell for cell, k, label in zip(cells, letters, labels, strict=True) if label and lost[k]]
        if parts:
            ends = slice(t, t + 2)
            every = (*result.barriers, *parts)
            high[t] = min(1.0, float(segment_risks(every, result.x[ends], cov[ends])[1][0]))
    return low, np.maximum(low, high)


def barrier_names(result: Evidence) -> list[str]:
    """``obstacle 3`` for each convex part in the third obstacle of the map; the sides of a walled map."""
    outlines = [np.array(corners, float) for corners in result.scene["obstacles"]]
    middles = np.array([part.corners.mean(axis=0) for part in result.obstacles]).reshape(-1, 2)
    gaps = [np.where(within(one, middles), 0.0, outline_distance(one, middles)) for one in outlines]
    names = [f"obstacle {k + 1}" for k in (np.argmin(gaps, axis=0) if gaps else ())]
    walls = ("western", "eastern", "southern", "northern")[: len(result.barriers) - len(names)]
    return names + [f"the {side} border" for side in walls]


# --- prices -----------------------------------------------------------------------------------


def prices(result: Evidence) -> Verdict | None:
    """Every price against flights on maps with that limit moved, slopes of the front, or full airspeed."""
    rows = result.plan.get("prices")
    if rows is None or result.planned_law not in result.new_flights:
        return None
    faults = _segment_price_faults(result, rows)
    for row in rows:
        fault = PRICES[row["kind"]](result, row)
        faults += [f"{row['name']}: {fault}"] * bool(fault)
    return no_fault(f"{len(rows)} prices", faults)


def _segment_price_faults(result: Evidence, rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """The prices of all segments add up to the prices of obstacles and borders, except the smallest."""
    of_segments = sum(row.get("price", 0.0) for row in result.plan.get("segments", ()))
    listed = [row["saving"] for row in rows if row["kind"] in ("obstacle", "border")]
    small = LEAST_SHARE * max((row["saving"] for row in rows if row["kind"] in COUNTS), default=0.0)
    limit = sum(listed) + small * len(result.barriers)
    if (1.0 - RISK) * sum(listed) <= of_segments <= (1.0 + RISK) * limit + LEAST_RISK:
        return []
    return [f"segments {of_segments:.4g} a metre, obstacles and borders {sum(listed):.4g}"]


def _outline_price(result: Evidence, row: Mapping[str, Any]) -> str:
    """The fault of the price of an obstacle, a border or a region; empty if it is right."""
    by = MOVED * float(np.ptp(result.ground.bounds, axis=0).mean())
    try:
        counts, runs = COUNTS[row["kind"]](result, row, (-by, 0.0, by))
    except LookupError:
        return "no such limit"
    changes = np.abs(np.diff(counts))
    slopes, doubt = changes / (runs * by), SPREADS * np.sqrt(max(changes.max(), 1)) / (runs * by)
    sure = float(chi2.ppf(RARE, 2 * changes.min())) / 2.0 if changes.min() else 0.0  # of a Poisson number
    high = slopes.max() * FACTOR + doubt + _multiplier(result, row)
    if sure / (FACTOR * runs * by) <= row["saving"] <= high:
        return error_fault(result, row)
    return f"{row['saving']:.3g} a metre, flights give {slopes.min():.3g} to {slopes.max():.3g}"


def _multiplier(result: Evidence, row: Mapping[str, Any]) -> float:
    """The largest share [1/m] that a segment close to epsilon can add to the price of one of its barriers.

    The risk of z standard deviations falls by its share of about z + 1 for each of them.
    """
    if row["kind"] not in ("obstacle", "border") or not _is_tight(result):
        return 0.0
    z, risks = result.segments
    tight = risks >= TIGHT * result.epsilon
    own = z[:, np.array(barrier_names(result)) == row["name"]].min(axis=1, initial=np.inf)[tight]
    cov = result.course.cov
    sd = np.sqrt(np.linalg.eigvalsh(0.5 * (cov[1:] + cov[:-1])).mean(axis=1))[tight]
    share = np.minimum(ndtr(-own) / risks[tight], 1.0)
    steep = np.where(share > 0.0, 1.0 + np.maximum(np.minimum(own, FAR), 0.0), 0.0)
    failing = float(result.new_failures(result.planned_law).mean())
    return float(FACTOR * failing * (share * steep / np.maximum(sd, result.grain)).max())


def error_fault(result: Evidence, row: Mapping[str, Any]) -> str:
    """The fault of the error of a price; empty if it is right, or an earlier plan has none.

    With s = σ(-m/τ) and margins m of constant density ρ near 0, the price is ρ, and its variance
    Σ (s (1 - s) / (n τ))² = ρ / (6 n τ). If the error is then larger than the price, few flights come near
    the limit, and the price must not be certain enough to be shown. Where the density grows away from the
    limit, k flights within ``NEAR`` τ have a small s each, and the error is at least the price / √k. Where a
    segment is close to epsilon, multipliers take up what the counts of a block leave of the balance of
    forces: their sum varies less than the counts, or more.
    """
    price, tight = row["saving"], _is_tight(result)
    width = WIDTH * float(np.ptp(result.ground.bounds, axis=0).mean())
    expected = np.sqrt(price / (6.0 * PRICED * width))
    rare = expected > price
    least = price / SHOWN if rare else expected / (BALANCED if tight else SMALLER)
    largest = np.inf if rare or tight else LARGER * expected
    if "error" not in row or least <= row["error"] <= largest:
        return ""
    if row["error"] < least:
        (inner, outer), runs = COUNTS[row["kind"]](result, row, (-NEAR * width, NEAR * width))
        if row["error"] >= 0.5 * price / np.sqrt(max(PRICED / runs * abs(outer - inner), 1.0)):
            return ""
    return f"error {row['error']:.3g} a metre, expected about {expected:.3g}"


def _is_tight(result: Evidence) -> bool:
    """Whether a segment comes close to epsilon."""
    return bool(result.barriers) and bool(result.segments[1].max() >= TIGHT * result.epsilon)


Counts = tuple[
    list[int], int
]  # failures with a limit moved by each of several distances; of how many flights


def _obstacle_counts(result: Evidence, row: Mapping[str, Any], moves: Sequence[float]) -> Counts:
    """Failures of all new flights: only the parts of the obstacle are looked at again."""
    own = np.array(barrier_names(result)[: len(result.obstacles)]) == row["name"]
    if not own.any():
        raise LookupError(row["name"])
    x, ground, hits = result.new_flights[result.planned_law], result.ground, _hits(result)
    accepted, _, off = result.new_verdicts[result.planned_law]
    others = failures(accepted, hits[~own].any(axis=0), off, ground.walled)
    left = np.flatnonzero(~others)
    parts = [part for part, here in zip(result.obstacles, own, strict=True) if here]
    counts = []
    for by in moves:
        moved = replace(ground, obstacles=[part.moved(by) for part in parts])
        counts.append(int(others.sum()) + int(moved.collided(x[left]).sum()))
    return counts, len(x)


def _hits(result: Evidence) -> BoolArray:
    """Which new flights meet each convex part of the obstacles, (parts, n)."""
    key = "parts that new flights meet"
    if key not in result.remembered:
        x, ground = result.new_flights[result.planned_law], result.ground
        some = np.flatnonzero(result.new_verdicts[result.planned_law][1])
        hits = np.zeros((len(result.obstacles), len(x)), bool)
        for k, part in enumerate(result.obstacles):
            hits[k, some] = replace(ground, obstacles=[part]).collided(x[some])
        result.remembered[key] = hits
    return np.asarray(result.remembered[key], bool)


def _border_counts(result: Evidence, row: Mapping[str, Any], moves: Sequence[float]) -> Counts:
    """Failures of all new flights with one side of the border moved outwards."""
    x, (accepted, collided, _) = (
        result.new_flights[result.planned_law],
        result.new_verdicts[result.planned_law],
    )
    grounds = [_border_changed(result, row["name"], by) for by in moves]
    off = [ground.off_map(x) for ground in grounds]
    return [int(failures(accepted, collided, one, result.ground.walled).sum()) for one in off], len(x)


def _region_counts(result: Evidence, row: Mapping[str, Any], moves: Sequence[float]) -> Counts:
    """Failures of ``RUNS`` new flights with a region that is larger on every side."""
    x = result.new_flights[result.planned_law][:RUNS]
    _, collided, off = (flags[:RUNS] for flags in result.new_verdicts[result.planned_law])
    accepted = [_region_changed(result, row["name"], by).accepted(x) for by in moves]
    return [int(failures(one, collided, off, result.ground.walled).sum()) for one in accepted], len(x)


def _border_changed(result: Evidence, name: str, by: float) -> Ground:
    side = SIDES.index(name.split()[1]) if name.endswith(" border") else -1
    if side not in range(4) or not result.ground.walled:
        raise LookupError(name)
    bounds = result.ground.bounds.copy()
    bounds[side // 2, side % 2] += by if side < 2 else -by
    return replace(result.ground, bounds=bounds)


def _region_changed(result: Evidence, name: str, by: float) -> Ground:
    places = [result.timetable.region(one) or one for one in name.split(" and ")]
    moved = {place: [part.moved(by) for part in result.ground.regions[place]] for place in places}
    return replace(result.ground, regions={**result.ground.regions, **moved})


def _airspeed_price(result: Evidence, row: Mapping[str, Any]) -> str:
    """Airspeed has a price only where a step uses all of it, and none that saves many times all failures."""
    fastest = float(result.plan["u_max"])
    used = np.linalg.norm(result.u, axis=1).max() / fastest
    if not (row["saving"] >= 0.0 and used >= FULL_SPEED):
        return f"at most {used:.2f} of it is used"
    limit = MAX_SAVED * float(result.plan["promise"]["high"] if result.plan["promise"] else 1.0) / fastest
    return (
        ""
        if row["saving"] <= limit
        else f"{row['saving']:.3g} for 1 m/s, where at most {limit:.3g} is credible"
    )


def _length_price(result: Evidence, row: Mapping[str, Any]) -> str:
    """The price lies between the slopes of the front to longer and to shorter paths, with their intervals."""
    length = float(result.plan["objectives"]["length"])
    names = ("length_m", "failure_low", "failure_high")
    lengths, low, high = np.array([[float(one[name]) for name in names] for one in result.front]).T
    apart, here = lengths / length - 1.0, int(np.abs(lengths - length).argmin())
    longer, shorter = (apart > ALIKE) & (apart <= SLOPE_OF), (apart < -ALIKE) & (apart >= -SLOPE_OF)
    flattest = ((low[here] - high[longer]) / (apart[longer] * length)).max(initial=0.0)
    steepest = STEEPEST * high[here] / length
    if shorter.any():
        steepest = ((high[shorter] - low[here]) / (-apart[shorter] * length)).max()
    if flattest / FACTOR <= row["saving"] <= FACTOR * steepest + LEAST_RISK / length:
        return ""
    return f"{row['saving']:.3g} a metre, the front has slopes of {flattest:.3g} to {steepest:.3g}"


COUNTS: dict[str, Callable[[Evidence, Mapping[str, Any], Sequence[float]], Counts]] = {
    "obstacle": _obstacle_counts, "border": _border_counts, "region": _region_counts,
    "avoided": _region_counts,
}  # fmt: skip
PRICES: dict[str, Callable[[Evidence, Mapping[str, Any]], str]] = {
    **dict.fromkeys(COUNTS, _outline_price), "airspeed": _airspeed_price, "length": _length_price,
}  # fmt: skip

CLAIMS: tuple[Claim, ...] = (
    Claim("plan: limits of its segments", FILES, segment_limits),
    Claim("plan: whether it keeps epsilon", FILES, nearness),
    Claim("plan: prices of its limits", (*FILES, "deployments.npz", "front.csv"), prices),
)
