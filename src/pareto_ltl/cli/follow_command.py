"""``pareto-ltl follow DIR``: a flight watched against its plan."""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from pareto_ltl.cli.arguments import CommandArguments
from pareto_ltl.cli.output import Output
from pareto_ltl.support.errors import ConfigError

if TYPE_CHECKING:
    from pareto_ltl.inflight.following import Listener, Session
    from pareto_ltl.inflight.telemetry import Reading, Typed
    from pareto_ltl.inflight.watch import Event
    from pareto_ltl.world.scene import Scene


def follow_command(argv: Sequence[str], output: Output) -> int:
    """Print what a watch says about a flight, and write its journal; return 0."""
    parser = CommandArguments(
        prog="pareto-ltl follow",
        description="Watch a flight of the plan of DIR: where the robot is believed to be from its headings, "
        "airspeeds and position fixes, how often the rest of the plan fails from there, and alarms. With "
        "--log after the flight, with --connect during it. Writes follow.jsonl and follow.png. docs/follow.md"
        " says more.",
    )
    parser.add_result()
    source = parser.add_mutually_exclusive_group(required=True)
    source.add_argument(
        "--log", type=Path, metavar="FILE", help="telemetry: a CSV file with the columns time,heading_true,"
        "airspeed_m_s and, where measured, lat,lon,fix_sd_m; or a .tlog, .bin or .log file",
    )  # fmt: skip
    source.add_argument(
        "--connect", metavar="ADDRESS", help="MAVLink, e.g. udpin:127.0.0.1:14550 or /dev/ttyUSB0,57600 "
        "(needs the extra follow: pip install 'pareto-ltl[follow]')",
    )  # fmt: skip
    parser.add_argument(
        "--departure", metavar="TIME", help="when the robot departed, for MAVLink: now (the first message) "
        "or a time in UTC; default: the departure of the plan",
    )  # fmt: skip
    parser.add_argument("--out", type=Path, metavar="FOLDER", help="default: the folder follow in DIR")
    parser.add_argument("--resume", action="store_true", help="continue the journal of a watch that ended")
    parser.add_argument(
        "--truth", type=Path, metavar="FILE", help="true positions, known afterwards: a CSV file with the "
        "columns time,lat,lon; truth.json says how often the ellipses held them",
    )  # fmt: skip
    _add_watching(parser)
    _add_sending(parser)
    parser.epilog = (
        "With --json, each event is one line with a JSON object; with --quiet, alarms alone. With --connect, "
        "type fix LAT,LON,SD for a position that you know, and y to fly a new plan."
    )
    return _follow(parser.parse_args(argv), output)


def _add_watching(parser: CommandArguments) -> None:
    parser.add_argument("--every", type=float, default=60.0, metavar="S", help="seconds between two lines")
    parser.add_argument("--alarm", type=float, default=0.2, metavar="P", help="failure rate that is an alarm")
    parser.add_argument("--flights", type=int, default=1000, metavar="N", help="simulated flights")
    parser.add_argument(
        "--wind-age",
        type=float,
        default=math.inf,
        metavar="H",
        help="age of the forecast [h] that is an alarm",
    )
    parser.add_argument("--bell", action="store_true", help="ring the bell of the terminal at alarms")
    parser.add_argument(
        "--page", type=int, nargs="?", const=0, metavar="PORT", help="show map, belief and promise on a page "
        "of 127.0.0.1 (needs the extra serve); the address is printed",
    )  # fmt: skip
    parser.add_argument(
        "--replan", action="store_true", help="plan the rest again, in a second process, after each position "
        "fix and when the rest fails twice as often as it could",
    )  # fmt: skip
    parser.add_argument(
        "--wind-folder", type=Path, metavar="FOLDER", help="plan the rest again with each new file of this "
        "folder, a newer forecast",
    )  # fmt: skip
    parser.add_argument(
        "--auto", action="store_true", help="follow a new plan that is better without waiting for y"
    )


def _add_sending(parser: CommandArguments) -> None:
    parser.add_argument(
        "--send", metavar="KINDS", default="", help="with --connect, send to the autopilot: wind, heading, "
        "speed, position, prologue, with commas; nothing is sent without it",
    )  # fmt: skip
    parser.add_argument(
        "--ground",
        type=float,
        metavar="M",
        help="height of the start above mean sea level, for --send prologue",
    )
    parser.add_argument(
        "--vehicle",
        type=int,
        default=0,
        metavar="N",
        help="number of the vehicle; default: the first one heard",
    )
    parser.add_argument(
        "--vehicle-clock", action="store_true", help="take the time from the vehicle's clock, for a "
        "simulated vehicle that flies faster than real time",
    )  # fmt: skip
    parser.add_argument(
        "--signing-key", type=Path, metavar="FILE", help="key of MAVLink 2: 64 hexadecimal digits, or a "
        "passphrase; messages without its signature are ignored",
    )  # fmt: skip


def _follow(options: argparse.Namespace, output: Output) -> int:
    from pareto_ltl.inflight.afterwards import draw_watch, truth_summary, write_search_area
    from pareto_ltl.inflight.following import FOLDER, Session
    from pareto_ltl.inflight.replans import ReplanSettings
    from pareto_ltl.inflight.telemetry import Typed
    from pareto_ltl.inflight.watch import WatchSettings
    from pareto_ltl.run.interface import load_results
    from pareto_ltl.support.files import write_json

    _check(options)
    results = load_results(options.directory)
    complain = partial(print, file=sys.stderr, flush=True)
    typed = None if options.connect is None else Typed(sys.stdin, complain)
    readings, listener = _source(options, results.scene, typed)
    session = Session(
        results,
        options.out or options.directory / FOLDER,
        WatchSettings(options.every, options.alarm, options.flights, wind_age=3600.0 * options.wind_age),
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


def _check(options: argparse.Namespace) -> None:
    if options.connect is None:
        for name in ("send", "signing_key", "vehicle"):
            if getattr(options, name):
                word = name.replace("_", "-")
                raise ConfigError(f"--{word} needs --connect: there is no autopilot to talk to")
    if "prologue" in options.send.split(",") and (options.ground is None or not abs(options.ground) < 1e4):
        raise ConfigError("--send prologue needs --ground: the height of the start above mean sea level [m]")
    if not 0 <= options.vehicle <= 255:
        raise ConfigError(f"--vehicle must be 1 to 255, got {options.vehicle}")
    if options.wind_folder is not None and not options.wind_folder.is_dir():
        raise ConfigError(f"--wind-folder {options.wind_folder}: no such folder")
    if options.auto and not options.replan and options.wind_folder is None:
        raise ConfigError("--auto needs --replan or --wind-folder: without them no new plan is made")
    if options.page is not None and not 0 <= options.page <= 65_535:
        raise ConfigError(f"--page must be a port, 0 to 65535, got {options.page}")


def _add_page(session: Session, port: int) -> None:
    """Show the session on a page, whose address is printed."""
    try:
        from pareto_ltl.serve.live import LivePage
    except ImportError:
        raise ConfigError("--page needs starlette and uvicorn: pip install 'pareto-ltl[serve]'") from None
    page = LivePage()
    session.opened, session.listeners = page.opened, [*session.listeners, page.heard]
    print(f"page: {page.serve(port)}", file=sys.stderr, flush=True)


def _shown(event: Event, output: Output) -> str:
    """The line of an event; empty for one that is not shown."""
    from pareto_ltl.inflight.journal import event_line

    if output is Output.JSON:
        return json.dumps(event)
    return event_line(event) if output is not Output.QUIET or event["event"] == "alarm" else ""


def _source(
    options: argparse.Namespace, scene: Scene, typed: Typed | None
) -> tuple[Iterable[Reading] | Path, Listener | None]:
    """The telemetry, and what answers to events."""
    if options.log is not None and options.log.suffix.lower() not in (".tlog", ".bin", ".log"):
        return options.log, None
    from pareto_ltl.inflight.link import Link, LinkSettings, logged_readings, signing_key
    from pareto_ltl.inflight.vehicle import prologue_of

    if options.log is not None:
        return logged_readings(options.log, scene.time_zero, options.departure), None
    sends = tuple(kind for kind in options.send.split(",") if kind)
    if scene.crs is None and (on_earth := {"position", "prologue"} & {*sends}):
        raise ConfigError(f"--send {min(on_earth)}: the map of this plan has no place on Earth; leave it out")
    settings = LinkSettings(
        departure=options.departure, sends=sends, system=options.vehicle,
        key=b"" if options.signing_key is None else signing_key(options.signing_key),
        prologue=prologue_of(scene, options.ground) if "prologue" in sends else (),
        own_clock=options.vehicle_clock,
    )  # fmt: skip
    link = Link(options.connect, scene.time_zero, settings, typed)
    return link.readings(), link.answers
