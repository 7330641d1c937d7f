"""``pareto_ltl.follow``: a stream of telemetry watched against a plan, with a journal; and sessions.

A session is a watched flight from its first plan to its last: after a switch the next plan is followed.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

from pareto_ltl import Scene, Settings
from pareto_ltl.extend import FlownAir, planned_run
from pareto_ltl.support.errors import ConfigError
from pareto_ltl_apps.flight.airspeeds import airspeeds_of
from pareto_ltl_apps.flight.journal import NAME, SCHEMA, Journal, read_journal, require_place
from pareto_ltl_apps.flight.replans import Replans, ReplanSettings
from pareto_ltl_apps.flight.rest_of_flight import issued
from pareto_ltl_apps.flight.rules import Event, alarm, event_of
from pareto_ltl_apps.flight.telemetry import Reading, Typed, read_log
from pareto_ltl_apps.flight.watch import Watch, WatchSettings

if TYPE_CHECKING:
    from pareto_ltl import Run

STREAM = "follow"
Listener = Callable[[Watch, Event], Iterable[Event]]


def follow(
    planned: Run | str | Path,
    readings: Iterable[Reading] | str | Path,
    *,
    out: str | Path | None = None,
    resume: bool = False,
    settings: WatchSettings | None = None,
    listener: Listener | None = None,
    begun: Sequence[Event] = (),
) -> Iterator[Event]:
    """Watch a flight against its plan; yields events as they happen, and ends at ``end`` or ``switched``.

    Parameters
    ----------
    planned : Run or path
        What :func:`pareto_ltl.plan` returned, or a results directory.
    readings : iterable of Reading, or path
        Telemetry in order of time, or a CSV file of it (docs/follow.md).
    out : path, optional
        Folder for ``follow.jsonl``, the journal; ``resume`` continues it.
    settings : WatchSettings, optional
        Interval of the statuses, alarm, number of flights.
    listener : callable, optional
        Called with the watch and each event; the events that it returns are written after it.
    begun : sequence of Event
        What was flown of this plan under another watch.

    Raises
    ------
    ConfigError
        If a setting cannot be used, or a journal is there already.
    DataError
        If the plan, the telemetry or the journal cannot be read.
    """
    cfg = settings or WatchSettings()
    run = planned_run(planned)
    scene, seed = run.scene, run.seeds(STREAM)
    wind, medium = run.wind, run.settings.medium
    watch = Watch(run.problem, run.plan, cfg, seed, issued(wind), medium)
    begin = event_of(
        "begin", 0.0, schema=SCHEMA, plan=run.settings.name, formula=watch.plan.formula,
        departure=scene.time_zero, members=cfg.members, not_covered=watch.plan.not_covered,
    )  # fmt: skip
    place = None if out is None else require_place(Path(out), resume=resume)
    earlier = list(read_journal(place)) if place is not None and resume else []
    if isinstance(readings, str | Path):
        readings = _table(Path(readings), scene, run.settings, watch.plan.air)
    return _events(watch, readings, [begin, *begun], earlier, place, listener)


def _table(path: Path, scene: Scene, settings: Settings, air: FlownAir | None) -> Iterator[Reading]:
    """The readings of a table, with the air at the height of the plan."""
    ratio = airspeeds_of(settings, air).planned
    return read_log(path, scene.time_zero, on_earth=scene.crs is not None, density_ratio=ratio)


def _events(
    watch: Watch, readings: Iterable[Reading], begin: list[Event], earlier: list[Event], place: Path | None,
    listener: Listener | None,
) -> Iterator[Event]:  # fmt: skip
    journal = None if place is None else Journal(place)
    try:
        if earlier:
            _same_flight(begin[0], earlier)
            watch.resume(earlier)
        else:
            if begin[1:]:
                watch.resume(begin[1:])
            for event in begin:
                yield from _noted(event, watch, journal, listener if event is begin[0] else None)
        for event in watch.events(readings):
            for one in _noted(event, watch, journal, listener):
                yield one
                if one["event"] == "switched":
                    return
    finally:
        if journal is not None:
            journal.close()


def _noted(event: Event, watch: Watch, journal: Journal | None, listener: Listener | None) -> Iterator[Event]:
    """``event`` and what the listener answers, written to the journal first."""
    answers = [] if listener is None else list(listener(watch, event))
    for one in [event, *answers]:
        if journal is not None:
            working = not journal.failed
            journal.write(one)
            if working and journal.failed:
                text = f"the journal cannot be written any longer ({journal.failed})"
                yield alarm(event["time"], "journal", text)
        yield one


def _same_flight(begin: Event, earlier: Sequence[Event]) -> None:
    """ConfigError if a journal belongs to another plan or to other settings, or ends with a switch."""
    for key in ("schema", "plan", "formula", "departure", "members"):
        if earlier[0].get(key) != begin[key]:
            raise ConfigError(
                f"the journal belongs to another watch: {key} is {earlier[0].get(key)!r} there and "
                f"{begin[key]!r} here; give --out for a new one"
            )
    if earlier[-1]["event"] == "switched":
        raise ConfigError(
            f"this flight goes on with another plan: pareto-ltl follow {earlier[-1]['directory']} --resume"
        )


# --- a flight of several plans ------------------------------------------------------------------


FOLDER = "follow"  # of a result, for its journal


@dataclass(slots=True)
class Session:
    """What follows a flight; :meth:`events` yields the events of all its plans.

    Attributes
    ----------
    results, folder : Run, Path
        The plan that is followed, and the folder of its journal.
    listeners : sequence of Listener
        Called with each event; events of new plans come last.
    opened : callable, optional
        Called with each result before it is followed.
    """

    results: Run
    folder: Path
    watching: WatchSettings = field(default_factory=WatchSettings)
    replanning: ReplanSettings = field(default_factory=ReplanSettings)
    listeners: Sequence[Listener] = ()
    typed: Typed | None = None
    opened: Callable[[Run], None] | None = None

    def events(
        self, readings: Iterable[Reading] | Path, *, resume: bool = False
    ) -> Generator[Event, None, None]:
        """Watch until the telemetry ends."""
        from pareto_ltl import load_results

        scene, begun = self.results.scene, list[Event]()
        if isinstance(readings, Path):
            readings = _table(readings, scene, self.results.settings, self.results.plan.air)
        stream, late = iter(readings), 0.0
        while True:
            if self.opened is not None:
                self.opened(self.results)
            switch = yield from self._one_plan(_later(stream, late), begun, resume=resume)
            if switch is None:
                return
            begun = list(_flown_since(read_journal(self.folder / NAME), switch))
            self.results, late, resume = load_results(switch["directory"]), late + switch["at"], False
            self.folder = Path(switch["directory"]) / FOLDER

    def _one_plan(
        self, readings: Iterable[Reading], begun: list[Event], *, resume: bool
    ) -> Generator[Event, None, Event | None]:
        """Watch one plan; returns the event of a switch to another one."""
        earlier = list(read_journal(require_place(self.folder, resume=True))) if resume else begun
        replans = Replans(self.results.place, self.folder, self.replanning, self.typed, earlier)
        active = self.replanning.enabled or self.replanning.wind_folder is not None
        listeners = [*self.listeners, *([replans.answers] if active else [])]

        def answers(watch: Watch, event: Event) -> Iterable[Event]:
            return chain.from_iterable(one(watch, event) for one in listeners)

        switch = None
        try:
            for event in follow(
                self.results, readings, out=self.folder, resume=resume, settings=self.watching,
                listener=answers, begun=begun,
            ):  # fmt: skip
                switch = event if event["event"] == "switched" else None
                yield event
        finally:
            replans.stop()
        return switch


def _later(stream: Iterator[Reading], late: float) -> Iterator[Reading]:
    """The readings with times after a departure that is ``late`` [s] after the one of the stream."""
    return stream if late == 0.0 else (replace(one, time=one.time - late) for one in stream)


def _flown_since(journal: Iterable[Event], switch: Event) -> Iterator[Event]:
    """What was flown, and the fixes that the new plan does not know, with times of the new plan."""
    at, known = switch["at"], switch["known"]
    for event in journal:
        past = event["time"] - at
        if event["event"] == "flown" and past > 0.0:
            share = min(past / event["seconds"], 1.0)
            parts = {key: share * event[key] for key in ("seconds", "east", "north")}
            yield {**event, **parts, "time": past}
        elif event["event"] == "fix" and event["time"] not in known and past >= 0.0:
            yield {**event, "time": past}
