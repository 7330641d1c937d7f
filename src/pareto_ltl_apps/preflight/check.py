"""``pareto_ltl.check``: a finished plan in this morning's forecast, and GO or NO-GO by the user's limits.

The plan is checked as it was exported, with its headings and airspeeds, and again with headings for the newer
forecast along the same positions at the same times. The first decides.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from careful_io.texts import distance_text, interval_text, plain_power, probability_text, speed_digits
from pareto_ltl import ConfigError, DataError, InfeasibleError, Run, Scene
from pareto_ltl.extend import (
    Deployment,
    FailureRate,
    FlightSample,
    completing_path,
    plain_sample,
    planned_run,
)
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.display import Displayed
from pareto_ltl_apps.flight.newer_wind import in_newer_wind
from pareto_ltl_apps.preflight.containment import HOUR
from pareto_ltl_apps.preflight.given_volume import given_area
from pareto_ltl_apps.preflight.leaving import Area, border_area, leaving_rate
from pareto_ltl_apps.preflight.settings import LimitsConfig

if TYPE_CHECKING:
    from pareto_ltl.extend import Problem

STREAM = "check"  # stream of the flights
DRAWS = 4000  # of the wind at each step
SHARE = 0.95  # of the winds drawn that are at most the stated one
KEPT = 1e-6  # relative, of limits: rounding does not exceed them


@dataclass(frozen=True, slots=True)
class Item:
    """One thing that was checked.

    Attributes
    ----------
    name : str
        ``failure``, ``containment``, ``energy``, ``takeoff_wind``, ``wind``, ``forecast`` or ``alarm``.
    value : float or None
        What is compared with the limit, in SI units; None if there is no number.
    limit : float or None
        None if the user has set none.
    text : str
        A sentence on the value.
    passed : bool
        Whether it keeps the limit.
    """

    name: str
    value: float | None
    limit: float | None
    text: str
    passed: bool


@dataclass(frozen=True, slots=True, repr=False)
class Check(Displayed):
    """A plan in a newer forecast.

    Attributes
    ----------
    items : tuple of Item
        All that was checked: the vehicle's limits first, then the mission.
    changed : tuple of str
        What differs from the forecast of the plan, in sentences.
    failure, containment : FailureRate or None
        In the newer forecast, of the plan as it is; None if they are not known.
    old_failure, old_containment : FailureRate
        In the forecast of the plan.
    reheaded : FailureRate or None
        Failure with headings for the newer forecast along the same positions; None if none can be flown.
    drift : (T+1, 2) float or None
        Where the controls of the plan are expected to lead in the newer forecast [m].
    flown : (n, T+1, 2) float or None
        Simulated flights in it [m].
    floor : float
        The least rate that the data of the law of forecast errors can say; 0 without such a law.
    """

    scene: Scene
    wind: str
    hours: float
    items: tuple[Item, ...]
    changed: tuple[str, ...]
    failure: FailureRate | None
    containment: FailureRate | None
    old_failure: FailureRate
    old_containment: FailureRate
    reheaded: FailureRate | None
    drift: FloatArray | None
    flown: FloatArray | None
    floor: float

    @property
    def go(self) -> bool:
        """Whether every limit is kept."""
        return all(item.passed for item in self.items)

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why not, in the order in which it was checked."""
        return tuple(item.text for item in self.items if not item.passed)

    def facts(self) -> Mapping[str, str]:
        """GO or NO-GO with its reasons, and the failure in both forecasts."""
        reported = {"answer": "GO" if self.go else f"NO-GO: {'; '.join(self.reasons)}"}
        reported["planned"] = str(self.old_failure)
        return reported if self.failure is None else reported | {"now": str(self.failure)}


def check(
    planned: Run | str | Path,
    wind: Any,
    *,
    limits: Mapping[str, float] | None = None,
    wind_limit: float | None = None,
    volume: str | Path | None = None,
    flights: int = 10_000,
) -> Check:
    """Check a finished plan in a newer forecast: GO or NO-GO by the limits of the user.

    Parameters
    ----------
    planned : Run or path
        What :func:`pareto_ltl.plan` returned, or a results directory.
    wind : path, mapping, Readings or WindField
        The newer forecast, as for :func:`pareto_ltl.replan`.
    limits : mapping, optional
        Keys of section ``limits`` that differ from the settings of the plan: ``{"failure": 0.05}``.
    wind_limit : float, optional
        Instead of ``robot.wind_limit`` [m/s].
    volume : path, optional
        A volume for ``limits.containment``, as for :func:`pareto_ltl.contain`; else the drawn border.
    flights : int
        Flights in each forecast, 1,000 to 1,000,000.

    Raises
    ------
    ConfigError
        If a limit is out of range, none is set, or the plan has no departure in UTC.
    DataError
        If the forecast cannot be read, or does not cover the map or the time.
    """
    run = planned_run(planned)
    given = _limited(run, limits or {}, wind_limit)
    if not 1000 <= flights <= 1_000_000:
        raise ConfigError(f"check: flights must be 1,000 to 1,000,000, got {flights}")
    if run.plan.alarmed or not len(run.plan.path.u):
        raise DataError(
            "check: the plan has no step, or was made after an alarm, so that there is no promise"
        )
    newer, alarms = in_newer_wind(given, wind)
    return _Comparison(given, newer, tuple(alarms), _area(run, volume), flights, _name(wind)).answer()


def _limited(run: Run, limits: Mapping[str, float], wind_limit: float | None) -> Run:
    """``run`` with the limits of the user; ConfigError if there are none."""
    settings = run.settings
    known = vars(settings[LimitsConfig])
    for name in limits:
        if name not in known:
            raise ConfigError(f"limits has no {name}; it has {', '.join(known)}")
    cfg = replace(settings[LimitsConfig], **limits)
    robot = settings.robot if wind_limit is None else replace(settings.robot, wind_limit=wind_limit)
    if robot.wind_limit is None and all(value is None for value in vars(cfg).values()):
        raise ConfigError(
            "check: GO needs a limit of your own; set limits.failure=0.05, limits.containment, "
            "limits.energy, limits.takeoff_wind or robot.wind_limit"
        )
    return run.with_settings(settings.with_sections(cfg, robot))


def _area(run: Run, volume: str | Path | None) -> Area:
    path = run.plan.path
    if volume is None:
        return border_area(run.scene.bounds, len(path.u))
    return given_area(Path(volume), run.scene, path.t)


def _name(wind: Any) -> str:
    return str(wind) if isinstance(wind, str | Path) else "the given wind"


@dataclass(frozen=True)
class _Comparison:
    """The plan of ``run`` in its forecast and in the ``newer`` one."""

    run: Run
    newer: Run
    alarms: tuple[str, ...]
    area: Area
    flights: int
    wind: str

    def answer(self) -> Check:
        run, newer, path = self.run, self.newer, self.run.plan.path
        seeds = run.seeds(STREAM).spawn(4)
        old = plain_sample(run.problem, path, self.flights, seeds[0])
        old_failure = _failure(run.problem, old)
        old_left = leaving_rate(run.problem, path, self.area, old, seeds[1])
        known = newer.wind.known_until >= float(path.t[-1]) - 1.0
        failure = left = reheaded = drift = flown = None
        if known:
            sample = plain_sample(newer.problem, path, self.flights, seeds[2])
            failure, flown, drift = _failure(newer.problem, sample), sample.x, sample.x.mean(axis=0)
            left = leaving_rate(newer.problem, path, self.area, sample, seeds[3])
            reheaded = self._reheaded(seeds[2])
        items = [*self._vehicle(known=known), *self._mission(failure, left)]
        return Check(
            run.scene, self.wind, float(path.t[-1] - path.t[0]) / HOUR, tuple(items),
            tuple(self._changed(old.x, flown)), failure, left, old_failure, old_left, reheaded, drift, flown,
            newer.wind.floor,
        )  # fmt: skip

    def _reheaded(self, seed: Any) -> FailureRate | None:
        """Failure of the same positions with controls for the newer forecast; None if there are none."""
        try:
            path = completing_path(self.newer.problem, self.run.plan.path.x, "same positions")
        except InfeasibleError:
            return None
        return _failure(self.newer.problem, plain_sample(self.newer.problem, path, self.flights, seed))

    # --- the vehicle ------------------------------------------------------------------------------

    def _vehicle(self, *, known: bool) -> Iterator[Item]:
        path, settings = self.run.plan.path, self.run.settings
        for alarm in self.alarms:
            yield Item("alarm", None, None, alarm, passed=False)
        if not known:
            late = (float(path.t[-1]) - self.newer.wind.known_until) / HOUR
            text = f"the newer forecast ends {late:.3g} h before the arrival: what follows is not known"
            yield Item("forecast", late * HOUR, 0.0, text, passed=False)
        steps = min(len(path.u), len(self.newer.problem.wind.slot))
        winds = [wind_at(self.newer.problem, path.x, k) for k in range(steps)]
        yield self._wind_item("takeoff_wind", winds[0], 0, settings[LimitsConfig].takeoff_wind)
        worst = max(range(steps), key=lambda k: winds[k][1])
        yield self._wind_item("wind", winds[worst], worst, settings.robot.wind_limit)
        if (energy := self.run.problem.energy) is not None and energy.capacity is not None:
            share = energy.of(path.u, self.run.problem.motion.dt) / energy.capacity
            limit = settings[LimitsConfig].energy
            text = f"uses {100.0 * share:.0f} % of robot.power.capacity{_limit_text(limit, 100.0, ' %')}"
            yield Item("energy", share, limit, text, _keeps(share, limit))

    def _wind_item(self, name: str, wind: tuple[float, float], step: int, limit: float | None) -> Item:
        middle, high = wind
        digits = speed_digits(high)
        flow = self.run.settings.medium.flow
        hours = step * self.run.problem.motion.dt / HOUR
        where = "at the start" if name == "takeoff_wind" else f"{hours:.3g} h after departure, the most,"
        text = (
            f"{flow} {where} {middle:.{digits}f} m/s expected, with 95 % at most {high:.{digits}f} m/s"
            f"{_limit_text(limit, 1.0, ' m/s')}"
        )
        return Item(name, high, limit, text, _keeps(high, limit))

    # --- the mission ------------------------------------------------------------------------------

    def _mission(self, failure: FailureRate | None, left: FailureRate | None) -> Iterator[Item]:
        limits, hours = self.run.settings[LimitsConfig], float(self.run.plan.path.t[-1]) / HOUR
        if failure is not None:
            text = f"fails {_rate_text(failure)}{_limit_text(limits.failure, 100.0, ' %')}"
            yield Item("failure", failure.high, limits.failure, text, _keeps(failure.high, limits.failure))
        if left is not None:
            high = left.high / hours
            text = (
                f"leaves the {self.area.name} {plain_power(left.failure / hours)} times per flight hour "
                f"(95 %: {plain_power(left.low / hours)} to {plain_power(high)})"
                + ("" if limits.containment is None else f", limit {plain_power(limits.containment)}")
            )
            yield Item("containment", high, limits.containment, text, _keeps(high, limits.containment))

    def _changed(self, old: FloatArray, new: FloatArray | None) -> Iterator[str]:
        """What differs between the forecasts along the plan."""
        path, problems = self.run.plan.path, (self.run.problem, self.newer.problem)
        steps = min(len(path.u), *(len(problem.wind.slot) for problem in problems))
        was, now = (
            np.array([problem.wind_at(k, path.x[k])[0] for k in range(steps)]) for problem in problems
        )
        apart = np.linalg.norm(now - was, axis=1)
        flow = self.run.settings.medium.flow
        digits = speed_digits(float(apart.max()))
        largest = int(apart.argmax())
        yield (
            f"{flow} along the plan: {math.sqrt(float((apart**2).mean())):.{digits}f} m/s different on "
            f"average, {apart[largest]:.{digits}f} m/s at most, "
            f"{largest * problems[0].motion.dt / HOUR:.3g} h after departure"
        )
        if new is not None:
            gap = new[:, -1].mean(axis=0) - old[:, -1].mean(axis=0)
            yield f"the headings of the plan lead {distance_text(float(np.linalg.norm(gap)))} elsewhere"
            before, after = (distance_text(_spread(x)) for x in (old, new))
            yield f"standard deviation of the position at the end: {after}, planned {before}"


def wind_at(problem: Problem, x: FloatArray, step: int) -> tuple[float, float]:
    """Expected speed of the wind at a step of ``x`` (T+1, 2), and the speed that 95 % do not exceed [m/s].

    The errors of both components are independent and Gaussian, with the smooth and the white part.
    """
    mean, variance = problem.wind_at(step, x[step])
    drawn = mean + np.sqrt(variance) * np.random.default_rng(step).standard_normal((DRAWS, 2))
    return float(np.linalg.norm(mean)), float(np.quantile(np.linalg.norm(drawn, axis=1), SHARE))


def _spread(x: FloatArray) -> float:
    """Standard deviation of the last position along its widest direction [m]."""
    return math.sqrt(float(np.linalg.eigvalsh(np.cov(x[:, -1].T))[-1]))


def _failure(problem: Problem, sample: FlightSample) -> FailureRate:
    return sample.rate(Deployment.judged(problem, sample.law, sample.x).failed)


def _keeps(value: float, limit: float | None) -> bool:
    return limit is None or value <= limit * (1.0 + KEPT)


def _rate_text(rate: FailureRate) -> str:
    return f"{probability_text(rate.failure)} (95 %: {interval_text(rate.low, rate.high)})"


def _limit_text(limit: float | None, scale: float, unit: str) -> str:
    return "" if limit is None else f", limit {scale * limit:.3g}{unit}"


# --- what is reported ------------------------------------------------------------------------------


def check_lines(found: Check) -> Iterator[str]:
    """The answer for a person: GO or NO-GO first."""
    yield "GO" if found.go else "NO-GO"
    for number, reason in enumerate(found.reasons, 1):
        yield f"{number}. {reason}"
    for item in found.items:
        if item.passed:
            yield f"{'within limits' if item.limit is not None else 'no limit set'}: {item.text}"
    yield f"In the forecast of the plan it fails {_rate_text(found.old_failure)}."
    for sentence in found.changed:
        yield f"Changed: {sentence}."
    if found.failure is not None:
        again = "cannot be flown" if found.reheaded is None else f"fails {_rate_text(found.reheaded)}"
        yield f"With headings for the newer forecast along the same positions it {again}."
    if found.failure is not None and found.failure.failure < found.floor:
        yield (
            f"The law's data cannot show a rate below {probability_text(found.floor)}: lower figures are for "
            "comparison."
        )


def check_document(found: Check) -> dict[str, Any]:
    """The same for programs."""

    def numbers(rate: FailureRate | None) -> dict[str, Any] | None:
        if rate is None:
            return None
        ends = {"rate": rate.failure, "low": rate.low, "high": rate.high}
        return {**ends, "runs": rate.runs, "method": rate.method, "law": rate.law}

    return {
        "schema": "pareto_ltl.check/1",
        "go": found.go,
        "wind": found.wind,
        "reasons": list(found.reasons),
        "items": [
            {name: getattr(item, name) for name in ("name", "value", "limit", "passed", "text")}
            for item in found.items
        ],
        "changed": list(found.changed),
        "hours": found.hours,
        "floor": found.floor or None,
        "failure": numbers(found.failure),
        "containment": numbers(found.containment),
        "planned": {"failure": numbers(found.old_failure), "containment": numbers(found.old_containment)},
        "other_headings": numbers(found.reheaded),
    }
