"""The texts that report.html should have, derived from the records of a result."""

from __future__ import annotations

import math
import shlex
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from careful_io.reading import read_text
from careful_io.texts import SLOW, distance_text, energy_text, interval_text, probability_text, rate_text
from pareto_ltl_verify.arrays import BoolArray
from pareto_ltl_verify.claims.height import flown
from pareto_ltl_verify.claims.plan import OBJECTIVES
from pareto_ltl_verify.evidence import LAWS, Evidence, all_branches
from pareto_ltl_verify.flights import failures, rate_of
from pareto_ltl_verify.wording import (
    AIR,
    WATER,
    Medium,
    allowed_text,
    branched_text,
    headline_text,
    promised_text,
    winds_text,
)

FACTS = ("seed", "fidelity", "version", "code_hash", "config_hash", "python")  # of run.json, on the page
SAMPLES = {"flights": "flights", "importance sampling": "weighted flights"}
CHANGES = {
    "obstacle": "{} smaller on every side",
    "border": "{} farther out",
    "region": "{} larger on every side",
    "avoided": "{} smaller on every side",
    "airspeed": "{} more",
    "length": "{} more",
}  # fmt: skip - what a small change of each kind of limit is
CLOSEST = 5  # segments that are listed
CERTAIN = 4.0  # standard errors of a price that is shown, at least
CHANGE = 2e-3  # largest change of an outline that a price is shown for, as a share of the map's size
FASTER, SLOW_CHANGE = 1.0 / 3.6, 0.03  # [m/s] change of an airspeed; of a slow robot, as a share of its speed
TIGHT_PRICE, TIGHT_RISK = 0.05, 0.1  # shares of the largest price and of epsilon above which a place is tight
ALARM = "no failure rate is promised: the law of the plan does not explain what was measured"
NO_SEGMENTS = "no segment is limited: the map has neither obstacles nor walls"
NO_PRICES = "no prices: no flight comes near to failing, all are the same, or the plan is an earlier one"
UNSURE = "not shown, with a standard error above a quarter of the price"


def hours(seconds: float) -> str:
    """A time [s] in hours."""
    return f"{seconds / 3600.0:,.2f} h"


def degrees(angle: float) -> str:
    """An angle [deg] in whole degrees."""
    return f"{angle:,.0f}°"


def air(amount: float) -> str:
    """An area times a time [km² h]."""
    return f"{amount:,.0f} km² h" if amount >= 100.0 else f"{amount:.3g} km² h"


COSTS = {
    "energy": (energy_text, "for the airspeeds"),
    "duration": (hours, "until arrival"),
    "turns": (degrees, "sum of all turns"),
    "containment": (air, "area and time that hold it"),
}  # the text of each cost of this package besides the length, and what is said of it


def medium_of(result: Evidence) -> Medium:
    """The words for what the robot moves in."""
    wet = flown(result).metres < 0.0 or result.wind.level.endswith("depth")
    return WATER if wet else AIR


def alarmed(result: Evidence) -> bool:
    """Whether the plan was made after an alarm and has no probabilities."""
    return result.plan["objectives"]["mission_risk"] is None


def foreign_costs(result: Evidence) -> list[str]:
    """Costs that another package adds, whose text is not known."""
    return [
        name for name in result.plan["objectives"] if name not in COSTS and name not in OBJECTIVES.values()
    ]


def chosen_point(result: Evidence) -> int | None:
    """The number of the plan in the front; None without a front that contains it."""
    if not result.has("front.csv"):
        return None
    same = (k for k in range(len(result.front)) if np.array_equal(result.front_x(k), result.x))
    return next(same, None)


def level_gap(result: Evidence) -> str:
    """What plan.json says of a wind of another level than the robot's, which another claim derives."""
    parts = result.plan.get("not_covered", "").removesuffix(".").split("; ")
    return next((one for one in parts if one.startswith("the robot ") and " used is " in one), "")


def headline(result: Evidence) -> tuple[str, str]:
    """How many flights fail, and the note on it."""
    promise, flows = result.plan["promise"], medium_of(result).flows
    tree, floor = result.plan.get("branches"), promise.get("floor", 0.0)
    rate = promise if tree is None else tree["rate"]
    value, note = headline_text(
        rate["failure"], rate["low"], rate["high"], winds_text(flows, rate["law"], level_gap(result)),
        f"{_sample(rate)} under {rate['law']} {flows}", floor,
    )  # fmt: skip
    return value, note if tree is None else branched_text(note, promise["failure"], floor)


def promised(promise: Mapping[str, Any]) -> str:
    """The promised rate, not less than the data of the law of forecast errors can say."""
    return promised_text(promise["failure"], promise.get("floor", 0.0))


# --- the facts at the top -------------------------------------------------------------------------


def facts(result: Evidence) -> Iterator[dict[str, str]]:
    """Name, value and note of each fact."""
    plan, flows, gap = result.plan, medium_of(result).flows, level_gap(result)
    promise, costs, bound = plan["promise"], plan["objectives"], f"under {result.planned_law}"
    if promise is not None:
        value, note = headline(result)
        yield _fact("fails", value, note + (f"; no promise: {gap}" if gap else ""))
    elif alarmed(result):
        yield _fact("fails", "no promise", ALARM)
    else:
        note = f"upper bound of failures of the mission and collisions, {bound} {flows}"
        yield _fact("fails", _at_most(costs["mission_risk"] + costs["collision_risk"]), note)
    flights = [deployed(result, law) for law in sorted(LAWS) if _has_flights(result, law)]
    if promise is None and flights:
        worst = max(flights, key=lambda rate: rate["failure"])
        yield _fact("simulated to fail", probability_text(worst["failure"]), _note(worst, flows))
    took = float(plan["t"][-1]) - float(plan["t"][0])
    minutes = round(took / 60.0)
    duration = f"{minutes // 60} h {minutes % 60:02d} min" if minutes >= 60 else f"{took:,.0f} s"
    yield _fact("length", distance_text(costs["length"]), "of the expected path")
    yield _fact("duration", duration, f"{len(plan['u'])} steps of {plan['dt']:,.6g} s")
    for name in (key for key in costs if key in COSTS):
        text, note = COSTS[name]
        yield _fact(name, text(costs[name]), note)
    if plan["time_utc"] is not None:
        for name, time in (("departure", plan["time_utc"][0]), ("arrival", plan["time_utc"][-1])):
            yield _fact(name, f"{time[11:16]} UTC", time[:10])
    number = chosen_point(result)
    if number is not None:
        yield _fact("chosen", f"point {number}", f"of the front, rule {plan['selection']['rule']}")


def _fact(name: str, value: str, note: str) -> dict[str, str]:
    return {"name": name, "value": value, "note": note}


def _sample(rate: Mapping[str, Any]) -> str:
    return f"{rate['runs']:,} {SAMPLES[rate.get('method', 'flights')]}"


def _note(rate: Mapping[str, Any], flows: str) -> str:
    return f"{interval_text(rate['low'], rate['high'])} (95 %), under {rate['law']} {flows}, {_sample(rate)}"


def _at_most(bound: float) -> str:
    text = probability_text(min(1.0, bound))
    return text if text.startswith("<") else f"≤ {text}"


def _has_flights(result: Evidence, law: str) -> bool:
    return result.has("deployments.npz") and f"{law}/x" in result.flights


def _flags(result: Evidence, law: str) -> tuple[BoolArray, BoolArray, BoolArray]:
    """Which stored flights complete the mission, meet an obstacle, and leave the map."""
    names = ("accepted", "collided", "off_map")
    accepted, collided, off = (np.asarray(result.flights[f"{law}/{name}"], bool) for name in names)
    return accepted, collided, off


def deployed(result: Evidence, law: str) -> dict[str, Any]:
    """The failure rate of the stored flights under a law."""
    failed = failures(*_flags(result, law), result.ground.walled)
    return {"law": law} | rate_of(int(failed.sum()), len(failed)) | {"runs": len(failed)}


# --- how often it fails ---------------------------------------------------------------------------


def verdicts(result: Evidence) -> Iterator[dict[str, str]]:
    """The rows of the table of failures."""
    promise = result.plan["promise"]
    if promise is not None:
        stands = "the claim stands" if promise["passed"] else "above what the front claimed"
        what = f"{'' if level_gap(result) else 'promised: '}fresh flights of the plan"
        yield _row(what, promise, f"{_sample(promise)}; {stands}") | {"rate": promised(promise)}
        claimed = promise["claimed"]
        yield _row("claimed when the front was judged", claimed, _sample(claimed))
    if (tree := result.plan.get("branches")) is not None:
        when = f"{round(tree['fix']['step'] * result.robot.dt) / 3600:.4g} h"
        steps = tree["fix"].get("rejoin_steps", 0)
        off = f", and {round(steps * result.robot.dt) / 3600:.4g} h to fly its distance off" if steps else ""
        off += ", then against its drift" if tree["fix"].get("counter_per_s", 0.0) else ""
        yield _row(f"the plan with branches after a fix at {when}{off}", tree["rate"], _sample(tree["rate"]))
        for row in all_branches(tree):
            told = f"{_sample(row['rate'])}: {probability_text(row['share'])} of those with the fix"
            yield _row(f"branch {row['name']}, {row['where']}", row["rate"], told)
    laws = sorted(LAWS, key=lambda law: (law != result.planned_law, law))
    for law in (one for one in laws if _has_flights(result, one)):
        rate = deployed(result, law)
        yield _row("simulated flights of the plan", rate, f"{_sample(rate)}: {_causes(result, law)}")
    for law in (one for one in laws if f"mission_risk_{one}" in result.metrics):
        mission, collision = (result.metrics[f"{name}_risk_{law}"] for name in ("mission", "collision"))
        both = probability_text(mission), probability_text(collision)
        yield {
            "what": "upper bound for the plan", "law": law, "rate": _at_most(mission + collision),
            "interval": "", "source": f"{both[0]} for the mission (V), "
            f"{both[1]} for collisions (R); it guides the search",
        }  # fmt: skip


def _row(what: str, rate: Mapping[str, Any], source: str) -> dict[str, str]:
    return {
        "what": what, "law": rate["law"], "rate": probability_text(rate["failure"]),
        "interval": interval_text(rate["low"], rate["high"]), "source": source,
    }  # fmt: skip


def _causes(result: Evidence, law: str) -> str:
    accepted, collided, off = _flags(result, law)
    allowed = "" if result.ground.walled else " (allowed)"
    return (
        f"{int(collided.sum()):,} met an obstacle, {int((~accepted).sum()):,} missed the mission, "
        f"{int(off.sum()):,} left the map{allowed}"
    )


# --- limits ---------------------------------------------------------------------------------------


def step_times(result: Evidence) -> list[str]:
    """The time of every step: UTC, with the day where it is another one than the first."""
    stated = result.plan["time_utc"]
    if stated is None:
        return [f"{t / 3600:.2f} h" for t in result.plan["t"]]
    day = stated[0][:10]
    return [f"{one[11:16]}Z" if one[:10] == day else f"{one[5:10]} {one[11:16]}Z" for one in stated]


def titled(result: Evidence, barrier: str) -> str:
    """A barrier with the name that its obstacle has on the map."""
    kind, _, number = barrier.rpartition(" ")
    names = result.scene.get("obstacle_names") or []
    known = kind == "obstacle" and number.isdecimal() and 0 < int(number) <= len(names)
    name = names[int(number) - 1] if known else ""
    return f"{barrier} ({name})" if name else barrier


def small_change(result: Evidence) -> float:
    """The change of an outline [m] for which prices are shown: a power of ten."""
    side = float(np.ptp(np.array(result.scene["bounds"], float), axis=0).mean())
    return float(10.0 ** math.floor(math.log10(CHANGE * side)))


def metres_text(metres: float) -> str:
    """A change of an outline in words."""
    return f"{metres / 1e3:g} km" if metres >= 1e3 else f"{metres:g} m"


def points_text(saving: float) -> str:
    """A fall of a failure rate in percentage points."""
    return probability_text(saving).removesuffix(" %")


def epsilon_text(result: Evidence) -> str:
    """The limit of a segment."""
    return "no limit" if result.plan["epsilon"] >= 1.0 else probability_text(result.plan["epsilon"])


def limit_tables(result: Evidence) -> dict[str, Any] | None:
    """Rows and texts of the section on limits; None for a plan after an alarm."""
    plan, unit, unsure = result.plan, small_change(result), _unsure(result)
    if alarmed(result):
        return None
    promise, times = plan["promise"], step_times(result)
    rows = plan.get("segments") or []
    worst = sorted(range(len(rows)), key=lambda k: -rows[k]["probability"])[:CLOSEST]
    return {
        "fails": "" if promise is None else probability_text(promise["failure"]),
        "tight_price": probability_text(TIGHT_PRICE),
        "tight_risk": probability_text(TIGHT_RISK * plan["epsilon"]),
        "no_prices": unsure or NO_PRICES, "unsure": unsure, "no_segments": NO_SEGMENTS,
        "breach": _breach(result),
        "remedies": [
            {
                "change": one["change"], "worst": probability_text(one["worst_segment_probability"]),
                "fails": probability_text(one["failure"]), "runs": f"{one['runs']:,}",
            }
            for one in plan.get("remedies") or ()
        ],
        "prices": _price_rows(result, unit, times),
        "segments": [
            {
                "time": f"{times[k]}\u00a0– {times[k + 1]}", "barrier": titled(result, rows[k]["nearest"]),
                "deviations": f"{rows[k]['deviations']:.1f}",
                "probability": probability_text(rows[k]["probability"]), "allowed": epsilon_text(result),
            }
            for k in worst
        ],
    }  # fmt: skip


def _certain(price: Mapping[str, Any]) -> bool:
    return bool(price["saving"] >= CERTAIN * price.get("error", 0.0))


def _unsure(result: Evidence) -> str:
    prices = result.plan.get("prices") or []
    number = sum(not _certain(price) for price in prices)
    return f"{UNSURE}: {number} of {len(prices)}" if number else ""


def _price_rows(result: Evidence, unit: float, times: Sequence[str]) -> list[dict[str, str]]:
    faster, faster_text, rows = FASTER, "1 km/h", []
    if result.plan["u_max"] < SLOW:
        faster = 10.0 ** math.floor(math.log10(SLOW_CHANGE * result.plan["u_max"]))
        faster_text = f"{faster:g} m/s"
    for price in filter(_certain, result.plan.get("prices") or []):
        kind, name, step = price["kind"], price["name"], price["step"]
        size, text = (faster, faster_text) if kind == "airspeed" else (unit, metres_text(unit))
        limit = f"region {name}" if kind in ("region", "avoided") else titled(result, name)
        if kind == "airspeed":
            limit = name.replace(AIR.speed, medium_of(result).speed)
        row = {
            "limit": limit, "time": "–" if step is None else times[step],
            "change": CHANGES[kind].format(text), "saved": points_text(price["saving"] * size),
        }  # fmt: skip
        rows.append((price["saving"] * size, row))
    return [row for _, row in sorted(rows, key=lambda pair: -pair[0])]


def _breach(result: Evidence) -> str:
    plan = result.plan
    worst = plan.get("worst_segment")
    if plan.get("epsilon_kept", True) or worst is None:
        return ""
    k, promise = worst["step"], plan["promise"]
    begin, end = (f"{float(t) / 3600:,.2f} h" for t in plan["t"][k : k + 2])
    fails = ""
    if promise is not None:
        rate = rate_text(promise["failure"], promise["low"], promise["high"])
        fails = f"; it fails {rate}, {promise['law']} winds"
    return (
        f"no path keeps planner.epsilon = {probability_text(plan['epsilon'])}, and the plan is the path "
        f"nearest to it: segment {k + 1} of {len(plan['u'])}, {begin} to {end} after departure, collides "
        f"with a probability of {probability_text(worst['probability'])}, closest to "
        f"{titled(result, worst['nearest'])}{fails}"
    )


def tight_places(result: Evidence) -> list[dict[str, Any]]:
    """Segments with a large price or collision probability, and the lines about each."""
    plan, rows, times = result.plan, result.plan.get("segments"), step_times(result)
    if not rows:
        return []
    unit, law = small_change(result), f"{result.planned_law} {medium_of(result).flows}"
    prices = [row.get("price", 0.0) for row in rows]
    places = []
    for k, row in enumerate(rows):
        priced = prices[k] > TIGHT_PRICE * max(prices)
        if priced or row["probability"] > TIGHT_RISK * plan["epsilon"]:
            lines = [
                f"{titled(result, row['nearest'])}, {times[k]} to {times[k + 1]}",
                f"collides {allowed_text(row['probability'], plan['epsilon'])}, {law}",
            ]
            saved = points_text(prices[k] * unit)
            lines += [f"all barriers {metres_text(unit)} farther: {saved} points fewer failures"] * priced
            places.append({"step": k, "lines": lines})
    return places


# --- where it comes from --------------------------------------------------------------------------


def origin(result: Evidence) -> dict[str, Any]:
    """Command, facts, inputs and settings, from run.json and config_resolved.yaml."""
    run = result.run
    reported = {key.replace("_", " "): str(run[key]) for key in FACTS if run.get(key) is not None}
    git = run.get("git") or {}
    if git.get("commit"):
        reported["commit"] = f"{git['commit']}{' and changes' if git.get('changed') else ''}"
    packages = run.get("packages") or {}
    reported["packages"] = ", ".join(f"{name} {number}" for name, number in packages.items() if number)
    words = [str(word) for word in run.get("argv", ())]
    return {
        "command": shlex.join(["pareto-ltl", *words]) if words else "",
        "facts": reported,
        "inputs": {Path(name).name: str(digest) for name, digest in run["inputs"].items()},
        "settings": read_text(result.directory / "config_resolved.yaml"),
    }


def page_texts(result: Evidence, title: str) -> dict[str, Any]:
    """All texts of the page; the ``title``, which is the mission in words, is not derived."""
    plan = result.plan
    return {
        "name": result.settings["name"], "title": title, "formula": result.automaton["formula"], "why": "",
        "has_plan": True, "has_front": result.has("front.csv"), "facts": list(facts(result)),
        "verdicts": list(verdicts(result)), "limits": limit_tables(result),
        "medium": medium_of(result)._asdict(), "covered": plan.get("covered", ""),
        "not_covered": plan.get("not_covered", ""), "law": result.planned_law, "origin": origin(result),
    }  # fmt: skip
