"""Claims about a plan made during a flight: its start, fixes, wind, alarms, and the rest of the old plan.

What follows from the old plan is judged if the directory that ``replan.json`` names still exists.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import ParetoLtlError
from pareto_ltl.support.reading import read_json
from pareto_ltl_verify import laws
from pareto_ltl_verify.claims.verdict import Claim, Verdict, close, likely, no_fault, within
from pareto_ltl_verify.evidence import Evidence, open_evidence
from pareto_ltl_verify.flights import RARE, Simulator, same_rate
from pareto_ltl_verify.laws import Coherent, Course
from pareto_ltl_verify.wind_tables import ENSEMBLE, FORECAST, HELD, SPACE, TIME, WindFile, square_of

FILE = "replan.json"
UNLIKELY = 1e-4  # probability under the law of the plan below which a fix is an alarm
RISKS = ("mission_risk_paper", "mission_risk", "mission_risk_ordered", "collision_risk")
OF_RATES = ("promise_", "failure_", "least_failure", "mission_risk_i", "mission_risk_c", "collision_risk_")
RUNS = 4000  # new flights of each of the two plans
SHARE = 2e-3  # largest allowed relative difference of covariances and distances
WIND = 0.05  # m/s, largest allowed difference of the expected wind


def _told(result: Evidence) -> dict[str, Any]:
    return read_json(result.directory / FILE)


def _source(result: Evidence) -> Evidence | None:
    """The result that was flown; None if its directory does not exist any more."""
    try:
        return open_evidence(Path(_told(result)["source"]))
    except (ParetoLtlError, OSError):
        return None


def start(result: Evidence) -> Verdict:
    """The rest begins at the mean position, with its largest standard deviation, at the time of the step."""
    stated, dt = _told(result), result.robot.dt
    position = stated["position"]
    widest = math.sqrt(float(np.linalg.eigvalsh(np.array(position["cov"]))[-1]))
    faults = ["time"] * (not close(stated["time_s"], stated["step"] * dt))
    faults += ["start of the map"] * (not np.allclose(result.start, position["mean"], rtol=1e-9, atol=1e-3))
    faults += [f"start_sd {result.robot.start_sd:g}"] * (not close(result.robot.start_sd, widest, 1e-6, 1e-6))
    faults += ["the rest begins elsewhere"] * (len(stated["rest"]["x"]) != len(stated["rest"]["u"]) + 1)
    return no_fault(f"step {stated['step']}", faults)


def alarms(result: Evidence) -> Verdict:
    """A fix that the law gives less than 1e-4 is an alarm; after an alarm no file has a probability."""
    stated = _told(result)
    far = math.sqrt(-2.0 * math.log(UNLIKELY))
    unlikely = sum(fix["distance"] > far for fix in stated["fixes"])
    faults = [f"{unlikely} unlikely fixes"] * (len(stated["alarms"]) < unlikely)
    faults += ["an alarm without a reason"] * (
        bool(stated["alarms"]) and not unlikely and stated["wind"] is None
    )
    promised = [stated[name] for name in ("old", "new", "difference")] + [result.plan["promise"]]
    faults += ["a promise after an alarm"] * (bool(stated["alarms"]) and any(v is not None for v in promised))
    risks = [result.plan["objectives"][name] for name in RISKS]
    numbers = [name for name in result.metrics if name.startswith(OF_RATES)]
    if stated["alarms"]:
        faults += [name for name in ("front.csv", "front.npz", "deployments.npz") if result.has(name)]
        faults += ["bounds after an alarm"] * any(risk is not None for risk in risks) + numbers
    elif None in risks:
        faults.append("no bounds, but no alarm")
    return no_fault(f"{len(stated['alarms'])} alarms", faults)


def rates(result: Evidence) -> Verdict | None:
    """Both plans fail as often as their new flights in wind.nc; the difference follows from the rates.

    The rest of the old plan has no rate if it lasts longer than a newer forecast.
    """
    stated = _told(result)
    if stated["alarms"]:
        return None
    rest = stated["rest"]
    paths = {"old": (np.array(rest["x"]), np.array(rest["u"])), "new": (result.x, result.u)}
    chance = 1.0
    for number, (name, (means, u)) in enumerate(paths.items()):
        rate = stated[name]
        if rate is None:
            if not _outlasts(result, len(u)):
                return Verdict("no rate of the old plan", "its winds are known", False)
            continue
        law = result.law(rate["law"], len(u))
        x = means + (result.start - means[0])
        guided = isinstance(law, Coherent) and bool(law.landmarks)
        if guided or law.robot.feedback:
            return None
        flown = Simulator(law, None, x, u, ()).fly(RUNS, np.random.default_rng([20181012, number]))
        failed = int(result.ground.failed(flown).sum())
        count = round(rate["failure"] * rate["runs"])
        chance = min(chance, 2.0 * same_rate(count, rate["runs"], failed, RUNS))
    if stated["old"] is None:
        return likely(f"{stated['new']['failure']:.4g}", chance, RARE)
    gap = stated["new"]["failure"] - stated["old"]["failure"]
    if not (close(stated["difference"]["middle"], gap, 1e-6, 1e-9) and stated["difference"]["low"] <= gap):
        return Verdict(f"difference {stated['difference']['middle']:.4g}", f"{gap:.4g}", False)
    return likely(f"{stated['old']['failure']:.4g} and {stated['new']['failure']:.4g}", chance, RARE)


def _outlasts(result: Evidence, steps: int) -> bool:
    """Whether a flight of ``steps`` lasts longer than wind.nc is known."""
    try:
        result.clock_of(steps)
    except ParetoLtlError:
        return True
    return False


def old_plan(result: Evidence) -> Verdict | None:
    """The rest of the old plan is the plan of the source from the step on."""
    stated, source = _told(result), _source(result)
    if source is None:
        return None
    x, u = (np.array(stated["rest"][name], float) for name in "xu")
    same = np.array_equal(x, source.x[stated["step"] :]) and np.array_equal(u, source.u[stated["step"] :])
    return no_fault(f"{len(u)} steps", [] if same else ["not the steps of the source"])


# --- what follows from the fixes ------------------------------------------------------------------


class Told(NamedTuple):
    """Distribution given the fixes: of the position, and of θ (2P,) with mean ``theta``; their distances."""

    mean: FloatArray
    cov: FloatArray
    theta: FloatArray
    distance: FloatArray


def _given_fixes(source: Evidence, stated: dict[str, Any]) -> Told | None:
    """Position and θ at the step, given the fixes, under the law of the old plan; None with landmarks."""
    step, fixes = stated["step"], stated["fixes"]
    law = source.law(source.planned_law, step)
    if not fixes or (isinstance(law, Coherent) and law.landmarks):
        return None
    course = laws.fly_means(law, source.x[: step + 1])
    at = [fix["step"] for fix in fixes]
    across = laws.covariance_across(law, course) if isinstance(law, Coherent) else _walk(course)
    among = np.block([[across[t, s] if t >= s else across[s, t].T for s in at] for t in at])
    S = among + np.diag(np.repeat([fix["sd"] ** 2 for fix in fixes], 2))
    d = np.concatenate([np.array(fix["place"]) - source.x[fix["step"]] for fix in fixes])
    to = np.hstack([across[step, t] for t in at])
    C = np.vstack([_faded(law, course, t, step) for t in at])
    z = np.linalg.solve(np.linalg.cholesky(S), d)
    return Told(
        source.x[step] + to @ np.linalg.solve(S, d), course.cov[step] - to @ np.linalg.solve(S, to.T),
        C.T @ np.linalg.solve(S, d), np.linalg.norm(z.reshape(-1, 2), axis=1),
    )  # fmt: skip


def _walk(course: Course) -> FloatArray:
    """Cov(e_t, e_s) for s <= t, (T+1, T+1, 2, 2), where the winds of the steps are independent."""
    n = len(course.x)
    across = np.zeros((n, n, 2, 2))
    for s in range(n):
        across[s, s] = course.cov[s]
        for t in range(s, n - 1):
            across[t + 1, s] = course.F[t] @ across[t, s]
    return across


def _faded(law: laws.Law, course: Course, t: int, step: int) -> FloatArray:
    """Cov(e_t, θ) (2, 2P) with θ of ``step``."""
    cross = course.cross[t]
    if isinstance(law, Coherent):
        for later in range(t + 1, step + 1):
            cross = cross * law.kept(later)
    return cross


def position(result: Evidence) -> Verdict | None:
    """Mean, covariance and distances in standard deviations follow from the old plan and the fixes."""
    stated, source = _told(result), _source(result)
    learnt = None if source is None else _given_fixes(source, stated)
    if learnt is None:
        return None
    unit = math.sqrt(float(np.trace(np.array(stated["position"]["before"]))))
    off = float(np.abs(learnt.mean - stated["position"]["mean"]).max()) / unit
    spread = float(np.abs(learnt.cov - stated["position"]["cov"]).max()) / unit**2
    far = np.abs(learnt.distance / [fix["distance"] for fix in stated["fixes"]] - 1.0).max()
    return within(f"{len(stated['fixes'])} fixes", max(off, spread, float(far)), SHARE)


def expected_wind(result: Evidence) -> Verdict | None:
    """The expected wind at the nodes is the old one, corrected by the error that the fixes determine."""
    stated, source = _told(result), _source(result)
    learnt = None if source is None else _given_fixes(source, stated)
    if (
        learnt is None
        or source is None
        or stated["wind"]
        or source.wind.modes is None
        or not len(learnt.theta)
    ):
        return None
    old, new, moment = source.wind, result.wind, float(stated["time_s"])
    modes = old.modes
    assert modes is not None
    nodes = np.stack(np.meshgrid(new.x, new.y, indexing="ij"), axis=-1).reshape(-1, 2)
    square, theta = square_of(modes.x, modes.y, nodes), learnt.theta.reshape(2, -1)
    held = new.held is not None and old.held is None
    now = int(np.argmin(np.abs(new.times))) if not held else 0
    worst = 0.0
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
    last = new.last_field
    apart = abs(min(float(new.times[k]), last) - min(float(new.times[now]), last))
    share = np.zeros(len(old.modes.part))
    share[old.modes.part == SPACE] = old.modes.rho ** (apart / old.modes.gap)
    share[old.modes.part == ENSEMBLE] = 1.0
    if old.error is not None:
        share[old.modes.part == FORECAST] = old.error.persistence ** (apart / old.error.persistence_time)
    if old.error is None or new.held is None:
        return share
    lags, fade = new.times - new.held, 1.0
    for j in range(now, k):
        fade *= old.error.change_correlation(float(lags[j]), float(lags[j + 1]))
    size = 1.0
    if held:
        around = np.linspace(
            (lags[k - 1] + lags[k]) / 2 if k else lags[0],
            (lags[k] + lags[k + 1]) / 2 if k + 1 < len(lags) else lags[k], 101,
        )  # fmt: skip
        size = math.sqrt(float(np.mean([old.error.change_variance(lag) for lag in around.tolist()])))
    share[old.modes.part == (TIME if held else HELD)] = fade * size
    return share


CLAIMS = tuple(
    Claim(f"replan: {name}", (FILE, "wind.nc", "plan.json", "scene.json"), judge)
    for name, judge in (
        ("start, spread and time of the rest", start),
        ("alarms, and no promise after them", alarms),
        ("failure rates of the old and the new plan", rates),
        ("the rest of the old plan", old_plan),
        ("position given the fixes", position),
        ("expected wind given the fixes", expected_wind),
    )
)
