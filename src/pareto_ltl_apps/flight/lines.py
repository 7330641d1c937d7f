"""The events of a watch in words for the pilot, one line each; what only the journal has gives none."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable

from careful_io.texts import distance_text, in_kilometres, probability_text
from flight_quantities.medium import AIR, MEDIA
from pareto_ltl_apps.flight.goals import BELIEVED
from pareto_ltl_apps.flight.rules import Event
from pareto_ltl_apps.flight.telemetry import refused_text


def event_line(event: Event) -> str:
    """``event`` as a line for the pilot; empty for events that only the journal has."""
    text = LINES[event["event"]](event)
    return f"{clock_text(event['time'])}  {text}" if text else ""


def flows_of(event: Event) -> str:
    """The flows of the law of ``event``: ``coherent winds``, or currents."""
    return f"{event['law']} {MEDIA[event['medium']].flows}"


def clock_text(seconds: float) -> str:
    """``+2:05:30`` after departure."""
    hours, rest = divmod(round(seconds), 3600)
    return f"+{hours:d}:{rest // 60:02d}:{rest % 60:02d}"


def _place(event: Event) -> str:
    if "lat" in event:
        return f"{event['lat']:.4f},{event['lon']:.4f}"
    return f"{event['x'] / 1e3:.2f},{event['y'] / 1e3:.2f} km"


def _length(metres: float) -> str:
    """A length as text: whole metres from 10 m to 2 km."""
    return distance_text(metres, 0 if metres >= 10.0 and not in_kilometres(metres) else 1)


def _hours(joules: float) -> str:
    """An energy [J] in Wh as text, whole numbers from 100 Wh."""
    value = joules / 3600.0
    return f"{value:,.0f}" if abs(value) >= 100.0 else f"{value:.1f}"


def _status(event: Event) -> str:
    """Where the robot is, what is next, and how often the rest fails; empty between two lines."""
    return _believed(event) if event["shown"] else ""


def _believed(event: Event) -> str:
    goal = ""
    if event["goal"]:
        late = event["goal_time"] - event["time"]
        goal = f"; next {' and '.join(event['goal'])} in {clock_text(late)[1:]}"
    goal += "".join(
        f"; {' and '.join(one['goal'])} reached with probability {probability_text(one['probability'])}"
        for one in event["missed"]
    )
    promised = "" if event["promised"] is None else f" (promised {probability_text(event['promised'])})"
    energy = ""
    if event["energy"] is not None:
        energy = f"; {_hours(event['energy'])} Wh used of {_hours(event['energy_needed'])} by the end"
    if event["battery"] is not None:
        energy += f"; battery {100.0 * event['battery']:.0f} %"
    low, high = (probability_text(event[key]).removesuffix(" %") for key in ("low", "high"))
    return (
        f"at {_place(event)} within {_length(event['major'])} (95 %), {event['corridor']:.1f} sd from the "
        f"plan{goal}; the rest fails {probability_text(event['failure'])} ({low} to {high}) in "
        f"{flows_of(event)}{promised}; {_flow(event)}{energy}"
    )


def _flow(event: Event) -> str:
    """The estimated wind by the direction it blows from, or the current by the direction it sets to."""
    in_air = MEDIA[event["medium"]] is AIR
    name, turn, digits = ("wind", 0.0, 1) if in_air else ("current to", 180.0, 2)

    def text(come_from: float, speed: float) -> str:
        return f"{(come_from + turn) % 360.0:03.0f}/{speed:.{digits}f}"

    estimated, heard = text(event["wind_from"], math.hypot(*event["wind"])), event["heard_wind"]
    autopilot = "" if heard is None else f" (autopilot: {text(*heard)})"
    return f"{name} {estimated} m/s, sd {event['wind_sd']:.{digits}f}{autopilot}"


def _fix(event: Event) -> str:
    first, second = event["given"]
    done = {"learnt": "used", "refused": "NOT used", "restarted": "believed anew"}[event["use"]]
    return (
        f"position fix {first:.4f},{second:.4f}, sd {_length(event['sd'])}: "
        f"{event['distance']:.1f} standard deviations off, {done}"
    )


def _velocity(east: float, north: float) -> str:
    return f"{math.hypot(east, north):.1f} m/s towards {math.degrees(math.atan2(east, north)) % 360.0:03.0f}°"


def _branch(event: Event) -> str:
    added = ""
    if "change" in event:
        minutes, velocity = event["seconds"] / 60.0, _velocity(*event["change"])
        added = f", for {minutes:.0f} min with {velocity} added to its velocities through the air"
    if "later" in event:
        added += f", from then on with {_velocity(*event['later'])}"
    return (
        f"BRANCH {event['name']}: the measured position is {event['where']}; fly "
        f"branch_{event['name']}.csv from here on{added} (of simulated flights that flew it, "
        f"{probability_text(event['failure'])} failed)"
    )


def _replanned(event: Event) -> str:
    why = "" if event["wind"] is None else f" with the forecast {event['wind']}"
    if event["new"] is None:
        return f"a new plan{why} in {event['directory']} promises nothing: {'; '.join(event['alarms'])}"
    new, old = (probability_text(event[key]) for key in ("new", "old"))
    end = "type y to fly it" if event["better"] else "no better: the old one is flown on"
    return (
        f"a new plan{why} from {clock_text(event['at'])} on fails {new}, the rest of the old one {old}, in "
        f"the same {flows_of(event)}: {event['directory']}; {end}"
    )


def _goal(event: Event) -> str:
    """A goal whose planned time has come, or that is reached later."""
    name = " and ".join(event["goal"]) or "the next state of the mission"
    by_now = " by now" if event["late"] else ""
    return (
        f"{name}: planned for {clock_text(event['planned'])[1:]}, reached{by_now} with probability "
        f"{probability_text(event['probability'])}"
    )


def _waiting(event: Event) -> str:
    return f"telemetry is heard; the departure is in {clock_text(event['seconds'])[1:]}"


def _end(event: Event) -> str:
    """Whether the mission is complete, and the last status."""
    sure = probability_text(event["complete"])
    done = "complete" if event["complete"] >= BELIEVED else "NOT complete"
    early = "" if event["over"] else f", {clock_text(event['end'] - event['time'])[1:]} before its end"
    return (
        f"end of the telemetry{early}: the mission is {done} (complete with probability {sure}); "
        f"{_believed(event)}"
    )


LINES: dict[str, Callable[[Event], str]] = {
    "begin": lambda event: f"watching {event['plan']}: {event['formula']}",
    "waiting": lambda event: _waiting(event) if event["shown"] else "",
    "flown": lambda _: "",
    "sent": lambda event: f"sent {event['text']}",
    "answered": lambda event: event["text"],
    "goal": _goal,
    "status": _status,
    "fix": _fix,
    "branch": _branch,
    "replanned": _replanned,
    "switched": lambda event: f"SWITCHED to the plan in {event['directory']}; times count from its departure",
    "alarm": lambda event: f"ALARM: {event['text']}. What can be done: {event['advice']}",
    "unused": lambda event: f"not used: {refused_text(Counter(event['refused']))}",
    "end": _end,
}
