"""The sentences of exported files: those that the records give are taken away, and what is left is named."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from typing import Any

from careful_io.texts import listed_text, rate_text
from pareto_ltl_verify import page_texts
from pareto_ltl_verify.claims import close
from pareto_ltl_verify.claims.exports import TABLE, column
from pareto_ltl_verify.evidence import Evidence

TURNS = re.compile(
    r"Turns take (\d+) s, which the times of the legs include\. They lead up to (\d+) m away from the "
    r"straight lines between the positions, which the failure rates leave out\."
)
HOLDS = "by an autopilot that knows and holds the positions (robot.feedback_time=60)"
BY_POSITION = "An autopilot flies this mission by position."
NO_LANDING = ("Take-off and landing are not part of it.", "A landing is not part of it.")
HOVERS = (
    "The last item hovers at the end of the plan until the pilot takes over; the energy of the plan is "
    "without it."
)
NO_BORDER = "The border of the map is no fence, since the 180th meridian crosses it."
ABSENT = "Above or below it, and not on this map: "
SENTENCE = re.compile(r"Of [\d,]+ [^%]*flights flown .*? fail\.")  # another claim compares its numbers


def flown_by(result: Evidence) -> str:
    """How the robot follows the plan, in the words of files."""
    robot, time = result.robot, result.settings["robot"].get("feedback_time")
    fixes = " and fixes at landmarks" if result.plan["fixes"] else ""
    held = f" and feedback (robot.feedback_time={time:g} s)" if robot.feedback and time else ""
    return f"by heading and {page_texts.medium_of(result).speed}{fixes}{held}"


def height_sentences(result: Evidence) -> Iterator[str]:
    """The height of the flight and its two airspeeds, by the records that other claims judge."""
    height, air = result.plan.get("height"), result.plan.get("air")
    if height is None:
        return
    metres, flow = round(height["metres"], 1), page_texts.medium_of(result).flow
    place = "mean sea level" if height["above_sea"] else "the ground"
    text = f"{-metres:g} m below the surface" if metres < 0.0 else f"{metres:g} m above {place}"
    source = "" if height["stated"] else f", the level of the {flow}, as robot.level is not set"
    yield f"Height {text}{source}."
    if air is not None:
        factor = 1.0 / math.sqrt(air["density_ratio"])
        yield f"True airspeed is {factor:.4f} times calibrated airspeed ({air['source']})."


def absent_sentence(result: Evidence) -> str:
    """The places of the map that are above or below the flight; empty if there are none."""
    if not result.scene.get("absent"):
        return ""
    return f"{ABSENT}{listed_text([place['what'] for place in result.scene.get('absent') or ()])}."


def height_text(result: Evidence) -> str:
    """What files say of the height of the flight and of places above and below it."""
    return " ".join(filter(None, [*height_sentences(result), absent_sentence(result)]))


def branch_sentences(result: Evidence) -> Iterator[str]:
    """What files say of a plan that branches: when, into what, and how often it fails."""
    tree = result.plan.get("branches")
    if tree is None:
        return
    yield from _selected(
        tree, _moment(result, tree["fix"]["step"], result.plan["time_utc"]), "At", "the plan"
    )
    for row in tree["branches"]:
        if (then := row.get("branches")) is not None:
            k = then["fix"]["step"] - tree["fix"]["step"]
            table = f"branch_{row['name']}.csv"
            when = _moment(result, then["fix"]["step"], row["time_utc"], k, table)
            name = f"branch {row['name']}"
            yield from _selected(then, when, f"On {name}, at", name)
    shares = [rate_text(rate["failure"], rate["low"], rate["high"]) for rate in (tree["rate"], tree["alone"])]
    yield (
        f"Of {tree['rate']['runs']:,} flights with these branches, {shares[0]} fail; of the same flights "
        f"without the fix, {shares[1]}."
    )


def _moment(
    result: Evidence, step: int, times: list[str] | None, k: int | None = None, table: str = TABLE
) -> str:
    """The time of ``step``, row ``k`` of ``times`` and of ``table``; turns move the times of legs."""
    k = step if k is None else k
    if result.robot.bank > 0.0 and result.has(table):
        rows = result.table(table)
        return rows[k]["time_utc"] or f"{column(rows, 't_s')[k]:g} s"
    return f"{step * result.robot.dt:g} s" if times is None else times[k]


def _selected(tree: dict[str, Any], moment: str, begin: str, what: str) -> Iterator[str]:
    """What files say of a fix; ``what`` is flown without it."""
    letters = [row["name"] for row in tree["branches"]]
    which = f"one of the branches {', '.join(letters[:-1])} and {letters[-1]}"
    which = which if letters[1:] else f"branch {letters[0]}"
    yield f"{begin} {moment} a position fix selects {which}; without it, {what} goes on."
    for row in tree["branches"]:
        yield f"Branch {row['name']}: the measured position is {row['where']}."
    if steps := tree["fix"].get("rejoin_steps", 0):
        t = tree["branches"][0]["t"]
        seconds = round(steps * (t[1] - t[0]))
        later = 1e3 * tree["fix"].get("counter_per_s", 0.0)
        rate = f"{1e3 / (steps * (t[1] - t[0])) + later:.3g} m/s"
        against = f"; from then on {later:.3g} m/s, against further drift" if later else ""
        yield (
            "The distance of the measured position from the planned one is flown off in the "
            f"{seconds // 3600}:{seconds % 3600 // 60:02d}:{seconds % 60:02d} after the fix: for each "
            f"kilometre ahead of it the velocity through the air is {rate} less along the planned track, for "
            f"each kilometre left of it {rate} more to the right, within the airspeeds of the robot{against}."
        )


def known_sentences(result: Evidence, name: str) -> Iterator[str]:
    """Every sentence, besides the rates, that a file may have."""
    plan, law = result.plan, result.planned_law
    yield f"Mission {plan['formula']}."
    yield f"{page_texts.ALARM.capitalize()}."
    yield from height_sentences(result)
    gap = page_texts.level_gap(result)
    yield from [f"The failure rates are no promise: {gap}."] * bool(gap)
    if (promise := plan["promise"]) is not None and promise["failure"] < promise.get("floor", 0.0):
        yield f"Promised: {page_texts.promised(promise)}."
    yield from branch_sentences(result)
    yield absent_sentence(result)
    yield f"Not covered: {plan.get('not_covered', '').rstrip('.')}."
    if name == "mission.plan":
        yield from (BY_POSITION, *NO_LANDING, HOVERS, NO_BORDER)
    yield from (f"95 % of whole flights in {law} {flow} stay in these volumes." for flow in result.flows)


def left_over(result: Evidence, name: str, text: str) -> str:
    """What is left of the ``text`` of a file without its known sentences; empty if nothing is."""
    text = " ".join(text.split())
    for sentence in sorted(known_sentences(result, name), key=len, reverse=True):
        text = text.replace(" ".join(sentence.split()), "", 1)
    turns = TURNS.search(text)
    if turns is not None and result.robot.bank > 0.0 and _late(result, float(turns[1])):
        text = text.replace(turns[0], "", 1)
    for sentence in SENTENCE.findall(text):
        text = text.replace(sentence, "", 1)
    return " ".join(text.split())


def _late(result: Evidence, stated: float) -> bool:
    """Whether the legs of the table last longer than the steps of the plan by so many seconds, rounded."""
    if not result.has(TABLE):
        return True
    t, plan = column(result.table(TABLE), "t_s"), result.plan["t"]
    return close(stated, float(t[-1] - t[0]) - (plan[-1] - plan[0]), 0.0, 0.51)
