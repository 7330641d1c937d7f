"""Claims about a plan made during a flight: its start, fixes, wind, alarms, and the rest of the old plan.

What follows from the old plan is judged if it still is in the directory that ``replan.json`` names.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from careful_io.errors import UserError
from pareto_ltl_verify import laws
from pareto_ltl_verify.arrays import FloatArray
from pareto_ltl_verify.claims import Claim, Verdict, close, likely, no_fault, same, within
from pareto_ltl_verify.evidence import Evidence, open_evidence
from pareto_ltl_verify.flights import RARE, fly, same_rate
from pareto_ltl_verify.laws import Course
from pareto_ltl_verify.robot import Errors
from pareto_ltl_verify.wind_law import ErrorLaw
from pareto_ltl_verify.wind_tables import ENSEMBLE, HELD, SPACE, TIME, WindFile, square_of

OLD_PLAN, OLD_LAW = "replan: the rest of the old plan", "replan: law of forecast errors"
OF_THE_FIXES = (
    "replan: position given the fixes",
    "replan: expected wind given the fixes",
    "replan: the robot's own errors given the fixes",
)
UNLIKELY = 1e-4  # probability under the law of the plan below which a fix is an alarm
FAR = math.sqrt(-2.0 * math.log(UNLIKELY))  # the same as a distance of two components [sd]
RISKS = ("mission_risk_paper", "mission_risk", "mission_risk_ordered", "collision_risk")
OF_RATES = ("promise_", "failure_", "least_failure", "mission_risk_i", "mission_risk_c", "collision_risk_")
RUNS = 4000  # new flights of each of the two plans
ROUNDING = 1e-6  # share of a variance that rounding may leave in a difference
SHARE = 2e-3  # largest allowed relative difference of covariances and distances
NEAR = 1e-6  # [sd] shorter distances of fixes count as this one
WIND = 0.05  # m/s, largest allowed difference of the expected wind


def flown_result(result: Evidence) -> Evidence | None:
    """The result that was flown; None if it is not at the place that ``replan.json`` names.

    Another person may have written the name, so that only a plan with the SHA-256 in ``run.json`` is opened.
    """
    place = Path(result.replanned["source"])
    if not result.is_input(place / "plan.json"):
        return None
    try:
        return open_evidence(place)
    except (UserError, OSError):
        return None


def start(result: Evidence) -> Verdict:
    """The rest begins at the mean position, with its spread, at the time of the step.

    ``start_sd`` is the largest standard deviation of what the robot's own errors do not explain.
    """
    stated, robot = result.replanned, result.robot
    position, rest, step = stated["position"], stated["rest"], stated["step"]
    lean = result.law(result.planned_law).errors.start
    cov = np.array(position["cov"])
    widest = max(float(np.linalg.eigvalsh(cov - lean @ lean.T)[-1]), 0.0)  # [m²]
    slack = 1e-6 + ROUNDING * float(np.trace(cov))
    faults = {
        "time": not close(stated["time_s"], step * robot.dt),
        "start of the map": not np.allclose(result.start, position["mean"], rtol=1e-9, atol=1e-3),
        f"start_sd {robot.start_sd:g}": not close(robot.start_sd**2, widest, 1e-6, slack),
        "the rest begins elsewhere": len(rest["x"]) != len(rest["u"]) + 1,
    }
    return no_fault(f"step {step}", faults)


def alarms(result: Evidence) -> Verdict:
    """A fix that the law gives less than 1e-4 is an alarm; after an alarm no file has a probability."""
    stated, plan = result.replanned, result.plan
    count = len(stated["alarms"])
    unlikely = sum(fix["distance"] > FAR for fix in stated["fixes"])
    risks = [plan["objectives"][name] for name in RISKS]
    faults = {f"{unlikely} unlikely fixes": count < unlikely}
    if count:
        promised = [plan["promise"], *(stated[name] for name in ("old", "new", "difference"))]
        faults |= {
            "an alarm without a reason": not unlikely and stated["wind"] is None,
            "a promise after an alarm": any(value is not None for value in promised),
            "bounds after an alarm": any(risk is not None for risk in risks),
            **{name: result.has(name) for name in ("front.csv", "front.npz", "deployments.npz")},
            **{name: name.startswith(OF_RATES) for name in result.metrics},
        }
    else:
        faults["no bounds, but no alarm"] = None in risks
    return no_fault(f"{count} alarms", faults)


def rates(result: Evidence) -> Verdict | None:
    """Both plans fail as often as their new flights in wind.nc; the difference follows from the rates.

    The rest of the old plan has no rate if it lasts longer than a newer forecast.
    """
    stated = result.replanned
    if stated["alarms"]:
        return None
    old, new, rest, chance = stated["old"], stated["new"], stated["rest"], 1.0
    if old is None and (len(rest["u"]) - 1) * result.robot.dt <= result.wind.until + 1e-6:
        return Verdict("no rate of the old plan", "its winds are known", False)
    paths = ((old, np.array(rest["x"]), np.array(rest["u"])), (new, result.x, result.u))
    for number, (rate, means, u) in enumerate(paths):
        if rate is None:
            continue
        law = result.law(rate["law"], len(u))
        if law.robot.feedback or law.landmarks:
            return None
        x = means + (result.start - means[0])
        flown = fly(law, x, u, RUNS, np.random.default_rng([20181012, number]))
        failed = int(result.ground.failed(flown).sum())
        count = round(rate["failure"] * rate["runs"])
        chance = min(chance, 2.0 * same_rate(count, rate["runs"], failed, RUNS))
    if old is None:
        return likely(f"{new['failure']:.4g}", chance, RARE)
    gap, reported = new["failure"] - old["failure"], stated["difference"]
    if not (close(reported["middle"], gap, 1e-6, 1e-9) and reported["low"] <= gap):
        return Verdict(f"difference {reported['middle']:.4g}", f"{gap:.4g}", False)
    return likely(f"{old['failure']:.4g} and {new['failure']:.4g}", chance, RARE)


def old_plan(result: Evidence) -> Verdict | None:
    """The rest of the old plan is the plan of the source from the step on."""
    stated, source = result.replanned, flown_result(result)
    if source is None:
        return None
    step, rest = stated["step"], stated["rest"]
    pairs = (rest["x"], source.x[step:]), (rest["u"], source.u[step:])
    other = not all(np.array_equal(np.array(own, float), whole) for own, whole in pairs)
    return no_fault(f"{len(rest['u'])} steps", {"not the steps of the source": other})


def old_law(result: Evidence) -> Verdict | None:
    """The law of forecast errors is the one of the old plan, unless there is a newer forecast."""
    source = flown_result(result)
    if source is None or result.replanned["wind"]:
        return None
    old, new = source.wind.error, result.wind.error
    if old is None or new is None:
        return same("no law" if new is None else "a law", "no law" if old is None else "a law")
    stated, wanted = new.numbers(), old.numbers()
    other = (key for key in wanted if not np.array_equal(stated.get(key, np.empty(0)), wanted[key]))
    faults = {"parts": set(stated) != set(wanted), "data": (new.facts, new.floor) != (old.facts, old.floor)}
    return no_fault(f"{new.name}, level {new.level}", faults, other)


# --- what follows from the fixes ------------------------------------------------------------------


class Reported(NamedTuple):
    """Given the fixes: law of the position, mean ``theta`` (2P,) of θ, law of own errors; distances."""

    mean: FloatArray
    cov: FloatArray
    theta: FloatArray
    distance: FloatArray
    errors: Errors


def _given_fixes(source: Evidence, stated: dict[str, Any]) -> Reported | None:
    """Position and θ at the step, given the fixes, under the law of the old plan; None with landmarks."""
    step, fixes = stated["step"], stated["fixes"]
    law = source.law(source.planned_law, step)
    if not fixes or law.landmarks:
        return None
    course = laws.fly_means(law, source.x[: step + 1])
    at = [fix["step"] for fix in fixes]
    across = laws.covariance_across(law, course)
    among = np.block([[across[t, s] if t >= s else across[s, t].T for s in at] for t in at])
    S = among + np.diag(np.repeat([fix["sd"] ** 2 for fix in fixes], 2))
    d = np.concatenate([np.array(fix["place"]) - source.x[fix["step"]] for fix in fixes])
    to = np.hstack([across[step, t] for t in at])
    C = np.vstack([_faded(law, course, t, step) for t in at])
    own = np.vstack([course.cross[t][:, law.modes :] for t in at]) @ law.errors.root.T
    z = np.linalg.solve(np.linalg.cholesky(S), d)
    return Reported(
        source.x[step] + to @ np.linalg.solve(S, d), course.cov[step] - to @ np.linalg.solve(S, to.T),
        C.T @ np.linalg.solve(S, d), np.linalg.norm(z.reshape(-1, 2), axis=1),
        Errors(
            law.errors.mean + own.T @ np.linalg.solve(S, d),
            law.errors.cov - own.T @ np.linalg.solve(S, own),
            course.cross[step][:, law.modes :] @ law.errors.root.T - to @ np.linalg.solve(S, own),
        ),
    )  # fmt: skip


def _faded(law: laws.Law, course: Course, t: int, step: int) -> FloatArray:
    """Cov(e_t, θ) (2, 2P) with θ of ``step``."""
    shares = [law.kept(later) for later in range(t + 1, step + 1)]
    return np.asarray((course.cross[t] * np.prod(shares, axis=0))[:, : law.modes], float)


def position(result: Evidence) -> Verdict | None:
    """Mean, covariance and distances in standard deviations follow from the old plan and the fixes."""
    stated, source = result.replanned, flown_result(result)
    learnt = None if source is None else _given_fixes(source, stated)
    if learnt is None:
        return None
    reported, distances = stated["position"], [fix["distance"] for fix in stated["fixes"]]
    unit = math.sqrt(float(np.trace(np.array(reported["before"])))) or 1.0  # [m] of a position that is known
    worst = max(
        float(np.abs(learnt.mean - reported["mean"]).max()) / unit,
        float(np.abs(learnt.cov - reported["cov"]).max()) / unit**2,
        float((np.abs(learnt.distance - distances) / np.maximum(distances, NEAR)).max()),
    )
    return within(f"{len(distances)} fixes", worst, SHARE)


def own_errors(result: Evidence) -> Verdict | None:
    """Mean and covariance of the robot's own errors follow from the old plan and the fixes.

    A fix that the law gives less than 1e-4 says nothing about them.
    """
    stated, source = result.replanned, flown_result(result)
    if source is None or "errors" not in stated:  # plans of earlier versions
        return None
    learnt, prior, found = _given_fixes(source, stated), source.robot.errors, result.robot.errors
    shared = np.zeros_like(found.shared)  # after an unlikely fix
    if not stated["fixes"]:
        wanted, step = prior, stated["step"]
        law = source.law(source.planned_law, step)
        if law.landmarks:
            return None
        if len(prior):
            course = laws.fly_means(law, source.x[: step + 1])
            shared = course.cross[step][:, law.modes :] @ law.errors.root.T
    elif learnt is None:
        return None
    elif any(fix["distance"] > FAR for fix in stated["fixes"]):
        wanted = prior
    else:
        wanted, shared = learnt.errors, learnt.errors.shared
    if len(found) != len(prior):
        return Verdict(f"{len(found)} errors", f"{len(prior)}", False)
    if not len(wanted):  # a law without errors of robots
        wanted, shared = prior, np.zeros_like(found.shared)
    sd = np.maximum(np.sqrt(np.diag(prior.cov)), 1e-300)
    unit = math.sqrt(float(np.trace(np.array(stated["position"]["before"])))) or 1.0  # [m]
    gaps = (
        (found.mean - wanted.mean) / sd,
        (found.cov - wanted.cov) / np.outer(sd, sd),
        (found.shared - shared) / (unit * sd),
    )
    worst = max(float(np.abs(gap).max(initial=0.0)) for gap in gaps)
    return within(f"{len(found)} errors", worst, SHARE)


def expected_wind(result: Evidence) -> Verdict | None:
    """The expected wind at the nodes is the old one, corrected by the error that the fixes determine."""
    stated, source = result.replanned, flown_result(result)
    if source is None or source.wind.modes is None or stated["wind"]:
        return None
    learnt = _given_fixes(source, stated)
    if learnt is None or not len(learnt.theta):
        return None
    old, new, modes, moment = source.wind, result.wind, source.wind.modes, float(stated["time_s"])
    nodes = np.stack(np.meshgrid(new.x, new.y, indexing="ij"), axis=-1).reshape(-1, 2)
    square, theta = square_of(modes.x, modes.y, nodes), learnt.theta.reshape(2, -1)
    held = new.held is not None and old.held is None
    now, worst = 0 if held else int(np.argmin(np.abs(new.times))), 0.0
    for k, time in enumerate(new.times):
        slot = len(old.times) - 1 if held else int(np.argmin(np.abs(old.times - moment - time)))
        weight = _persistence(old, new, now, k, held=held)
        psi = square.value(modes.psi[slot])  # (N, 2, P)
        shift = np.einsum("ncp,cp->nc", psi, theta * weight)
        gap = new.mean[k].reshape(-1, 2) - old.mean[slot].reshape(-1, 2) - shift
        worst = max(worst, float(np.abs(gap).max()))
    return within(f"{len(new.times)} slots", worst, WIND, " m/s")


def _persistence(old: WindFile, new: WindFile, now: int, k: int, *, held: bool) -> FloatArray:
    """Share (P,) of each mode's θ that lasts from slot ``now`` to ``k``; times √D for a newly held field."""
    assert old.modes is not None
    law, last = old.error, new.last_field
    apart = abs(min(float(new.times[k]), last) - min(float(new.times[now]), last))
    of_part = {SPACE: old.modes.rho ** (apart / old.modes.gap), ENSEMBLE: 1.0}
    lead = float(new.leads[min(k, now)])
    of_part |= {number: part.kept(lead, apart) for number, part in old.law_parts.items()}
    if law is not None and new.held is not None:
        lags = (new.times - new.held).tolist()
        fade = math.prod(law.change_correlation(lags[j], lags[j + 1]) for j in range(now, k))
        of_part[TIME if held else HELD] = fade * (_mean_change(law, lags, k) if held else 1.0)
    return np.array([of_part.get(part, 0.0) for part in old.modes.part.tolist()])


def _mean_change(law: ErrorLaw, lags: list[float], k: int) -> float:
    """√ of the mean D over the times [s] since the last field for which slot k is the nearest one."""
    begin = (lags[k - 1] + lags[k]) / 2 if k else lags[0]
    end = (lags[k] + lags[k + 1]) / 2 if k + 1 < len(lags) else lags[k]
    around = np.linspace(begin, end, 101).tolist()
    return math.sqrt(float(np.mean([law.change_variance(lag) for lag in around])))


FILES = ("replan.json", "wind.nc", "plan.json", "scene.json")
CLAIMS: tuple[Claim, ...] = (
    Claim("replan: start, spread and time of the rest", FILES, start),
    Claim("replan: alarms, and no promise after them", FILES, alarms),
    Claim("replan: failure rates of the old and the new plan", FILES, rates),
    Claim(OLD_PLAN, FILES, old_plan),
    Claim(OLD_LAW, FILES, old_law),
    Claim(OF_THE_FIXES[0], FILES, position),
    Claim(OF_THE_FIXES[1], FILES, expected_wind),
    Claim(OF_THE_FIXES[2], FILES, own_errors),
)
