"""Claims about the plan: motion, Gaussian, mission, obstacles, and the bounds on failure."""

from __future__ import annotations

import math
from collections.abc import Callable
from datetime import UTC, datetime
from functools import partial

import numpy as np
from scipy.special import ndtri

from careful_io.names import joined_names
from pareto_ltl_verify.claims import Claim, Verdict, no_fault, number, same, unlike, within
from pareto_ltl_verify.evidence import LAWS, Evidence
from pareto_ltl_verify.gaussians import step_margins, step_risk
from pareto_ltl_verify.geometry import azimuths, met_by_any, on_earth

ROUNDING = 1e-6  # share of what the robot's own errors explain of the start's variance
POSITION = 1e-3  # largest allowed difference of two positions, as a share of the grain
SPREAD = 1e-4  # largest allowed relative difference of two covariances; the planner stores modes in float32
RISK, LEAST_RISK = 2e-3, 1e-9  # largest allowed difference of two bounds, relative and absolute
FAST = 2e-6  # share of a limit by which rounding may carry an airspeed beyond it
TOUCH = 0.1  # how deep the expected path may lie in an obstacle by rounding, as a share of the grain
PLACE, ANGLE = 1e-9, 1e-3  # [deg] largest allowed difference of two coordinates and of two headings
LATE = 1e-5  # [s] largest allowed difference of two times
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
}  # fmt: skip - settings, besides the weights, that each rule of this package reads
OBJECTIVES = {
    "length_m": "length", "mission_risk_paper": "mission_risk_paper", "mission_risk": "mission_risk",
    "collision_risk": "collision_risk", "mission_risk_ordered": "mission_risk_ordered",
}  # fmt: skip
PRESETS = {
    "paper": ("independent", "open", "theorem2", "step", "convex", "bound"),
    "full": ("coherent", "wall", "ordered", "path", "sampled", "flights"),
}
OF_PRESETS = ("law", "border", "mission_bound", "collision_bound", "refine", "judge")


def utc(text: str) -> datetime:
    """The time of an ISO text, which is in UTC where it names no zone."""
    time = datetime.fromisoformat(text)
    return time if time.tzinfo else time.replace(tzinfo=UTC)


# --- motion -----------------------------------------------------------------------------------


def shapes(result: Evidence) -> Verdict:
    """All arrays of plan.json have the shapes that follow from the number of its times."""
    plan, n = result.plan, len(result.plan["t"])
    wanted = {"x": (n, 2), "cov": (n, 2, 2), "q": (n,), "u": (n - 1, 2)}
    arrays = {key: np.array(plan[key], float).reshape(len(plan[key]), *wanted[key][1:]) for key in wanted}
    faults = {"label": len(plan["label"]) != n}
    return no_fault(f"{n} positions", faults, (key for key in wanted if arrays[key].shape != wanted[key]))


def settings_named(result: Evidence) -> Verdict:
    """The settings in plan.json are those that the run used.

    ``READS`` lists what the rules of this package read; for a rule of another package, plan.json does.
    """
    plan, chosen, robot = result.plan, result.settings["selection"], result.robot
    read = {key: value for key, value in plan["selection"].items() if key not in ("rule", "weights")}
    wanted = {
        "dt": robot.dt,  # with robot.dt=auto, dt of the metrics
        "u_max": robot.u_max, "u_min": robot.u_min, "epsilon": result.epsilon, "rule": chosen["rule"],
        "weights": chosen["weights"],
        "rule's settings": {key: chosen.get(key) for key in READS.get(chosen["rule"], read)},
        "fidelity": result.run["fidelity"],
    }  # fmt: skip
    claimed = {"u_min": 0.0, "rule's settings": read} | plan | plan["selection"]
    return no_fault(", ".join(wanted), unlike(claimed, wanted))


def fidelity_name(result: Evidence) -> Verdict:
    """The text of the fidelity names the preset and every setting that differs from the preset."""
    settings = result.settings["fidelity"]
    preset = dict(zip(OF_PRESETS, PRESETS[settings["name"]], strict=True))
    changed = [f"{key}={settings[key]}" for key, usual in preset.items() if settings[key] != usual]
    label = settings["name"] + (f" with {', '.join(changed)}" if changed else "")
    return same(result.run["fidelity"], label)


def models(result: Evidence) -> Verdict:
    """The models of the plan agree with the settings."""
    settings = {key: value for key, value in result.settings["fidelity"].items() if key != "name"}
    return same(result.plan["models"], settings)


def start(result: Evidence) -> Verdict:
    """The plan begins at the start of the map, with the variance of the start."""
    gap = float(np.abs(result.x[0] - result.start).max())
    lean = result.law(result.planned_law).errors.start
    wanted = result.robot.start_sd**2 * np.eye(2) + lean @ lean.T
    off = np.abs(np.array(result.plan["cov"][0]) - wanted).max() - ROUNDING * float(np.trace(lean @ lean.T))
    worst = max(gap, math.sqrt(max(off, 0.0)))
    return within(str(result.start.tolist()), worst, POSITION * result.grain, " m")


def times(result: Evidence) -> Verdict:
    """The time of step t is t dt [s]."""
    t, dt = np.array(result.plan["t"], float), result.robot.dt
    return within(f"{len(t) - 1} steps of {dt:g} s", np.abs(t - dt * np.arange(len(t))).max(), 1e-6, " s")


def airspeeds(result: Evidence) -> Verdict:
    """The airspeed of each step is the length of its control."""
    stated, computed = np.array(result.plan["airspeed"], float), np.linalg.norm(result.u, axis=1)
    if stated.shape != computed.shape:
        return same(len(stated), len(computed))
    faults = [f"step {t}" for t in np.flatnonzero(np.abs(stated - computed) > 1e-9 * (1 + computed))]
    return no_fault(f"{len(stated)} steps", faults)


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
    slack = POSITION * result.grain
    right = [result.labels, *(result.ground.labels(result.x, s) for s in (slack, -slack))]
    faults = [
        f"step {t} is {sorted(result.labels[t])}"
        for t, stated in enumerate(result.plan["label"])
        if frozenset(stated) not in [one[t] for one in right]
    ]
    return no_fault(f"{sum(map(bool, result.plan['label']))} steps in regions", faults)


def states(result: Evidence) -> Verdict:
    """The automaton states follow from the labels, and from harmful letters between steps."""
    slack, stated = POSITION * result.grain, np.array(result.plan["q"])
    right = [result.ground.states(result.x[None], s)[0] for s in (0.0, slack, -slack)]
    faults = [f"state {right[0][t]} at step {t}" for t in np.flatnonzero(right[0] != stated)]
    agrees = any(np.array_equal(one, stated) for one in right)
    return no_fault(f"states {sorted(set(result.plan['q']))}", [] if agrees else faults)


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


def step_deviations(result: Evidence) -> float:
    """z of Eqs. (9) and (10): each convex part has an equal share of epsilon."""
    return -float(ndtri(result.epsilon / max(len(result.barriers), 1)))


def chance_constraint(result: Evidence) -> Verdict | None:
    """If bounds judge: Eqs. (9) and (10), or with the path bound a risk of at most epsilon in each step."""
    fidelity, epsilon = result.settings["fidelity"], result.epsilon
    if fidelity["judge"] != "bound":
        return None
    cov, parts = result.course.cov, result.barriers
    if fidelity["collision_bound"] == "path":
        worst = step_risk(parts, result.x, cov)
        return Verdict(f"at most {epsilon:g} a step", f"{worst:.4g}", worst <= epsilon * (1 + RISK))
    margin = float(step_margins(parts, result.x, cov, step_deviations(result)).min(initial=np.inf))
    left = f"{margin / 1e3:.4g} km to spare"
    return Verdict(f"epsilon {epsilon:g}, {len(parts)} parts", left, margin >= -result.grain)


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
    return number(stated, math.fsum(result.robot.spent(result.u)), rel=1e-9)


def risk(name: str, computed: Callable[[Evidence], float], result: Evidence) -> Verdict | None:
    """An objective is a bound; a plan after an alarm of replanning claims none."""
    claimed = result.plan["objectives"][name]
    return None if claimed is None else number(claimed, computed(result), rel=RISK, least=LEAST_RISK)


def _labels(result: Evidence) -> list[frozenset[str]]:
    return [frozenset(label) for label in result.plan["label"]]


def _between(claimed: float, bounds: tuple[float, float]) -> Verdict:
    low, high = bounds
    holds = low * (1 - RISK) - LEAST_RISK <= claimed <= high * (1 + RISK) + LEAST_RISK
    narrow = high - low <= RISK * high
    return Verdict(f"{claimed:.6g}", f"{low:.6g}" if narrow else f"{low:.6g} to {high:.6g}", holds)


def collision_bound(result: Evidence) -> Verdict | None:
    """R under the law of the plan."""
    claimed = result.plan["objectives"]["collision_risk"]
    if claimed is None:
        return None
    return _between(claimed, result.collision_bounds(result.law(result.planned_law), result.course))


def allowed_collisions(result: Evidence) -> Verdict | None:
    """R is at most planner.delta, with the path bound and where bounds judge."""
    settings, delta = result.settings["fidelity"], result.settings["planner"]["delta"]
    if settings["collision_bound"] != "path" or settings["judge"] != "bound":
        return None
    claimed = result.plan["objectives"]["collision_risk"]
    return Verdict(f"at most {delta:g}", f"{claimed:.4g}", claimed <= delta)


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


# --- on the Earth -----------------------------------------------------------------------------


def clock_times(result: Evidence) -> Verdict:
    """Times in UTC count from the departure of the map."""
    zero, stated, t = result.scene["time_zero"], result.plan["time_utc"], result.plan["t"]
    if zero is None or stated is None:
        return same(stated, zero)
    begin = utc(zero)
    late = [abs((utc(text) - begin).total_seconds() - at) for text, at in zip(stated, t, strict=False)]
    faults = [f"step {k}" for k, gap in enumerate(late) if gap > LATE]
    return no_fault(
        f"{stated[0]} to {stated[-1]}", [f"{len(stated)} times"] * (len(stated) != len(t)), faults
    )


def places(result: Evidence) -> Verdict:
    """Longitudes, latitudes and headings follow from the plane positions and the controls."""
    plan, crs = result.plan, result.scene["crs"]
    if crs is None or plan["crs"] != crs:
        return same([plan[key] for key in ("crs", "lat", "lon", "heading_true")], [crs] * 4)
    stated, computed = np.array([plan["lon"], plan["lat"]], float), on_earth(crs, result.x)
    if stated.shape != computed.shape:
        return same(stated.shape, computed.shape)
    moved = np.flatnonzero(np.abs(stated - computed).max(axis=0) > PLACE)
    azimuth = azimuths(crs, result.x[:-1], result.u)
    heading = np.array(plan["heading_true"], float)  # null becomes NaN
    gap = np.abs((heading - azimuth + 180.0) % 360.0 - 180.0)
    turned = np.flatnonzero(np.where(result.u.any(axis=1), ~(gap <= ANGLE), ~np.isnan(heading)))
    return no_fault(
        f"{stated.shape[1]} positions",
        [f"step {t}: position" for t in moved],
        [f"step {t}: heading {heading[t]:.4g} is {azimuth[t] % 360:.4g}" for t in turned],
    )


# --- copies -----------------------------------------------------------------------------------


def table(result: Evidence) -> Verdict:
    """plan.csv has the numbers of plan.json."""
    plan, rows = result.plan, result.table("plan.csv")
    controls = [*plan["u"], ["", ""]]
    columns = zip(plan["t"], plan["x"], controls, plan["cov"], plan["q"], plan["label"], strict=False)
    wanted = [
        [t, time, *x, *u, xx, xy, yy, q, joined_names(label)]
        for t, (time, x, u, ((xx, xy), (_, yy)), q, label) in enumerate(columns)
    ]
    pairs = zip(rows, wanted, strict=False)
    faults = [f"row {t}" for t, (row, own) in enumerate(pairs) if list(row.values()) != list(map(str, own))]
    return no_fault(f"{len(rows)} rows", {f"{len(rows)} rows": len(rows) != len(wanted)}, faults)


def metrics(result: Evidence) -> Verdict:
    """The metrics of the plan agree with plan.json."""
    plan, reported, robot, seen = result.plan, result.metrics, result.robot, result.plan["promise"]
    stated = {name: plan["objectives"][key] for name, key in OBJECTIVES.items()}
    wanted = {name: value for name, value in stated.items() if value is not None or name in reported}
    wanted |= {"steps": len(plan["u"]), "duration_s": plan["t"][-1] - plan["t"][0], "dt_s": plan["dt"]}
    if robot.power is not None:
        wanted["energy_j"] = plan["objectives"].get("energy")
        if robot.capacity is not None:
            wanted["energy_share"] = plan["objectives"].get("energy", math.nan) / robot.capacity
    if (tree := plan.get("branches")) is not None:
        wanted |= {f"branches_{key}": tree["rate"][key] for key in ("failure", "low", "high", "runs")} | {
            "branches": len(tree["branches"]), "branches_length_m": tree["length"],
            "branches_alone_failure": tree["alone"]["failure"],
        }  # fmt: skip
    if seen:
        same_names = ["failure", "low", "high", "runs", "bound", "passed", *({"floor"} & set(seen))]
        wanted |= {f"promise_{key}": seen[key] for key in same_names} | {
            "promise_claimed": seen["claimed"]["failure"], "linearity": seen["linearity"],
            "promise_weighted": float(seen["method"] == WEIGHTED),
        }  # fmt: skip
    return no_fault(f"{len(wanted)} numbers of the plan", unlike(reported, wanted))


FILES = ("plan.json", "scene.json", "cells.json", "automaton.json", "wind.nc")
CLAIMS: tuple[Claim, ...] = (
    Claim("plan: arrays of one length", ("plan.json",), shapes),
    Claim("plan: settings it names", ("plan.json",), settings_named),
    Claim("plan: text of the fidelity", (), fidelity_name),
    Claim("plan: models", ("plan.json",), models),
    Claim("plan: start", FILES, start),
    Claim("plan: times", FILES, times),
    Claim("plan: airspeed of each step", ("plan.json",), airspeeds),
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
    *(
        Claim(f"plan: {name}", FILES, partial(risk, key, bound))
        for name, key, bound in (
            ("f_o of Theorem 2", "mission_risk_paper", lambda r: r.paper_bound(r.paper_course, _labels(r))),
            ("ordered bound V", "mission_risk_ordered", lambda r: r.mission_bound(r.course)),
            ("mission risk", "mission_risk", lambda r: r.judged_bound(r.course, _labels(r))),
        )
    ),
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
    Claim("plan: times in UTC", ("plan.json", "scene.json"), clock_times),
    Claim("plan: positions and headings on Earth", ("plan.json", "scene.json"), places),
    Claim("plan: plan.csv is plan.json", ("plan.json", "plan.csv"), table),
    Claim("plan: metrics", ("plan.json",), metrics),
)
