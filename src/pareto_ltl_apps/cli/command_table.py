"""The commands of ``pareto-ltl``, in one table: name, meaning, arguments, and the function that answers.

``commands`` reads a command line by the row of its command, and runs it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from math import inf
from pathlib import Path
from typing import Any, NamedTuple

from careful_io.messages import shown_value
from pareto_ltl.support.errors import ConfigError
from pareto_ltl_apps.cli import arguments as read
from pareto_ltl_apps.cli.arguments import accepted
from pareto_ltl_apps.exports.kinds import FORMATS
from pareto_ltl_apps.studies.kinds import STUDIES


class Argument(NamedTuple):
    """An argument of a command: its name on the command line, and how :mod:`argparse` reads it."""

    name: str
    options: Mapping[str, Any]


def argument(name: str, metavar: str | tuple[str, ...] | None, meaning: str, **options: Any) -> Argument:
    """An argument with a value."""
    return Argument(name, {"metavar": metavar, "help": meaning, **options})


def flag(name: str, meaning: str) -> Argument:
    """An argument without a value."""
    return Argument(name, {"action": "store_true", "help": meaning})


@dataclass(frozen=True, slots=True)
class Command:
    """A command and its meaning in the list of all."""

    name: str
    meaning: str


@dataclass(frozen=True, slots=True)
class PipelineCommand(Command):
    """A command that runs the pipeline of its name; its help explains ``sections`` of the settings first."""

    sections: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class ToolCommand(Command):
    """A command with arguments.

    Attributes
    ----------
    target : str
        ``MODULE.FUNCTION`` in ``cli``. The function takes the values of the arguments and returns an
        :class:`~pareto_ltl_apps.cli.output.Answer`.
    purpose : str
        The first paragraph of its help.
    arguments : tuple
        A row in brackets holds arguments that exclude each other, of which one must be given.
    streams : bool
        Whether it prints while it works: its function also takes the output, and returns the exit code.
    """

    target: str
    purpose: str
    arguments: tuple[Argument | tuple[Argument, ...], ...] = ()
    streams: bool = False
    usage: str | None = None


PIPELINE_COMMANDS = (
    PipelineCommand("plan", "plan a mission, simulate the plan and draw it",
                    ("mission", "planner", "selection")),
    *(PipelineCommand(kind.command, kind.purpose, kind.sections) for kind in STUDIES.values()),
    PipelineCommand("wind", "the wind over a map and its standard deviation, without a plan",
                    ("wind", "scene")),
    PipelineCommand("ingest", "wind files to one small table of readings", ("ingest", "wind")),
)  # fmt: skip
DIR = argument("directory", "DIR", "for example outputs/phi2/2026-01-31_12-00-00", type=Path)
POINT = argument("--point", "N", "path number N of front.csv; default: the plan", type=read.read_number)
PORT = accepted(int, lambda port: 0 <= port <= 65_535, "a port, 0 to 65535")
TOOL_COMMANDS = (
    ToolCommand(
        "sweep", "many runs and one table; with a folder, its summary written again", "other_commands.sweep",
        "With settings (key=value1,value2): run every combination and write one table; the same as "
        "pareto-ltl -m. With a folder: write summary.csv, timings.csv, summary.json and summary.html of the "
        "sweep in it again.",
        (
            argument("folder", "DIR", "for example multirun/phi2", type=Path, nargs="?"),
            argument("--sweep", "KEY", "an older sweep into the same folder: sweeps/KEY.json"),
            argument("--x", None, "horizontal axis of the figure: a swept setting or a metric"),
            argument("--y", None, "vertical axis of the figure: a metric"),
            argument("--by", None, "one color in the figure for each value of this swept setting"),
        ),
        usage="pareto-ltl sweep [key=value ...] [group=choice ...]  or  pareto-ltl sweep DIR [options]",
    ),
    ToolCommand(
        "formula", "the meaning of a mission formula", "other_commands.formula",
        "Show what a mission formula means: normal form, automaton, whether extra visits are harmful.",
        (
            argument("formula", None, "for example 'F(a & F b)'"),
            flag("--disjoint", "no two regions overlap: each letter has at most one name"),
            argument("--max-states", None, "stop beyond this many (default 10000)", type=int, default=10_000),
            argument("--picture", "FILE", "draw the automaton (png, svg, pdf)"),
            argument("--dot", "FILE", "write it as Graphviz text"),
            argument("--hoa", "FILE", "write it in the HOA format"),
        ),
    ),
    ToolCommand(
        "front", "the paths of the front: failure rate, length and the other costs", "result_commands.front",
        "Show the paths of the front of DIR: failure rate, length, duration and further costs. The plan is "
        "marked. front.csv has more columns.",
        (DIR,),
    ),
    ToolCommand(
        "choose", "another path of the front as the plan, without planning again", "result_commands.choose",
        "Write the plan of another path of a front, without planning again: a whole results directory, with "
        "the bytes of a run with that selection. front.csv of DIR lists the paths.",
        (
            DIR,
            (
                argument("--failure", "P", "the shortest path with at most this failure rate: 0.02 or 2%%",
                         type=read.read_share),
                argument("--energy", "P", "the path with the least energy and at most this failure rate: "
                         "0.02 or 2%%", type=partial(read.read_share, flag="--energy")),
                argument("--length", "L", "the safest path of at most this length: 1900km, 1.9e6 (m), "
                         "1020nmi", type=read.read_length),
                flag("--knee", "the knee of the front: beyond it, a lower failure rate costs the most "
                     "length"),
                argument("--point", "N", "path number N of front.csv", type=read.read_number),
                argument("--rule", "NAME", "the path that this rule picks, one of selection.rule; also of "
                         "another package"),
            ),
            argument("settings", "selection.KEY=VALUE", "with --rule: what the rule reads, e.g. "
                     "selection.weights=[0.8,0.1,0.1] or selection.options.KEY=VALUE", nargs="*"),
            argument("--out", "DIR2", "default: DIR with the choice added to its name", type=Path),
        ),
    ),
    ToolCommand(
        "export", "the plan for autopilots, maps and navigators: KML, GPX, MAVLink and others",
        "result_commands.export",
        "Write a plan for autopilots, maps and navigators, in UTC, WGS 84 and true headings: "
        + ", ".join(f"{name} ({one.file})" for name, one in FORMATS.items())
        + ". docs/exports.md says what each is.",
        (
            DIR,
            POINT,
            argument("--formats", "A,B", "default: the formats of the run", type=read.read_formats),
            argument("--to", "DIR2", "default: DIR/exports, or DIR/exports_point_N", type=Path),
            argument("--altitude", "M", "height of the flight above the start [m], if the run states none",
                     type=partial(read.read_metres, "--altitude")),
            argument("--between", ("LOW", "HIGH"), "heights above the WGS 84 ellipsoid [m], for f3548",
                     nargs=2, type=partial(read.read_metres, "--between")),
        ),
    ),
    ToolCommand(
        "serve", "the planning desk: draw a mission in a browser, plan it, take the plan",
        "other_commands.serve",
        "Draw missions, plan them and take the plans, in a browser of this machine. The first line of the "
        "output is the address, with a token that each request needs; only 127.0.0.1 is served. docs/desk.md "
        "describes the page and its API.",
        (
            argument("--port", "N", "default 0: a free port", type=PORT, default=0),
            flag("--no-browser", "only print the address"),
            argument("--folder", "DIR", "for maps, winds and results, the only folder that is read and "
                     "written (default: desk)", type=Path, default=Path("desk")),
        ),
        streams=True,
    ),
    ToolCommand(
        "show", "the page of a result, in a browser", "result_commands.show",
        "Open report.html of a result in the default browser, after it is written from the results.",
        (
            DIR,
            flag("--print", "only print its path, do not open it"),
            flag("--as-is", "the page that is in DIR: open only your own, as its scripts run in the browser"),
        ),
    ),
    ToolCommand(
        "explain", "a plan leg by leg, in the terminal", "result_commands.explain",
        "Print a plan leg by leg: time, heading, airspeed, wind and its standard deviation, the goal of the "
        "leg, the closest obstacle, and the share of flights that have failed by its end.",
        (
            DIR,
            POINT,
            flag("--limits", "show only the segments that come closest to planner.epsilon"),
            flag("--legs", "each leg on a line; default: legs of one heading together"),
            flag("--branches", "show only where the plan branches, and which table to fly then"),
        ),
    ),
    ToolCommand(
        "replan", "the rest of a flight planned again, from a position fix or in a new forecast",
        "result_commands.replan",
        "Plan the rest of a flight of the plan of DIR after position fixes, or with a newer forecast: the "
        "wind is conditioned on the fixes or read anew, the mission continues from its state, and the new "
        "plan is written into a results directory. Without --fix, --fixes and --wind the rest of the plan is "
        "unchanged. docs/replanning.md says more.",
        (
            DIR,
            argument("--time", "T", "2018-10-09T06:00:00Z, 6h or 21600 (s after departure); with --fixes it "
                     "is the time of the last fix"),
            argument("--fix", "LAT,LON,SD", "measured position [deg] and its standard deviation [m]; X,Y,SD "
                     "[m] on a map without a place on Earth",
                     type=read.read_fix),
            argument("--fixes", "FILE.csv", "several fixes: columns time,lat,lon,sd_m or time,x,y,sd_m, with "
                     "times as for --time", type=Path),
            argument("--wind", "PATH", "a newer forecast for the rest of the flight: a file or folder for "
                     "the reader of the plan's wind"),
            flag("--full", "use the refinement settings of DIR"),
            argument("--out", "DIR2", "default: DIR with _replanned and the time", type=Path),
        ),
    ),
    ToolCommand(
        "follow", "a flight watched: where the robot is, what the rest of the plan promises, alarms",
        "follow_command.follow",
        "Watch a flight of the plan of DIR: where the robot is believed to be from its headings, airspeeds "
        "and position fixes, how often the rest of the plan fails from there, and alarms. With --log after "
        "the flight, with --connect during it. Writes follow.jsonl and follow.png. With --json, each event "
        "is one line with a JSON object; with --quiet, alarms alone. With --connect, type fix LAT,LON,SD for "
        "a position that you know, and y to fly a new plan. docs/follow.md says more.",
        (
            DIR,
            (
                argument("--log", "FILE", "telemetry: a CSV file with the columns "
                         "time,heading_true,airspeed_tas_m_s (or airspeed_cas_m_s, if it is calibrated) and, "
                         "where measured, lat,lon,fix_sd_m; or a .tlog, .bin or .log file", type=Path),
                argument("--connect", "ADDRESS", "MAVLink, e.g. udpin:127.0.0.1:14550 or /dev/ttyUSB0,57600 "
                         "(needs the extra follow)"),
            ),
            argument("--departure", "TIME", "when the robot departed, for MAVLink: now (the first message) "
                     "or a time in UTC; default: the departure of the plan"),
            argument("--out", "FOLDER", "default: the folder follow in DIR", type=Path),
            flag("--resume", "continue the journal of a watch that ended"),
            argument("--truth", "FILE", "true positions, known afterwards: a CSV file with the columns "
                     "time,lat,lon; truth.json says how often the ellipses held them", type=Path),
            argument("--every", "S", "seconds between two lines; events and alarms have lines at once, and "
                     "alarms are looked for every minute", type=float, default=600.0),
            argument("--alarm", "P", "failure rate that is an alarm, and again when it doubles", type=float,
                     default=0.2),
            argument("--flights", "N", "simulated flights", type=int, default=1000),
            argument("--wind-age", "H", "age of the forecast [h] that is an alarm", type=float, default=inf),
            flag("--bell", "ring the bell of the terminal at alarms"),
            argument("--page", "PORT", "show map, belief and promise on a page of 127.0.0.1 (needs the extra "
                     "serve); the address is printed", type=PORT, nargs="?", const=0),
            flag("--replan", "plan the rest again, in a second process, after each position fix and when the "
                 "rest fails twice as often as it could"),
            argument("--wind-folder", "FOLDER", "plan the rest again with each new file of this folder, a "
                     "newer forecast", type=Path),
            flag("--auto", "follow a new plan that is better without waiting for y"),
            argument("--send", "KINDS", "with --connect, send to the autopilot: wind, heading, speed, "
                     "position, prologue, with commas; nothing is sent without it", default=""),
            argument("--ground", "M", "height of the start above mean sea level, for --send prologue",
                     type=float),
            argument("--vehicle", "N", "number of the vehicle; default: the first one heard",
                     type=accepted(int, lambda n: 0 <= n <= 255, "a vehicle, 1 to 255"), default=0),
            flag("--vehicle-clock", "take the time from the vehicle's clock, for a simulated vehicle that "
                 "flies faster than real time"),
            argument("--signing-key", "FILE", "key of MAVLink 2: 64 hexadecimal digits, or a passphrase; "
                     "messages without its signature are ignored", type=Path),
        ),
        streams=True,
    ),
    ToolCommand(
        "beacons", "where a beacon would reduce the failure of a plan most", "result_commands.beacons",
        "Find the places along and beside the plan of DIR where a beacon, within whose radius the robot "
        "measures its position, reduces the failure most. The plan stays as it is: plan again with the "
        "beacon on the map to use it fully. Writes beacons.csv, beacons.txt and beacons.png.",
        (
            DIR,
            argument("--radius", "M", "of a beacon [m]; default: 2 %% of the map", type=float),
            argument("--number", "N", "beacons to place, 1 to 3", type=int, default=1),
            argument("--flights", "N", "flights that compare places", type=int, default=2000),
            argument("--out", "FOLDER", "default: the folder beacons in DIR", type=Path),
        ),
    ),
    ToolCommand(
        "contain", "how often a flight leaves its border, and the smallest volumes that hold it",
        "preflight_commands.contain",
        "Compute how often flights of the plan of DIR leave the drawn border, corridors and a given volume, "
        "in all and per flight hour, and the smallest volumes, by leg and time, that they leave with given "
        "probabilities. Writes containment.json, volumes for maps and containment.png. docs/contain.md says "
        "more.",
        (
            DIR,
            argument("--corridor", "W", "whole width of a corridor along the route, e.g. 20km; several with "
                     "spaces", type=partial(read.read_length, flag="--corridor"), nargs="+", default=()),
            argument("--volume", "FILE", "a volume: GeoJSON areas, or an operational intent (F3548)",
                     type=Path),
            argument("--levels", "P", "probabilities of leaving per flight hour (default 1e-2 1e-3 1e-4)",
                     type=float, nargs="+", default=(1e-2, 1e-3, 1e-4)),
            argument("--flights", "N", "flights of each sample (default 10000)", type=int, default=10_000),
            argument("--between", ("LOW", "HIGH"), "heights above the WGS 84 ellipsoid [m], for operational "
                     "intents", nargs=2, type=partial(read.read_metres, "--between")),
            argument("--out", "FOLDER", "default: the folder containment in DIR", type=Path),
        ),
    ),
    ToolCommand(
        "check", "go or wait: a finished plan in a newer forecast, by your own limits",
        "preflight_commands.check",
        "Compare the plan of DIR with a newer forecast: failure, containment, energy, the wind against the "
        "limits of the vehicle, and what changed. The answer is GO or NO-GO with its reasons; the exit code "
        "is 0 or 3. Writes check.json and check.png. docs/check.md says more.",
        (
            DIR,
            argument("--wind", "PATH", "the newer forecast: a file or folder for the reader of the plan's "
                     "wind"),
            argument("settings", "limits.KEY=VALUE", "your limits, where the settings of DIR have others: "
                     "limits.failure=0.05 limits.containment=1e-3 limits.energy=0.8 limits.takeoff_wind=8 "
                     "robot.wind_limit=12", nargs="*"),
            argument("--volume", "FILE", "a volume for limits.containment, as for contain; default: the "
                     "border", type=Path),
            argument("--flights", "N", "flights in each forecast (default 10000)", type=int, default=10_000),
            argument("--out", "FOLDER", "default: the folder check in DIR", type=Path),
        ),
    ),
    ToolCommand(
        "rerun", "make a result again and compare it byte by byte", "rerun_command.rerun",
        "Make a result again from its settings and compare both, byte by byte. Nothing is written outside "
        "the second folder. The exit code is 0 if both are the same, 1 if they differ. Settings that connect "
        "to a server or a cluster, or read other files than the run did, are refused unless you give them.",
        (
            DIR,
            argument("settings", "KEY=VALUE", "what the settings of DIR may not do by themselves, e.g. "
                     "wind.source=noaa, evaluation.cluster=tcp://10.0.0.1:8786 or wind.path=FILE", nargs="*"),
            argument("--into", "FOLDER", "keep the second result there", type=Path),
        ),
    ),
    ToolCommand(
        "verify", "derive every claim of a result again, without the planner", "result_commands.verify",
        "Recompute every claim of a result from its files, with code that shares nothing with the planner; "
        "exit code 3 if one fails.",
        (
            DIR,
            flag("--failed-only", "show only claims that fail"),
            argument("--source", "PATH", "a wind file of the run, or their folder, if moved", type=Path),
        ),
    ),
    ToolCommand(
        "scores", "the promises of a forecast test against what came, or two tests compared",
        "other_commands.scores",
        "Compare what the forecast test in DIR promised with what came: isotonic reliability, a Murphy "
        "diagram, skill over simple promises and, with OTHER, a Diebold-Mariano test against another "
        "forecast test of the same missions, for example of another version. Draws scores_FIDELITY.png and "
        ".svg. Needs the extra scores.",
        (
            argument("folder", "DIR", "the results directory of a forecast test", type=Path),
            argument("other", "OTHER", "another forecast test", type=Path, nargs="?"),
            argument("--fidelity", "NAME", "preset of planning; default: the first in DIR"),
            argument("--names", "NAME", "of DIR and OTHER in the figure; default: their folders", nargs=2),
            argument("--out", "FOLDER", "default: the folder scores in DIR", type=Path),
        ),
    ),
    ToolCommand(
        "wind-error", "the law of forecast errors, from past forecasts and analyses",
        "wind_error_command.wind_error",
        "Estimate the error of forecasts and the change of the wind from a folder of past GRIB files, "
        "analyses among them, and write the law as JSON and as a figure (.png, .svg beside it). Plan with "
        "it: wind.forecast_error=FILE.json. From a table of forecasts by run, place and lead (.csv, .nc, "
        ".npz) a law of parts is estimated, with a page (.html); --check compares a table with a law.",
        (
            argument("folder", "DIR", "folder of GRIB files of one grid, or a table of forecasts", type=Path,
                     nargs="?"),
            argument("--check", "TABLE", "table of forecasts: how often its errors stay within the intervals "
                     "of --law", type=Path),
            argument("--law", None, "for --check: a packaged law of parts, or its file"),
            argument("--out", "FILE.json", "output file (default wind_error.json)",
                     type=Path, default=Path("wind_error.json")),
            argument("--level", None, "level of the winds, for example 80m or 925hPa", default="10m"),
            argument("--area", "CORNERS", "outline of the nodes, 'lon,lat lon,lat ...', or all (default: the "
                     "contiguous United States without their rim)"),
            argument("--stations", "FILE", "METAR tables of the same times, for the error of analyses",
                     type=Path, nargs="+", default=()),
            argument("--name", None, "name of the law in reports (default: name of the folder)",
                     type=accepted(str, lambda name: 0 < len(name) <= 200,
                                   "a name: a name has 1 to 200 characters")),
            argument("--max-lag", "HOURS", "longest change of the wind (default 48)", default=48.0,
                     type=accepted(float, lambda hours: 0 < hours < 1e6, "a number of hours above 0")),
            argument("--seed", None, "of the bootstrap (default 0)", default=0, type=accepted(
                int, lambda n: 0 <= n < 2**63, "a seed; expected an integer of 0 or more")),
            argument("--block", "CYCLES", "successive cycles that the bootstrap draws together (default: the "
                     "cube root of their number)",
                     type=accepted(int, lambda n: n >= 1, "a number of cycles, at least 1")),
        ),
    ),
    ToolCommand(
        "warmup", "compile what a kind of run needs, before its first run", "other_commands.warmup",
        "Compile the kernels of a kind of run, which its first run would do otherwise, and keep the machine "
        "code. A small mission is planned for it. Without KIND: runs with default settings.",
        (
            argument("kinds", "KIND", "for example paper; --list shows all", nargs="*"),
            flag("--all", "all kinds of runs; takes some minutes"),
            flag("--list", "show the kinds, and compile nothing"),
            argument("--jobs", "N", "kinds compiled at the same time", type=int, default=1),
        ),
    ),
    ToolCommand(
        "warm", "a process that has loaded everything and answers plans at once", "warm_process.warm",
        "Start a process beside this one that has loaded what a plan needs. It answers the plans of the same "
        "user on this machine, with the same results, as long as it lives; without it they run as always. It "
        "ends by itself. Linux only. docs/speed.md says more.",
        (
            argument("--minutes", "M", "idle time after which it ends (default 10)", default=10.0,
                     type=accepted(float, lambda minutes: 0 < minutes <= 1e4, "a number of minutes above 0")),
            flag("--stop", "end it, once the runs that it has begun have ended"),
            flag("--foreground", "be the process, instead of starting it"),
        ),
    ),
    ToolCommand(
        "cache", "folder and size of the cache; cache clear empties it", "other_commands.cache",
        "Show folder and size of the cache (fits of the wind, downloads), or empty it.",
        (argument("action", None, "size or clear", nargs="?", choices=("size", "clear"), default="size"),),
    ),
)  # fmt: skip
COMMANDS: tuple[Command, ...] = (*PIPELINE_COMMANDS, *TOOL_COMMANDS)


def command_named(name: str) -> Command:
    """The command of that name; raises ConfigError with the closest name if there is none."""
    from difflib import get_close_matches

    table = {command.name: command for command in COMMANDS}
    if name not in table:
        near = get_close_matches(name, table, n=1)
        hint = f"did you mean {near[0]}?" if near else f"there are {', '.join(table)}"
        raise ConfigError(f"unknown command {shown_value(name)}; {hint} (a setting is written key=value)")
    return table[name]
