"""A watched flight from its first plan to its last: after a switch the next plan is followed."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

from pareto_ltl.inflight.following import Listener, follow
from pareto_ltl.inflight.journal import NAME, read_journal, require_place
from pareto_ltl.inflight.replans import Replans, ReplanSettings
from pareto_ltl.inflight.telemetry import Reading, read_log
from pareto_ltl.inflight.typed import Typed
from pareto_ltl.inflight.watch import Event, Watch, WatchSettings

if TYPE_CHECKING:
    from pareto_ltl.run.results import Results

FOLDER = "follow"  # of a result, for its journal


@dataclass(slots=True)
class Session:
    """What follows a flight; :meth:`events` yields the events of all its plans.

    Attributes
    ----------
    results, folder : Results, Path
        The plan that is followed, and the folder of its journal.
    listeners : sequence of Listener
        Called with each event; events of new plans come last.
    opened : callable, optional
        Called with each result before it is followed.
    """

    results: Results
    folder: Path
    watching: WatchSettings = field(default_factory=WatchSettings)
    replanning: ReplanSettings = field(default_factory=ReplanSettings)
    listeners: Sequence[Listener] = ()
    typed: Typed | None = None
    opened: Callable[[Results], None] | None = None

    def events(
        self, readings: Iterable[Reading] | Path, *, resume: bool = False
    ) -> Generator[Event, None, None]:
        """Watch until the telemetry ends."""
        from pareto_ltl.run.results import load_results

        scene, begun = self.results.scene, list[Event]()
        if isinstance(readings, Path):
            readings = read_log(readings, scene.time_zero, on_earth=scene.crs is not None)
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
        replans = Replans(self.results.directory, self.folder, self.replanning, self.typed, earlier)
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
