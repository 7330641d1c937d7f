"""``pareto_ltl.follow``: a stream of telemetry watched against a plan, with a journal."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from pareto_ltl.inflight.journal import SCHEMA, Journal, read_journal, require_place
from pareto_ltl.inflight.telemetry import Reading, read_log
from pareto_ltl.inflight.watch import Event, Watch, WatchSettings
from pareto_ltl.run.records import PLAN, PROBLEM, SCENE, WIND
from pareto_ltl.run.rest_of_flight import issued
from pareto_ltl.run.results import planned_run
from pareto_ltl.run.stage_table import stage_seeds
from pareto_ltl.support.errors import ConfigError

if TYPE_CHECKING:
    from pareto_ltl.run.results import PlanningResult, Results

STREAM = "follow"
Listener = Callable[[Watch, Event], Iterable[Event]]


def follow(
    planned: PlanningResult | Results | str | Path,
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
    planned : PlanningResult, Results or path
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
    _check(cfg)
    run = planned_run(planned)
    scene, seed = run.make(SCENE), stage_seeds(run.settings.seed, STREAM)
    watch = Watch(run.make(PROBLEM), run.make(PLAN), cfg, seed, issued(run.make(WIND)))
    begin: Event = {
        "event": "begin", "time": 0.0, "schema": SCHEMA, "plan": run.settings.name,
        "formula": watch.plan.formula, "departure": scene.time_zero, "members": cfg.members,
        "not_covered": watch.plan.not_covered,
    }  # fmt: skip
    place = None if out is None else require_place(Path(out), resume=resume)
    earlier = list(read_journal(place)) if place is not None and resume else []
    if isinstance(readings, str | Path):
        readings = read_log(Path(readings), scene.time_zero, on_earth=scene.crs is not None)
    return _events(watch, readings, [begin, *begun], earlier, place, listener)


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
                text = f"the journal cannot be written any longer ({journal.failed}): free space"
                yield {"event": "alarm", "time": event["time"], "kind": "journal", "text": text}
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


def _check(cfg: WatchSettings) -> None:
    if not 1.0 <= cfg.every <= 86_400.0:
        raise ConfigError(f"--every must be 1 to 86,400 s, got {cfg.every:g}")
    if not 0.0 < cfg.alarm <= 1.0:
        raise ConfigError(f"--alarm must be a failure rate above 0 and at most 1, got {cfg.alarm:g}")
    if not cfg.wind_age > 0.0:
        raise ConfigError(f"--wind-age must be above 0 h, got {cfg.wind_age / 3600.0:g}")
    if not 50 <= cfg.members <= 100_000:
        raise ConfigError(f"--flights must be 50 to 100,000, got {cfg.members}")
