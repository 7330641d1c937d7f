"""``pareto-ltl export DIR``: the plan of a run in the formats of autopilots, maps and navigators."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pareto_ltl.cli.arguments import CommandArguments
from pareto_ltl.cli.choose_command import read_number
from pareto_ltl.cli.output import Answer
from pareto_ltl.settings.outputs import EXPORT_FILES
from pareto_ltl.support.errors import ConfigError
from pareto_ltl.support.messages import shown_value


def export_command(argv: Sequence[str]) -> Answer:
    """Write files of a plan."""
    parser = CommandArguments(
        prog="pareto-ltl export",
        description="Write a plan for autopilots, maps and navigators, in UTC, WGS 84 and true headings: "
        + ", ".join(f"{name} ({file})" for name, file in EXPORT_FILES.items())
        + ". docs/exports.md says what each is.",
    )
    parser.add_result()
    parser.add_point()
    parser.add_argument("--formats", metavar="A,B", help="default: the formats of the run")
    parser.add_argument(
        "--to", type=Path, metavar="DIR2", help="default: DIR/exports, or DIR/exports_point_N"
    )
    parser.add_argument(
        "--altitude", metavar="M", help="height above the start [m]; default: the height of the wind"
    )
    parser.add_argument(
        "--between",
        nargs=2,
        metavar=("LOW", "HIGH"),
        help="heights above the WGS 84 ellipsoid [m], for f3548",
    )
    return _export(parser.parse_args(argv))


def _export(options: argparse.Namespace) -> Answer:
    point = None if options.point is None else read_number(options.point)
    formats = None if options.formats is None else read_formats(options.formats)
    settings: dict[str, Any] = {}
    if options.altitude is not None:
        settings["altitude"] = read_metres("--altitude", options.altitude)
    if options.between is not None:
        low, high = (read_metres("--between", text) for text in options.between)
        settings |= {"altitude_lower": low, "altitude_upper": high}
    from pareto_ltl.run.interface import export

    place = options.directory / ("exports" if point is None else f"exports_point_{point}")
    written = export(options.directory, options.to or place, formats, point=point, **settings)
    return Answer({"files": written}, [str(path) for path in written], written)


def read_formats(text: str) -> list[str]:
    """The formats of ``kml,gpx``; raises ConfigError for an unknown name."""
    names = [name.strip() for name in text.split(",")]
    for name in names:
        if name not in EXPORT_FILES:
            raise ConfigError(
                f"--formats: there is no format {shown_value(name)}; there are {', '.join(EXPORT_FILES)}"
            )
    return list(dict.fromkeys(names))


def read_metres(flag: str, text: str) -> float:
    """A height [m]; raises ConfigError for anything except a number."""
    try:
        return float(text)
    except ValueError:
        raise ConfigError(f"{flag} must be a height in metres, e.g. 120, got {shown_value(text)}") from None
