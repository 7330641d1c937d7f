"""``pareto-ltl follow DIR``: a flight watched against its plan."""

from __future__ import annotations

import json
import sys
from argparse import Namespace
from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from pareto_ltl.support.errors import ConfigError
from pareto_ltl.support.extras import EXTRAS
from pareto_ltl_apps.cli.output import Output

if TYPE_CHECKING:
    from pareto_ltl import Run
    from pareto_ltl_apps.flight.following import Listener, Session
    from pareto_ltl_apps.flight.rules import Event
    from pareto_ltl_apps.flight.telemetry import Reading, Typed


ASSESSED = 60.0  # [s] at most between two statuses, from which alarms follow


def follow(options: Namespace, output: Output) -> int:
    """Print what a watch says about a flight, and write its journal; return 0."""
    from careful_io.files import write_json
    from pareto_ltl import load_results
    from pareto_ltl_apps.flight.afterwards import draw_watch, truth_summary, write_search_area
    from pareto_ltl_apps.flight.following import FOLDER, Session
    from pareto_ltl_apps.flight.replans import ReplanSettings
    from pareto_ltl_apps.flight.telemetry import Typed
    from pareto_ltl_apps.flight.watch import WatchSettings

    _check(options)
    results = load_results(options.directory)
    complain = partial(print, file=sys.stderr, flush=True)
    typed = None if options.connect is None or sys.stdin is None else Typed(sys.stdin, complain)
    readings, listener = _source(options, results, typed)
    if options.resume:
        _resumed(options.out or options.directory / FOLDER)
    session = Session(
        results,
        options.out or options.directory / FOLDER,
        WatchSettings(
            min(options.every, ASSESSED),
            options.alarm,
            options.flights,
            wind_age=3600.0 * options.wind_age,
            lines=options.every,
        ),
        ReplanSettings(options.replan, options.wind_folder, options.auto),
        [] if listener is None else [listener],
        typed,
    )
    if options.page is not None:
        _add_page(session, options.page)
    end = None
    events = session.events(readings, resume=options.resume)
    try:
        for event in events:
            end = event if event["event"] == "end" else end
            if line := _shown(event, output):
                print(line, flush=True)
            if options.bell and event["event"] == "alarm":
                print("\a", end="", file=sys.stderr, flush=True)
    except KeyboardInterrupt:
        print("ended by the user; pareto-ltl follow ... --resume continues", file=sys.stderr)
    finally:
        events.close()
    folder = session.folder
    if end is not None:
        write_search_area(session.results.scene, end, folder)
    if options.truth is not None:
        summary = truth_summary(folder, options.truth, session.results.scene)
        write_json(folder / "truth.json", summary)
    picture = draw_watch(session.results, folder)
    written = "journal, figure and search area" if picture else "journal"
    print(f"{written} in {folder}", file=sys.stderr)
    return 0


def _resumed(folder: Path) -> None:
    """Say what is left out of the journal of ``folder``."""
    from pareto_ltl_apps.flight.journal import damaged_end, require_place

    if left := damaged_end(require_place(folder, resume=True)):
        print(f"the last {left} bytes of the journal are no event, and are left out", file=sys.stderr)


def _check(options: Namespace) -> None:
    if options.connect is None:
        for name in ("send", "signing_key", "vehicle"):
            if getattr(options, name):
                word = name.replace("_", "-")
                raise ConfigError(f"--{word} needs --connect: there is no autopilot to talk to")
    if "prologue" in options.send.split(",") and (options.ground is None or not abs(options.ground) < 1e4):
        raise ConfigError("--send prologue needs --ground: the height of the start above mean sea level [m]")
    if options.wind_folder is not None and not options.wind_folder.is_dir():
        raise ConfigError(f"--wind-folder {options.wind_folder}: no such folder")
    if options.auto and not options.replan and options.wind_folder is None:
        raise ConfigError("--auto needs --replan or --wind-folder: without them no new plan is made")


def _add_page(session: Session, port: int) -> None:
    """Show the session on a page, whose address is printed."""
    EXTRAS.require("serve", "--page")
    from pareto_ltl_apps.desk.live import LivePage

    page = LivePage()
    session.opened, session.listeners = page.opened, [*session.listeners, page.heard]
    print(f"page: {page.serve(port)}", file=sys.stderr, flush=True)


def _shown(event: Event, output: Output) -> str:
    """The line of an event; empty for one that is not shown."""
    from pareto_ltl_apps.flight.lines import event_line

    if output is Output.JSON:
        return json.dumps(event)
    return event_line(event) if output is not Output.QUIET or event["event"] == "alarm" else ""


def _source(
    options: Namespace, results: Run, typed: Typed | None
) -> tuple[Iterable[Reading] | Path, Listener | None]:
    """The telemetry, and what answers to events."""
    scene = results.scene
    if options.log is not None and options.log.suffix.lower() not in (".tlog", ".bin", ".log"):
        return options.log, None
    from pareto_ltl_apps.flight.airspeeds import airspeeds_of
    from pareto_ltl_apps.flight.link import Link, LinkSettings, logged_readings, signing_key
    from pareto_ltl_apps.flight.sends import prologue_of

    airspeeds = airspeeds_of(results.settings, results.plan.air)
    if options.log is not None:
        return logged_readings(options.log, scene.time_zero, options.departure, airspeeds), None
    sends = tuple(kind for kind in options.send.split(",") if kind)
    if scene.crs is None and (on_earth := {"position", "prologue"} & {*sends}):
        raise ConfigError(f"--send {min(on_earth)}: the map of this plan has no place on Earth; leave it out")
    settings = LinkSettings(
        departure=options.departure, sends=sends, system=options.vehicle,
        key=b"" if options.signing_key is None else signing_key(options.signing_key),
        prologue=prologue_of(scene, options.ground) if "prologue" in sends else (),
        own_clock=options.vehicle_clock, airspeeds=airspeeds,
    )  # fmt: skip
    link = Link(options.connect, scene.time_zero, settings, typed)
    return link.readings(), link.answers
