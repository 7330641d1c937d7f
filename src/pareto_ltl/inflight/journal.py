"""The events of a watch: as a journal, and in words for the pilot, one line each.

``follow.jsonl`` has every event, one JSON object a line, appended and flushed. Its lines ``flown`` and
``fix`` are all that the belief depends on: :func:`read_journal` gives them back after the process was killed,
and the watch continues with the same belief.
"""

from __future__ import annotations

import json
import math
import os
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, TextIO

from pareto_ltl.inflight.telemetry import refused_text
from pareto_ltl.inflight.watch import Event
from pareto_ltl.support.display import distance_text, in_kilometres, probability_text
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl.support.links import open_unlinked
from pareto_ltl.support.medium import AIR, MEDIA

NAME = "follow.jsonl"
SCHEMA = "pareto_ltl.follow/1"
SAFE = ("fix", "status", "alarm", "end")  # events after which the disk has all of them


class Journal:
    """Appends events to a file; a disk that is full is reported once, and the watch goes on."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.failed = ""
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self.file: TextIO = os.fdopen(open_unlinked(path, os.O_RDWR | os.O_APPEND), "a", encoding="utf-8")
            # without a line that was cut off when a watch was killed
            os.truncate(self.file.fileno(), path.read_bytes().rfind(b"\n") + 1)
        except OSError as error:
            raise DataError(f"{path}: cannot be written ({error}); name another folder with --out") from None

    def write(self, event: Mapping[str, Any]) -> None:
        """Append ``event``; after a status, a fix or an alarm wait until it is on the disk."""
        if self.failed:
            return
        try:
            self.file.write(json.dumps(event, allow_nan=False, separators=(",", ":")) + "\n")
            self.file.flush()
            if event["event"] in SAFE:
                os.fsync(self.file.fileno())
        except OSError as error:
            self.failed = f"{self.path}: {error}"

    def close(self) -> None:
        """Close the file."""
        self.file.close()


def read_journal(path: Path) -> Iterator[dict[str, Any]]:
    """The events of a file; a last line without an end was cut off, and is left out.

    Raises
    ------
    DataError
        If the file cannot be read, or another line is damaged.
    """
    try:
        text = path.read_text(encoding="utf-8", errors="replace")
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error}); start without --resume") from None
    for number, line in enumerate(text[: text.rfind("\n") + 1].splitlines(), 1):
        try:
            event = json.loads(line)
            if not isinstance(event, dict) or not isinstance(event.get("event"), str):
                raise ValueError
        except ValueError:
            raise DataError(f"{path}, line {number}: no event; start without --resume") from None
        yield event


def require_place(folder: Path, *, resume: bool) -> Path:
    """The journal of ``folder``; ConfigError if one is there that would be mixed with another flight."""
    path = folder / NAME
    if path.exists() and not resume:
        raise ConfigError(f"{path} is there already: give --resume to continue it, or another --out")
    if resume and not path.exists():
        raise ConfigError(f"{path}: there is no journal to resume; start without --resume")
    return path


# --- events in words ----------------------------------------------------------------------------


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
    goal = ""
    if event["goal"]:
        late = event["goal_time"] - event["time"]
        goal = f"; next {' and '.join(event['goal'])} in {clock_text(late)[1:]}"
    promised = "" if event["promised"] is None else f" (promised {probability_text(event['promised'])})"
    energy = ""
    if event["energy"] is not None:
        energy = f"; {_hours(event['energy'])} Wh used of {_hours(event['energy_needed'])} by the end"
    if event["battery"] is not None:
        energy += f"; battery {100.0 * event['battery']:.0f} %"
    flights = (
        f"{probability_text(event['failure'])} (at most {probability_text(event['high'])}) of "
        f"{event['flights']:,} flights of the rest fail in {flows_of(event)}{promised}"
    )
    return (
        f"at {_place(event)}, 95 % within {_length(event['major'])} x {_length(event['minor'])}; "
        f"{event['corridor']:.1f} sd from the plan{goal}; {flights}; {_flow(event)}{energy}"
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


def _end(event: Event) -> str:
    refused = refused_text(Counter(event["refused"]))
    lost = f"; readings that were not used: {refused}" if refused else ""
    return f"end of the telemetry; {_status(event)}{lost}"


LINES: dict[str, Callable[[Event], str]] = {
    "begin": lambda event: f"watching {event['plan']}: {event['formula']}",
    "flown": lambda _: "",
    "sent": lambda event: f"sent {event['text']}",
    "status": _status,
    "fix": _fix,
    "replanned": _replanned,
    "switched": lambda event: f"SWITCHED to the plan in {event['directory']}; times count from its departure",
    "alarm": lambda event: f"ALARM: {event['text']}",
    "end": _end,
}
