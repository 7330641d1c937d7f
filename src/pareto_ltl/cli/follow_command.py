"""``pareto-ltl follow DIR``: a flight watched against its plan."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterable, Sequence
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

from pareto_ltl.cli.arguments import CommandArguments
from pareto_ltl.cli.output import Output
from pareto_ltl.support.errors import ConfigError

if TYPE_CHECKING:
    from pareto_ltl.inflight.following import Listener
    from pareto_ltl.inflight.telemetry import Reading
    from pareto_ltl.inflight.watch import Event, Watch
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
    parser.add_argument("--every", type=float, default=60.0, metavar="S", help="seconds between two lines")
    parser.add_argument("--alarm", type=float, default=0.2, metavar="P", help="failure rate that is an alarm")
    parser.add_argument("--flights", type=int, default=1000, metavar="N", help="simulated flights")
    parser.add_argument(
        "--send", metavar="KINDS", default="", help="with --connect, send to the autopilot: wind, heading, "
        "speed, position, with commas; nothing is sent without it",
    )  # fmt: skip
    parser.add_argument(
        "--replan", action="store_true", help="plan the rest again after each position fix, in a second "
        "process; the pilot decides which plan is flown",
    )  # fmt: skip
    parser.epilog = "With --json, each event is one line with a JSON object; with --quiet, alarms alone."
    return _follow(parser.parse_args(argv), output)


def _follow(options: argparse.Namespace, output: Output) -> int:
    from pareto_ltl.inflight.following import follow
    from pareto_ltl.inflight.journal import read_journal, require_place
    from pareto_ltl.inflight.picture import draw_watch
    from pareto_ltl.inflight.replans import Replans
    from pareto_ltl.inflight.search_area import write_search_area
    from pareto_ltl.inflight.watch import WatchSettings
    from pareto_ltl.run.interface import load_results

    if options.send and options.connect is None:
        raise ConfigError("--send needs --connect: there is no autopilot to send to")
    folder = options.out or options.directory / "follow"
    settings = WatchSettings(options.every, options.alarm, options.flights)
    results = load_results(options.directory)
    readings, listener = _source(options, results.scene)
    earlier = read_journal(require_place(folder, resume=True)) if options.resume else ()
    replans = Replans(options.directory, folder, earlier)
    listeners = [one for one in (listener, replans.answers if options.replan else None) if one is not None]

    def answers(watch: Watch, event: Event) -> Iterable[Event]:
        return chain.from_iterable(one(watch, event) for one in listeners)

    watched = follow(
        results, readings, out=folder, resume=options.resume, settings=settings, listener=answers
    )
    end = None
    try:
        for event in watched:
            end = event if event["event"] == "end" else end
            if line := _shown(event, output):
                print(line, flush=True)
    except KeyboardInterrupt:
        print("ended by the user; pareto-ltl follow ... --resume continues", file=sys.stderr)
    finally:
        replans.stop()
    if end is not None:
        write_search_area(results.scene, end, folder)
    picture = draw_watch(results, folder)
    written = "journal, figure and search area" if picture else "journal"
    print(f"{written} in {folder}", file=sys.stderr)
    return 0


def _shown(event: Event, output: Output) -> str:
    """The line of an event; empty for one that is not shown."""
    from pareto_ltl.inflight.lines import event_line

    if output is Output.JSON:
        return json.dumps(event)
    return event_line(event) if output is not Output.QUIET or event["event"] == "alarm" else ""


def _source(options: argparse.Namespace, scene: Scene) -> tuple[Iterable[Reading] | Path, Listener | None]:
    """The telemetry, and what answers to events."""
    if options.log is not None and options.log.suffix.lower() not in (".tlog", ".bin", ".log"):
        return options.log, None
    from pareto_ltl.inflight.link import Link, logged_readings

    if options.log is not None:
        return logged_readings(options.log, scene.time_zero, options.departure), None
    sends = [kind for kind in options.send.split(",") if kind]
    if "position" in sends and scene.crs is None:
        raise ConfigError("--send position: the map of this plan has no place on Earth; leave it out")
    link = Link(options.connect, scene.time_zero, options.departure, sends)
    return link.readings(), link.answers
