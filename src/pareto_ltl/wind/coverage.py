"""Texts on the errors that a failure probability covers, and those that it does not cover."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from careful_io.texts import probability_text
from careful_io.times import HOUR, iso, seconds
from flight_quantities.medium import medium_of
from pareto_ltl.support.levels import level_mismatch
from pareto_ltl.wind.records import WindField
from wind_laws.change_law import reasons_text
from wind_laws.documents import packaged_law
from wind_laws.error_law import ErrorLaw
from wind_laws.records import ENSEMBLE


class OwnErrors(NamedTuple):
    """Standard deviations of the robot's own errors, one for a whole flight; None for one not modelled.

    ``airspeed`` is relative, ``heading`` in [deg], ``clock`` in [s]; ``bias`` are the expected errors.
    """

    airspeed: float | None = None
    heading: float | None = None
    clock: float | None = None
    bias: tuple[float, float, float] = (0.0, 0.0, 0.0)


class Coverage(NamedTuple):
    """Two paragraphs for reports: the errors that are ``covered``, and those that are ``not_covered``."""

    covered: str
    not_covered: str


EXACT = OwnErrors()
LEAST_GAIN = 0.01  # of forecasts over a held field, to be worth a warning


def coverage_of(
    field: WindField, time_zero: str | None = None, flown: str = "", *, by_default: bool = False,
    robot: OwnErrors = EXACT,
) -> Coverage:  # fmt: skip
    """The errors of the wind that the laws of ``field`` cover; its times count from ``time_zero``.

    ``flown`` is the level of the robot, if it has one. ``by_default`` says that the departure is the first
    time of the wind because no other is set. ``robot`` are the errors of the robot that the law covers.
    """
    medium = medium_of(field.level)
    if field.evidence is None and not field.gust_var.any():
        still = medium_of(field.level, flown)  # calm has no level
        modelled, others = own_errors_texts(robot, still.speed)
        covers = "; ".join([f"{still.still}: no {still.flow} at all", *modelled])
        return Coverage(f"{covers}.", f"any {still.flow}; {others}.")
    modelled, others = own_errors_texts(robot, medium.speed)
    covered = [f"{medium.flow} at {field.level} of {field.source or 'an unknown source'}"]
    if by_default and time_zero:
        covered.append(
            f"a departure at {iso(seconds(time_zero))}, the first time of the {medium.flow}, as "
            "mission.start_time is not set"
        )
    if field.evidence is not None:
        counts = [len(points) for points in field.evidence.points]
        share = field.score.get("gp_coverage_90", np.nan)
        scored = (
            f"{probability_text(share)} lie in 90 % intervals" if np.isfinite(share) else "none was scored"
        )
        covered.append(
            f"interpolation in space between {_range(counts, 'readings a time')} ({field.evidence.kernel}; "
            f"of readings on the map that the fit did not see, {scored})"
        )
    left = _forecast_part(field, covered)
    _time_part(field, time_zero, covered, left)
    if field.modes is not None and (field.modes.part == ENSEMBLE).any():
        covered.append("the spread of the members of an ensemble")
    covered += [f"a white part of {np.sqrt(field.gust_var.mean()):.2g} m/s", *modelled]
    if field.evidence is not None and flown and (gap := level_mismatch(flown, field.level)):
        left.append(gap)
    left += [
        f"{medium.flows} at other {medium.levels} than {field.level}, and vertical motion of the "
        f"{medium.matter}",
        "errors that are not Gaussian, such as a front or a storm that comes early"
        if field.error is None or field.error.tail is None
        else "a front or a storm that comes hours early, beyond the tails of the law",
        others,
    ]
    return Coverage("; ".join(covered) + ".", "; ".join(left) + ".")


def level_gap(not_covered: str) -> str:
    """The part of a paragraph of :func:`coverage_of` about a wind of another level; empty if there is none.

    The rates of such a plan count flights in the wind that was used; they promise nothing about another one.
    """
    parts = not_covered.removesuffix(".").split("; ")
    return next((part for part in parts if part.startswith("the robot ") and " used is " in part), "")


def own_errors_texts(robot: OwnErrors, speed: str) -> tuple[list[str], str]:
    """What is covered of the robot's own errors, and what is not; ``speed`` is the word for its airspeed."""
    names = (speed, "heading", "timing")
    missing = [name for name, sd in zip(names, robot[:3], strict=True) if sd is None]
    left = [f"the robot's own errors of {and_text(missing)}"] * bool(missing)
    if len(missing) < len(names):
        left.append("changes of the robot's own errors during a flight")
    covered = own_errors_text(robot, speed)
    return [covered] * bool(covered), "; ".join(left)


def own_errors_text(robot: OwnErrors, speed: str) -> str:
    """The modelled errors: ``airspeed errors of 1.5 % and heading errors of 1 degree (1 sd, ...)``.

    Expected errors that are not 0 are stated too: ``airspeed errors of 1 % about +2 %``.
    """
    parts, (airspeed, heading, clock) = [], robot.bias
    if robot.airspeed is not None:
        parts.append(f"{speed} errors of {100.0 * robot.airspeed:.3g} %{_about(100.0 * airspeed, '%')}")
    if robot.heading is not None:
        unit = "degree" if robot.heading == 1.0 else "degrees"
        parts.append(f"heading errors of {robot.heading:.3g} {unit}{_about(heading, 'degrees')}")
    if robot.clock is not None:
        parts.append(f"clock errors of {robot.clock:.3g} s{_about(clock, 's')}")
    return f"{and_text(parts)} (1 sd, constant over a flight)" if parts else ""


def _about(bias: float, unit: str) -> str:
    return f" about {bias:+.3g} {unit}" if bias else ""


def and_text(parts: list[str]) -> str:
    """Parts as a list in words: ``a``, ``a and b``, ``a, b and c``."""
    return " and ".join([", ".join(parts[:-1]), parts[-1]] if len(parts) > 1 else parts)


def _forecast_part(field: WindField, covered: list[str]) -> list[str]:
    """Add the covered errors of forecasts to ``covered``; return those that are not covered."""
    leads = field.leads[np.isfinite(field.leads)] / HOUR
    if field.error is None or not field.error.parts:
        leads_text = f" (leads {_range(leads.tolist(), 'h')})" if len(leads) else ""
        return [f"errors of the fields themselves: analyses and forecasts{leads_text} are taken as true"]
    if not len(leads):
        return ["forecast error: the readings do not say how old their forecast is (lead_hours)"]
    sd = np.sqrt(field.error.forecast_variance(leads * HOUR))
    covered.append(
        f"forecast error by the law {field.error.name} for leads {_range(leads.tolist(), 'h')}, "
        f"{_range(sd.tolist(), 'm/s')} a component{_tail_text(field.error)}"
    )
    return (
        []
        if field.error.forecast_variance(np.zeros(1))[0] > 0
        else ["errors of analyses (forecasts of lead 0)"]
    )


def _tail_text(law: ErrorLaw) -> str:
    """The tails of a law, and its number of situations."""
    if law.situations is None:
        return ""
    tails = "" if law.tail is None else " with heavy tails"
    count = f"{law.situations} situation{'s' * (law.situations != 1)}"
    return f"{tails} ({count}, which cannot tell rates below {probability_text(law.floor)})"


def _time_part(field: WindField, time_zero: str | None, covered: list[str], left: list[str]) -> None:
    gaps = np.diff(field.times[field.times <= field.last_field]) / HOUR
    if field.error is None:
        left.append(f"the change of the {medium_of(field.level).flow} between fields")
    elif len(gaps):
        covered.append(f"interpolation in time between fields {_range(gaps.tolist(), 'h')} apart")
    if field.error is not None and field.error.variability is not None:
        factor = np.sqrt(field.error.variability.factor)
        tails = ", with heavy tails" if field.error.change_tail > 0.0 else ""
        by = reasons_text(field.error.variability)
        covered.append(f"changes in time {factor:.2f} times those of the law, by {by}{tails}")
    held = field.known_until - field.last_field
    if 0.0 < held < np.inf:
        when = f" ({iso(seconds(time_zero) + field.last_field)})" if time_zero else ""
        covered.append(f"the last field{when} held for up to {held / HOUR:g} h, and the change since then")


def held_warning(field: WindField, end: float, time_zero: str | None = None) -> str | None:
    """The warning for a flight that ends at ``end`` [s], after the last field, with errors of forecasts.

    Halfway through the held part of the flight and at its end, it compares the standard deviations of one
    component: √(D(τ) + e²(L)) of the last field, whose lead is L, and e(L + τ) of a forecast. None if the
    flight ends before, or if forecasts would be better by at most a hundredth.
    """
    last, law = field.last_field, field.error
    if law is None or end <= last:
        return None
    usual = law if law.parts else packaged_law("gfs").for_winds(law.level, law.spread)
    late = np.array([(max(last, 0.0) + end) / 2, end]) - last
    lead = np.nan_to_num(field.leads[-1])
    held = np.sqrt(law.change_variance(late) + law.forecast_variance(lead))
    fresh = np.sqrt(usual.forecast_variance(lead + late))
    if held[1] <= (1.0 + LEAST_GAIN) * fresh[1]:
        return None
    when = f" ({iso(seconds(time_zero) + last)})" if time_zero else ""
    return (
        f"no field covers the last {(end - max(last, 0.0)) / HOUR:.3g} h of the flight: the last one{when} "
        f"is held, with an error of {held[0]:.2g} m/s a component halfway through them and {held[1]:.2g} m/s "
        f"at their end; forecasts for these times would have {fresh[0]:.2g} and {fresh[1]:.2g} m/s (law "
        f"{usual.name}): add forecasts that cover the flight, which make it more certain where the robot is"
    )


def _range(values: list[float] | list[int], unit: str) -> str:
    """The range of ``values`` as text: ``3 h``, ``0 to 6 h``."""
    low, high = min(values), max(values)
    return f"{low:.3g} {unit}" if f"{low:.3g}" == f"{high:.3g}" else f"{low:.3g} to {high:.3g} {unit}"
