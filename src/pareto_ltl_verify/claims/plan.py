"""Claims about the plan: motion, Gaussian, mission, obstacles, and the bounds on failure."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
from scipy.special import ndtri

from pareto_ltl.support.names import joined_names
from pareto_ltl_verify.claims.verdict import Claim, Verdict, no_fault, number, same, within
from pareto_ltl_verify.evidence import LAWS, Evidence
from pareto_ltl_verify.gaussians import step_margin, step_risk, theorem2
from pareto_ltl_verify.geometry import met_by_any
from pareto_ltl_verify.laws import Course

POSITION = 1e-3  # largest allowed difference of two positions, as a share of the grain
SPREAD = 1e-4  # largest allowed relative difference of two covariances; the planner stores modes in float32
RISK, LEAST_RISK = 2e-3, 1e-9  # largest allowed difference of two bounds, relative and absolute
FAST = 2e-6  # share of a limit by which rounding may carry an airspeed beyond it
TOUCH = 0.1  # how deep the expected path may lie in an obstacle by rounding, as a share of the grain
WEIGHTED = "importance sampling"  # the method of a failure rate from weighted flights
READS: dict[str, tuple[str, ...]] = {
    "worth": ("saving",),
    "priority": (),
    "weighted": (),
    "threshold": ("alpha",),
    "energy": ("alpha",),
    "least": ("alpha", "least"),
    "knee": (),
    "length": ("length",),
    "point": ("point",),
}  # settings, besides the weights, that each rule of this package reads
OBJECTIVES = {
    "length_m": "length", "mission_risk_paper": "mission_risk_paper", "mission_risk": "mission_risk",
    "collision_risk": "collision_risk", "mission_risk_ordered": "mission_risk_ordered",
}  # fmt: skip


# --- motion -----------------------------------------------------------------------------------


def shapes(result: Evidence) -> Verdict:
    """All arrays of plan.json have the shapes that follow from the number of its times."""
    plan, n = result.plan, len(result.plan["t"])
    wanted = {"x": (n, 2), "cov": (n, 2, 2), "q": (n,), "u": (n - 1, 2)}
    faults = [
        name
        for name, shape in wanted.items()
        if np.array(plan[name], float).reshape(len(plan[name]), *shape[1:]).shape != shape
    ]
    faults += ["label"] * (len(plan["label"]) != n)
    return no_fault(f"{n} positions", faults)


def settings_named(result: Evidence) -> Verdict:
    """The settings in plan.json are those that the run used."""
    plan, settings = result.plan, result.settings
    pairs = {
        "dt": (plan["dt"], result.robot.dt),  # with robot.dt=auto, dt of the metrics
        "u_max": (plan["u_max"], settings["robot"]["u_max"]),
        "u_min": (plan.get("u_min", 0.0), settings["robot"].get("u_min", 0.0)),
        "epsilon": (plan["epsilon"], result.epsilon),
        "rule": (plan["selection"]["rule"], settings["selection"]["rule"]),
        "weights": (plan["selection"]["weights"], settings["selection"]["weights"]),
        "rule's settings": _rule_settings(plan["selection"], settings["selection"]),
        "fidelity": (plan["fidelity"], result.run["fidelity"]),
    }
    return no_fault(", ".join(pairs), [f"{name} {a} is {b}" for name, (a, b) in pairs.items() if a != b])


def _rule_settings(claimed: Mapping[str, Any], settings: Mapping[str, Any]) -> tuple[dict[str, Any], ...]:
    """The settings that the rule read, by plan.json and by the settings of the run.

    ``READS`` lists them for the rules of this package; for a rule of another package, plan.json does.
    """
    read = {key: value for key, value in claimed.items() if key not in ("rule", "weights")}
    return read, {key: settings.get(key) for key in READS.get(settings["rule"], read)}


def fidelity_name(result: Evidence) -> Verdict:
    """The text of the fidelity names the preset and every setting that differs from the preset."""
    settings = result.settings["fidelity"]
    preset = {
        "paper": ("independent", "open", "theorem2", "step", "dominance", "convex", "bound"),
        "full": ("coherent", "wall", "ordered", "path", "mixed", "sampled", "flights"),
    }[settings["name"]]
    keys = ("law", "border", "mission_bound", "collision_bound", "parents", "refine", "judge")
    changed = [
        f"{key}={settings[key]}" for key, usual in zip(keys, preset, strict=True) if settings[key] != usual
    ]
    label = settings["name"] + (f" with {', '.join(changed)}" if changed else "")
    return same(result.run["fidelity"], label)


def start(result: Evidence) -> Verdict:
    """The plan begins at the start of the map, with the variance of the start."""
    gap = float(np.abs(result.x[0] - result.start).max())
    cov = np.abs(np.array(result.plan["cov"][0]) - result.robot.start_sd**2 * np.eye(2)).max()
    return within(str(result.start.tolist()), max(gap, math.sqrt(cov)), POSITION * result.grain, " m")


def times(result: Evidence) -> Verdict:
    """The time of step t is t dt [s]."""
    t = np.array(result.plan["t"], float)
    return within(
        f"{len(t) - 1} steps of {result.robot.dt:g} s",
        float(np.abs(t - result.robot.dt * np.arange(len(t))).max()),
        1e-6,
        " s",
    )


def motion(result: Evidence) -> Verdict:
    """x_{t+1} = A x_t + dt (B u_t + μ(x_t) and, in the coherent law, its second-order shift)."""
    robot, course = result.robot, result.course
    ahead = result.x[:-1] @ robot.a.T + robot.dt * (result.u @ robot.b.T + course.drift)
    gap = np.abs(ahead - result.x[1:]).max(initial=0.0)
    return within(f"{len(result.u)} steps, law {result.planned_law}", float(gap), 0.5 * result.grain, " m")


def airspeed(result: Evidence) -> Verdict:
    """Each control leaves the reserve that feedback needs, below u_max and above u_min."""
    robot, speed, left = result.robot, np.linalg.norm(result.u, axis=1), result.course.speed
    over = np.max(speed - left * (1 + FAST), initial=-math.inf)
    under = np.max(robot.least_speed(left) * (1 - FAST) - speed, initial=-math.inf)
    return Verdict(
        f"{robot.u_min:g} to {robot.u_max:g} m/s",
        f"{speed.min(initial=robot.u_max):.6g} to {speed.max(initial=0.0):.6g} m/s",
        bool(max(over, under) <= 1e-6 * robot.u_max),
    )


def covariance(result: Evidence) -> Verdict:
    """The covariance of every position, propagated from the start."""
    stated, computed = np.array(result.plan["cov"], float), result.course.cov
    size = np.maximum(np.trace(computed, axis1=1, axis2=2), 1e-6)
    worst = float((np.abs(stated - computed).max(axis=(1, 2)) / size).max())
    sd = math.sqrt(np.trace(stated[-1]) / 2)
    return Verdict(f"sd {sd / 1e3:.4g} km at the end", f"{worst:.1g} off", worst <= SPREAD)


def fixes(result: Evidence) -> Verdict:
    """The steps before whose ends the robot more probably than not measures its position."""
    return same(list(result.plan["fixes"]), sorted(t for t, p in result.course.chances.items() if p >= 0.5))


# --- mission and obstacles --------------------------------------------------------------------


def labels(result: Evidence) -> Verdict:
    """The label of every position is the set of regions around it."""
    faults = []
    either = [
        result.ground.labels(result.x, slack) for slack in (POSITION * result.grain, -POSITION * result.grain)
    ]
    for t, stated in enumerate(result.plan["label"]):
        if frozenset(stated) not in (result.labels[t], either[0][t], either[1][t]):
            faults.append(f"step {t} is {sorted(result.labels[t])}")
    return no_fault(f"{sum(map(bool, result.plan['label']))} steps in regions", faults)


def states(result: Evidence) -> Verdict:
    """The automaton states follow from the labels, and from harmful letters between steps."""
    slack = POSITION * result.grain
    either = [result.ground.states(result.x[None], s)[0] for s in (0.0, slack, -slack)]
    stated = np.array(result.plan["q"])
    faults = [f"state {either[0][t]} at step {t}" for t in np.flatnonzero(either[0] != stated)]
    if any(np.array_equal(one, stated) for one in either):
        faults = []
    return no_fault(f"states {sorted(set(result.plan['q']))}", faults)


def accepted(result: Evidence) -> Verdict:
    """The expected path completes the mission."""
    q = int(result.ground.states(result.x[None])[0, -1])
    return Verdict("mission complete", f"state {q}", bool(result.dfa.accepting[q]))


def clearance(result: Evidence) -> Verdict:
    """The expected path stays on the map and outside obstacles, also between steps."""
    (low, high), touch = result.ground.bounds, TOUCH * result.grain
    hit = met_by_any(result.obstacles, result.x[:-1], result.x[1:], touch)
    faults = [f"step {t} meets an obstacle" for t in np.flatnonzero(hit)]
    faults += ["it leaves the map"] * bool((result.x < low - touch).any() or (result.x > high + touch).any())
    return no_fault("clear of obstacles", faults)


def chance_constraint(result: Evidence) -> Verdict | None:
    """If bounds judge: Eqs. (9) and (10), or with the path bound a risk of at most epsilon in each step."""
    if result.settings["fidelity"]["judge"] != "bound":
        return None
    cov, parts = result.course.cov, result.barriers
    if result.settings["fidelity"]["collision_bound"] == "path":
        worst = step_risk(parts, result.x, cov)
        return Verdict(
            f"at most {result.epsilon:g} a step", f"{worst:.4g}", worst <= result.epsilon * (1 + RISK)
        )
    z = -float(ndtri(result.epsilon / max(len(parts), 1)))
    margin = step_margin(parts, result.x, cov, z)
    return Verdict(
        f"epsilon {result.epsilon:g}, {len(parts)} parts",
        f"{margin / 1e3:.4g} km to spare",
        margin >= -result.grain,
    )


# --- what it costs ----------------------------------------------------------------------------


def length(result: Evidence) -> Verdict:
    """Length of the expected path [m]."""
    computed = float(np.linalg.norm(np.diff(result.x, axis=0), axis=1).sum())
    return number(result.plan["objectives"]["length"], computed, rel=1e-9)


def energy(result: Evidence) -> Verdict | None:
    """Energy of the controls [J] and usable energy [J], both absent without a power curve."""
    stated, held = result.plan["objectives"].get("energy"), result.plan.get("capacity")
    if result.robot.power is None:
        return same([stated, held], [None, None])
    if held != result.robot.capacity:
        return same(held, result.robot.capacity)
    return number(math.nan if stated is None else stated, result.energy_of(result.u), rel=1e-9)


def _risk(claimed: float | None, computed: Callable[[], float]) -> Verdict | None:
    """``claimed`` is the bound ``computed``; a plan after an alarm of replanning claims none."""
    return None if claimed is None else number(claimed, computed(), rel=RISK, least=LEAST_RISK)


def _f_o(result: Evidence, course: Course) -> float:
    labels = result.letters_along([frozenset(label) for label in result.plan["label"]])
    return theorem2(result.visited, course.x, course.cov, labels)


def risk_of_paper(result: Evidence) -> Verdict | None:
    """f_o of Theorem 2 under the independent law."""
    claimed = result.plan["objectives"]["mission_risk_paper"]
    return _risk(claimed, lambda: _f_o(result, result.paper_course))


def ordered_bound(result: Evidence) -> Verdict | None:
    """V under the law of the plan."""
    claimed = result.plan["objectives"]["mission_risk_ordered"]
    return _risk(claimed, lambda: result.mission_bound(result.course))


def judged_risk(result: Evidence) -> Verdict | None:
    """The mission risk is the bound that the settings name, under the law of the plan."""
    ordered = result.settings["fidelity"]["mission_bound"] == "ordered"
    return _risk(
        result.plan["objectives"]["mission_risk"],
        lambda: result.mission_bound(result.course) if ordered else _f_o(result, result.course),
    )


def _between(claimed: float, bounds: tuple[float, float]) -> Verdict:
    low, high = bounds
    holds = low * (1 - RISK) - LEAST_RISK <= claimed <= high * (1 + RISK) + LEAST_RISK
    return Verdict(
        f"{claimed:.6g}", f"{low:.6g}" if high - low <= RISK * high else f"{low:.6g} to {high:.6g}", holds
    )


def collision_bound(result: Evidence) -> Verdict | None:
    """R under the law of the plan."""
    if result.plan["objectives"]["collision_risk"] is None:
        return None
    bounds = result.collision_bounds(result.law(result.planned_law), result.course)
    return _between(float(result.plan["objectives"]["collision_risk"]), bounds)


def allowed_collisions(result: Evidence) -> Verdict | None:
    """R is at most planner.delta, with the path bound and where bounds judge."""
    settings = result.settings["fidelity"]
    if settings["collision_bound"] != "path" or settings["judge"] != "bound":
        return None
    delta = result.settings["planner"]["delta"]
    return Verdict(
        f"at most {delta:g}",
        f"{result.plan['objectives']['collision_risk']:.4g}",
        result.plan["objectives"]["collision_risk"] <= delta,
    )


def forecast(law: str, judge: Callable[[Evidence, str], Verdict], result: Evidence) -> Verdict | None:
    """Verdict of ``judge`` on the planned controls under a wind law; None if the metrics lack that law."""
    return judge(result, law) if law in result.forecasts else None


def forecast_mission(result: Evidence, law: str) -> Verdict:
    """V of the controls under a law."""
    computed = result.mission_bound(result.forecasts[law])
    return number(result.metrics[f"mission_risk_{law}"], computed, rel=RISK, least=LEAST_RISK)


def forecast_collision(result: Evidence, law: str) -> Verdict:
    """R of the controls under a law."""
    bounds = result.collision_bounds(result.law(law), result.forecasts[law])
    return _between(float(result.metrics[f"collision_risk_{law}"]), bounds)


def forecast_spread(result: Evidence, law: str) -> Verdict:
    """Standard deviation of the position at the end under a law [m]."""
    computed = math.sqrt(float(np.trace(result.forecasts[law].cov[-1])) / 2)
    return number(result.metrics[f"end_sd_{law}_m"], computed, rel=SPREAD, least=POSITION * result.grain)


def forecast_laws(result: Evidence) -> Verdict:
    """The metrics have a forecast for each wind law of deployment.laws and for no other."""
    laws = result.settings["deployment"]["laws"] if "forecasts" in result.run["stages"] else []
    return same(sorted(result.forecasts), sorted(laws))


# --- copies -----------------------------------------------------------------------------------


def table(result: Evidence) -> Verdict:
    """plan.csv has the numbers of plan.json."""
    plan, rows, faults = result.plan, result.table("plan.csv"), []
    faults += [f"{len(rows)} rows"] * (len(rows) != len(plan["t"]))
    for t, row in enumerate(rows[: len(plan["t"])]):
        (xx, xy), (_, yy) = plan["cov"][t]
        u = plan["u"][t] if t < len(plan["u"]) else ["", ""]
        wanted = [
            t,
            plan["t"][t],
            *plan["x"][t],
            *u,
            xx,
            xy,
            yy,
            plan["q"][t],
            joined_names(plan["label"][t]),
        ]
        if [str(value) for value in wanted] != list(row.values()):
            faults.append(f"row {t}")
    return no_fault(f"{len(rows)} rows", faults)


def metrics(result: Evidence) -> Verdict:
    """The metrics of the plan agree with plan.json."""
    plan, told = result.plan, result.metrics
    stated = {name: plan["objectives"][key] for name, key in OBJECTIVES.items()}
    pairs = {name: value for name, value in stated.items() if value is not None or name in told}
    pairs |= {"steps": len(plan["u"]), "duration_s": plan["t"][-1] - plan["t"][0], "dt_s": plan["dt"]}
    if result.robot.power is not None:
        pairs |= {"energy_j": plan["objectives"].get("energy")}
        if result.robot.capacity is not None:
            pairs |= {"energy_share": plan["objectives"].get("energy", math.nan) / result.robot.capacity}
    if plan["promise"]:
        seen = plan["promise"]
        pairs |= {
            f"promise_{key}": seen[key] for key in ("failure", "low", "high", "runs", "bound", "passed")
        }
        pairs |= {"promise_claimed": seen["claimed"]["failure"], "linearity": seen["linearity"]}
        pairs |= {"promise_weighted": float(seen["method"] == WEIGHTED)}
    faults = [
        f"{name} {told.get(name)} is {value}" for name, value in pairs.items() if told.get(name) != value
    ]
    return no_fault(f"{len(pairs)} numbers of the plan", faults)


FILES = ("plan.json", "scene.json", "cells.json", "automaton.json", "wind.nc")
CLAIMS = (
    Claim("plan: arrays of one length", ("plan.json",), shapes),
    Claim("plan: settings it names", ("plan.json",), settings_named),
    Claim("plan: text of the fidelity", (), fidelity_name),
    Claim("plan: start", FILES, start),
    Claim("plan: times", FILES, times),
    Claim("plan: motion", FILES, motion),
    Claim("plan: airspeed", FILES, airspeed),
    Claim("plan: covariance", FILES, covariance),
    Claim("plan: position fixes", FILES, fixes),
    Claim("plan: labels", FILES, labels),
    Claim("plan: automaton states", FILES, states),
    Claim("plan: completes the mission", FILES, accepted),
    Claim("plan: clear of obstacles", FILES, clearance),
    Claim("plan: chance constraint of each step", FILES, chance_constraint),
    Claim("plan: length", FILES, length),
    Claim("plan: energy", ("plan.json",), energy),
    Claim("plan: f_o of Theorem 2", FILES, risk_of_paper),
    Claim("plan: ordered bound V", FILES, ordered_bound),
    Claim("plan: mission risk", FILES, judged_risk),
    Claim("plan: collision bound R", FILES, collision_bound),
    Claim("plan: R within planner.delta", FILES, allowed_collisions),
    Claim("plan: laws of the forecasts", FILES, forecast_laws),
    *(
        Claim(f"{law}: {name}", FILES, partial(forecast, law, judge))
        for law in LAWS
        for name, judge in (
            ("V of the controls", forecast_mission),
            ("R of the controls", forecast_collision),
            ("spread at the end", forecast_spread),
        )
    ),
    Claim("plan: plan.csv is plan.json", ("plan.json", "plan.csv"), table),
    Claim("plan: metrics", ("plan.json",), metrics),
)
