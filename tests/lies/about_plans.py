"""False values in the plan and its bounds."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

from careful_io.reading import read_json
from lies.editing import (
    Lie,
    both,
    in_json,
    in_metrics,
    in_plan,
    put,
    recosted,
    scaled,
    setting,
)
from pareto_ltl_verify.flights import clopper_pearson


def _shift_step(plan: dict[str, Any]) -> None:
    plan["x"][5][0] += 2000.0


def _cut_end(plan: dict[str, Any]) -> None:
    first = plan["q"].index(plan["q"][-1])  # the step that completes the mission
    for key in ("t", "x", "cov", "q", "label"):
        plan[key] = plan[key][:first]
    plan["u"] = plan["u"][: first - 1]


def _at_closest(plan: dict[str, Any], change: Callable[[dict[str, Any]], dict[str, Any]]) -> None:
    """Change the limits of the segment that is most likely to collide."""
    rows = plan["segments"]
    k = max(range(len(rows)), key=lambda k: rows[k]["probability"])
    rows[k] = change(rows[k])


def _other_barrier(plan: dict[str, Any], name: str) -> str:
    """A barrier that is the closest of another segment, or one that does not exist."""
    return next((row["nearest"] for row in plan["segments"] if row["nearest"] != name), "obstacle 99")


def _swap_label(plan: dict[str, Any]) -> None:
    place = next(t for t, label in enumerate(plan["label"]) if label == ["a"])
    plan["label"][place] = ["b"]


def _slow_clock(plan: dict[str, Any]) -> None:
    plan["dt"] = 3600.0
    plan["t"] = [2.0 * t for t in plan["t"]]


def _promised(**changes: Any) -> Callable[[Path], Any]:
    """Change the promise of the plan, and the metrics with it."""

    def edit(place: Path) -> None:
        in_plan(lambda plan: plan["promise"].update(changes))(place)
        names = ("failure", "low", "high", "runs", "bound", "passed")
        numbers = {f"promise_{name}": changes[name] for name in names if name in changes}
        if "method" in changes:
            numbers["promise_weighted"] = float(changes["method"] == "importance sampling")
        in_metrics(numbers)(place)

    return edit


def _other_failures(place: Path) -> None:
    """Raise the promised failures by a tenth of the flights, and the interval with them."""
    told = read_json(place / "plan.json")["promise"]
    count = round((told["failure"] + 0.1) * told["runs"])
    low, high = clopper_pearson(count, told["runs"])
    _promised(failure=count / told["runs"], low=low, high=high)(place)


def _other_claim(place: Path) -> None:
    """A claim with which the new flights agree."""

    def change(plan: dict[str, Any]) -> None:
        plan["promise"]["claimed"] |= {key: plan["promise"][key] for key in ("failure", "low", "high")}

    in_plan(change)(place)
    in_metrics({"promise_claimed": read_json(place / "plan.json")["promise"]["failure"]})(place)


def _turned(plan: dict[str, Any]) -> None:
    """Headings from grid north instead of true north."""
    plan["heading_true"] = [math.degrees(math.atan2(x, y)) % 360 for x, y in plan["u"]]


PROMISE = ("plan: promise by flights",)
PRICE_OF_LENGTH = {"kind": "length", "name": "length", "step": None, "saving": 1e-3}
EARTH = ("plan: positions and headings on Earth",)
PLAN_LIES = (
    Lie("the time step of the metrics is another", in_metrics({"dt_s": 900.0}), ("plan: metrics",)),
    Lie("a step is shifted", in_plan(_shift_step), ("plan: motion",)),
    Lie(
        "the flight is higher",
        in_plan(lambda p: p["height"].update(metres=p["height"]["metres"] + 100.0)),
        ("height: one for all",),
    ),
    Lie(
        "a place is left out that the flight meets",
        in_json("scene.json", lambda s: s.update(absent=[{"what": "obstacle 9", "floor": 0.0}])),
        ("height: one for all",),
    ),
    Lie(
        "the air is as dense as at the sea",
        in_plan(lambda p: p["air"].update(density_ratio=1.05)),
        ("height: air and calibrated airspeeds",),
    ),
    Lie(
        "the calibrated airspeeds are those of another height",
        in_plan(lambda p: p.update(airspeed_calibrated=[0.95 * v for v in p["airspeed_calibrated"]])),
        ("height: air and calibrated airspeeds",),
    ),
    Lie(
        "a control is faster than the robot",
        in_plan(lambda p: scaled(p, "u", 5, factor=3.0)),
        ("plan: airspeed",),
    ),
    Lie("the covariance is smaller", in_plan(lambda p: scaled(p, "cov", factor=0.9)), ("plan: covariance",)),
    Lie(
        "one covariance is smaller",
        in_plan(lambda p: scaled(p, "cov", 9, factor=0.99)),
        ("plan: covariance",),
    ),
    Lie(
        "a segment is less likely to collide",
        in_plan(lambda p: _at_closest(p, lambda row: row | {"probability": 0.9 * row["probability"]})),
        ("plan: limits of its segments",),
    ),
    Lie(
        "a barrier is farther away",
        in_plan(lambda p: _at_closest(p, lambda row: row | {"deviations": row["deviations"] + 0.1})),
        ("plan: limits of its segments",),
    ),
    Lie(
        "another barrier is the closest",
        in_plan(lambda p: _at_closest(p, lambda row: row | {"nearest": _other_barrier(p, row["nearest"])})),
        ("plan: limits of its segments",),
    ),
    Lie(
        "epsilon is not kept, as if no path kept it",
        both(in_plan(lambda p: p.update(epsilon_kept=False)), in_metrics({"epsilon_kept": 0.0})),
        ("plan: whether it keeps epsilon",),
        only="full",
    ),
    Lie(
        "the worst segment is less likely to collide",
        both(
            in_plan(lambda p: scaled(p, "worst_segment", "probability", factor=0.9)),
            in_json(
                "metrics.json",
                lambda m: m.update(worst_segment_probability=0.9 * m["worst_segment_probability"]),
            ),
        ),
        ("plan: whether it keeps epsilon",),
        only="full",
    ),
    Lie(
        "a segment has no limit",
        in_plan(lambda p: p["segments"].pop()),
        ("plan: limits of its segments",),
    ),
    Lie(
        "the largest price is ten times as high",
        in_plan(lambda p: put(p, "prices", 0, "saving", value=10.0 * p["prices"][0]["saving"])),
        ("plan: prices of its limits",),
    ),
    Lie(
        "the error of the largest price is a hundredth",
        in_plan(lambda p: put(p, "prices", 0, "error", value=0.01 * p["prices"][0]["error"])),
        ("plan: prices of its limits",),
    ),
    Lie(
        "a price is of an obstacle that is not there",
        in_plan(lambda p: put(p, "prices", 0, "name", value="obstacle 77")),
        ("plan: prices of its limits",),
    ),
    Lie(
        "a segment has a price of its own",
        in_plan(lambda p: _at_closest(p, lambda row: row | {"price": row["price"] + 1e-3})),
        ("plan: prices of its limits",),
    ),
    Lie(
        "the length has a price that the front has not",
        in_plan(lambda p: p["prices"].append(PRICE_OF_LENGTH)),
        ("plan: prices of its limits",),
    ),
    Lie("a label is another", in_plan(_swap_label), ("plan: labels",)),
    Lie("a state is another", in_plan(lambda p: put(p, "q", 3, value=1)), ("plan: automaton states",)),
    Lie("the plan ends too early", in_plan(_cut_end), ("plan: completes the mission",)),
    Lie("the start is another", in_plan(lambda p: scaled(p, "x", 0, factor=0.99)), ("plan: start",)),
    Lie("a time is another", in_plan(lambda p: put(p, "t", 4, value=7000.0)), ("plan: times",)),
    Lie("V is halved", recosted("mission_risk_ordered", 0.5), ("plan: ordered bound V",)),
    Lie("V is a hundredth less", recosted("mission_risk_ordered", 0.99), ("plan: ordered bound V",)),
    Lie("the mission risk is halved", recosted("mission_risk", 0.5), ("plan: mission risk",)),
    Lie("f_o is another", recosted("mission_risk_paper", 0.1), ("plan: f_o of Theorem 2",), only="paper"),
    Lie("R is zero", recosted("collision_risk", 0.0), ("plan: collision bound R",)),
    Lie("R is doubled", recosted("collision_risk", 2.0), ("plan: collision bound R",)),
    Lie("the length is shorter", recosted("length", 0.999), ("plan: length",)),
    Lie("the energy is less", recosted("energy", 0.99), ("plan: energy", "front: paths")),
    Lie("the battery is larger", in_plan(lambda p: p.update(capacity=3e8)), ("plan: energy",)),
    Lie(
        "the battery is larger everywhere",
        both(
            in_plan(lambda p: p.update(capacity=3.6e8)),
            setting(
                "robot",
                "power",
                {"kind": "wing", "base": 50.0, "drag": 0.02, "lift": 1000.0, "capacity": 100_000.0},
            ),
        ),
        ("run: fingerprint of the settings", "plan: metrics"),
    ),
    Lie("dt of the plan is another", in_plan(_slow_clock), ("plan: settings it names", "plan: times")),
    Lie(
        "dt is another everywhere",
        both(in_plan(_slow_clock), setting("robot", "dt", 3600.0)),
        ("plan: motion", "run: fingerprint of the settings"),
    ),
    Lie("u_max is raised", in_plan(lambda p: p.update(u_max=60.0)), ("plan: settings it names",)),
    Lie(
        "u_max is raised everywhere",
        both(in_plan(lambda p: p.update(u_max=60.0)), setting("robot", "u_max", 60.0)),
        ("run: fingerprint of the settings",),
    ),
    Lie("u_min is lowered", in_plan(lambda p: p.update(u_min=0.0)), ("plan: settings it names",)),
    Lie(
        "u_min is raised everywhere",
        both(in_plan(lambda p: p.update(u_min=29.5)), setting("robot", "u_min", 29.5)),
        ("plan: airspeed", "run: fingerprint of the settings"),
    ),
    Lie("epsilon is smaller", in_plan(lambda p: p.update(epsilon=0.001)), ("plan: settings it names",)),
    Lie(
        "the rule is another",
        in_plan(lambda p: put(p, "selection", "rule", value="weighted")),
        ("plan: settings it names",),
    ),
    Lie("a fix is made up", in_plan(lambda p: p.update(fixes=[3])), ("plan: position fixes",)),
    Lie(
        "plan.csv differs",
        lambda place: (place / "plan.csv").write_text(
            (place / "plan.csv").read_text().replace("1800.0", "1801.0")
        ),
        ("plan: plan.csv is plan.json",),
    ),
    Lie("the length of the metrics is another", in_metrics({"length_m": 1e6}), ("plan: metrics",)),
    Lie(
        "the fidelity has another name",
        both(
            in_plan(lambda p: p.update(fidelity="better")),
            in_json("run.json", lambda r: r.update(fidelity="better")),
        ),
        ("plan: text of the fidelity",),
    ),
    Lie("another share of fresh flights fails", _other_failures, ("plan: promised rate",), "full"),
    Lie(
        "the errors of analyses are covered",
        in_plan(lambda p: p.update(not_covered="the robot's own errors of airspeed, heading and timing.")),
        ("plan: errors that its rates cover",),
    ),
    Lie(
        "the departure by default is another hour",
        in_plan(
            lambda p: p.update(
                covered=p["covered"].replace("a departure at 2018-10-09T00", "a departure at 2018-10-09T03")
            )
        ),
        ("plan: errors that its rates cover",),
    ),
    Lie(
        "storms are covered",
        in_plan(lambda p: p.update(covered=p["covered"].removesuffix(".") + "; storms.")),
        ("plan: errors that its rates cover",),
    ),
    Lie("the promise is sharper", _promised(high=0.0), PROMISE, "full"),
    Lie("the promise has more runs", _promised(runs=10**6), PROMISE, "full"),
    Lie(
        "the promise holds in other winds",
        _promised(law="independent"),
        PROMISE,
        "full",
    ),
    Lie("the promise is of another method", _promised(method="prayer"), PROMISE, "full"),
    Lie(
        "weighted flights often fail",
        _promised(method="importance sampling", failure=0.05, low=0.04, high=0.06),
        PROMISE,
        "full",
    ),
    Lie(
        "weighted flights hardly ever fail",
        _promised(method="importance sampling", failure=1e-8, low=0.9e-8, high=1.1e-8),
        ("plan: promised rate",),
        "full",
    ),
    Lie("the bound is another", _promised(bound=0.01), PROMISE, "full"),
    Lie("the linearity is another", _promised(linearity=1e-3), PROMISE, "full"),
    Lie("the claim did not stand", _promised(passed=False), PROMISE, "full"),
    Lie("the claim is another", _other_claim, PROMISE, "full"),
    Lie(
        "the promise is left out",
        in_plan(lambda p: p.update(promise=None)),
        PROMISE,
        "full",
    ),
    Lie(
        "a promise is made up",
        in_plan(lambda p: p.update(promise={"law": "independent", "failure": 0.0, "runs": 1})),
        PROMISE,
        "paper",
    ),
    Lie("a model is another", in_plan(lambda p: put(p, "models", "law", value="calm")), ("plan: models",)),
    Lie("headings are relative to the grid", in_plan(_turned), EARTH),
    Lie(
        "a place on Earth is another",
        in_plan(lambda p: scaled(p, "lat", 4, factor=1.00001)),
        EARTH,
    ),
    Lie(
        "the plane is another",
        in_plan(lambda p: p.update(crs=None)),
        EARTH,
    ),
    Lie(
        "an airspeed is lower",
        in_plan(lambda p: scaled(p, "airspeed", 2, factor=0.9)),
        ("plan: airspeed of each step",),
    ),
    Lie(
        "the hour is another",
        in_plan(lambda p: put(p, "time_utc", 3, value=p["time_utc"][2])),
        ("plan: times in UTC",),
    ),
    Lie(
        "the limit of the rule is another",
        in_plan(lambda p: put(p, "selection", "alpha", value=0.5)),
        ("plan: settings it names",),
    ),
    Lie(
        "V of the other law",
        in_json("metrics.json", lambda m: m.update(mission_risk_coherent=m["mission_risk_independent"])),
        ("coherent: V of the controls",),
    ),
    Lie(
        "R of the other law",
        in_json("metrics.json", lambda m: m.update(collision_risk_coherent=m["collision_risk_independent"])),
        ("coherent: R of the controls",),
    ),
    Lie(
        "a narrow end",
        in_json("metrics.json", lambda m: m.update(end_sd_coherent_m=m["end_sd_independent_m"])),
        ("coherent: spread at the end",),
    ),
)
