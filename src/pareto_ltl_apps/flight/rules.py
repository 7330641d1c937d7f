"""Alarms of a watch: the events, what can be done about each, and the rules that follow from a status."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from pareto_ltl_apps.flight.belief import LAW

if TYPE_CHECKING:
    from pareto_ltl_apps.flight.watch import Watch

Event = dict[str, Any]  # ``event``, its kind, ``time`` [s after departure], and what belongs to its kind
RESERVE = 0.1  # share of a battery below which the end of the plan is an alarm
CORRIDOR = -2.0 * math.log(0.01)  # squared distance of two components within which 99 % stay
TWICE = 2.0  # times the rate of the last alarm at which there is a new one
HOPELESS = 0.9  # rate of the last alarm above which there is no new one
ADVICE = {  # what can be done, by the kind of the alarm
    "silence": "check the link; give a position fix when you know one, or return",
    "signals": "check the link and the rates of ATTITUDE and VFR_HUD",
    "clock": "give a position fix when you know one; restart the watch with --resume if this happens again",
    "fix": "compare it with another source; give a fix that you trust, and plan again from it with "
    "pareto-ltl replan, or return",
    "map": "check the receiver; if the robot is there, return: the plan does not hold off its map",
    "goal": "plan again from here with pareto-ltl replan, which flies to it again, or return",
    "corridor": "take a position fix, plan again from here with pareto-ltl replan, or return",
    "promise": "plan again from here with pareto-ltl replan, take a position fix, or return",
    "energy": "fly a shorter rest with pareto-ltl replan, or return",
    "age": "plan again with a newer one: pareto-ltl replan --wind FILE",
    "vehicles": "choose the one to follow with --vehicle N",
    "refused": "check its mode and its limits of airspeed; fly the flight card by hand meanwhile",
    "unacknowledged": "check the link; fly the flight card by hand meanwhile",
    "prologue": "set origin, home and position by hand before you take off",
    "replan": "fly on with the old plan, or plan again by hand with pareto-ltl replan",
    "journal": "free space; the watch goes on without a journal",
}


def event_of(event: str, time: float, /, **values: Any) -> Event:
    """An event of a kind, at ``time`` [s after departure]."""
    return {"event": event, "time": time} | values


def alarm(time: float, kind: str, text: str, advice: str = "") -> Event:
    """The event of an alarm, with what can be done: by its kind, unless it is given."""
    return event_of("alarm", time, kind=kind, text=text, advice=advice or ADVICE[kind])


class Rules:
    """What makes a status an alarm. ``issued`` is the start of the forecast [s after departure]."""

    def __init__(self, watch: Watch, issued: float) -> None:
        self.watch, self.issued = watch, issued
        self.rate = math.nan  # failure rate of the last alarm about it
        self.battery = math.nan  # share left
        self.charged = 0.0, math.nan  # when it was heard first, and what

    def take_battery(self, time: float, share: float) -> None:
        """Take the share of the battery that is left."""
        if not math.isfinite(self.battery):
            self.charged = time, share
        self.battery = share

    def faults(self, status: Event) -> Iterator[tuple[str, str]]:
        """The kinds of alarms, each with its text; empty where there is no alarm."""
        settings, old = self.watch.settings, status["time"] - self.issued
        yield "energy", self._energy(status)
        yield "age", "" if old <= settings.wind_age else (
            f"the forecast is {old / 3600.0:.1f} h old, more than {settings.wind_age / 3600.0:g} h"
        )  # fmt: skip
        yield "corridor", "" if status["corridor"] ** 2 <= CORRIDOR else (
            f"{status['corridor']:.1f} standard deviations from the plan, outside the corridor of 99 %"
        )  # fmt: skip
        yield from self._promise(status)

    def _promise(self, status: Event) -> Iterator[tuple[str, str]]:
        """The failure rate of the rest: above the limit, and again where it doubles or the success halves."""
        settings, rate = self.watch.settings, float(status["failure"])
        if rate <= settings.alarm:
            self.rate = math.nan
            yield "promise", ""
            return
        doubled = rate >= TWICE * self.rate or TWICE * (1.0 - rate) <= 1.0 - self.rate
        doubled = doubled and self.rate < HOPELESS
        why = f"more than --alarm {settings.alarm:g}"
        if doubled:
            why = f"after {100.0 * self.rate:.0f} % at the last alarm"
            yield "promise", ""  # ends the last one
        if doubled or math.isnan(self.rate):
            self.rate = rate
        yield (
            "promise",
            (
                f"{status['fails']:,} of {status['flights']:,} flights of the rest of the plan fail in {LAW} "
                f"{self.watch.medium.flows}, {why}"
            ),
        )

    def _energy(self, status: Event) -> str:
        """Whether the energy ends before the plan: by the power curve, else by the battery so far."""
        model, (since, first) = self.watch.problem.energy, self.charged
        if model is not None and model.capacity is not None:
            needed, capacity = status["energy_needed"] / 3600.0, model.capacity / 3600.0
            text = f"{needed:.4g} Wh are needed until the end of the plan, of {capacity:.4g}"
            return text if needed > capacity else ""
        if not math.isfinite(self.battery) or status["time"] <= since:
            return ""
        rate = (first - self.battery) / (status["time"] - since)
        left = self.battery - rate * (status["end"] - status["time"])
        text = f"at the rate so far {100.0 * max(left, 0.0):.0f} % of the battery are left at the end"
        return text if left < RESERVE else ""
