"""``pareto-ltl replan DIR``: the rest of a flight planned again, from position fixes or a newer forecast."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from pareto_ltl.cli.arguments import CommandArguments
from pareto_ltl.cli.output import Answer
from pareto_ltl.support.errors import ConfigError
from pareto_ltl.support.messages import shown_value


def replan_command(argv: Sequence[str]) -> Answer:
    """Write a new plan for the rest of a flight."""
    parser = CommandArguments(
        prog="pareto-ltl replan",
        description="Plan the rest of a flight of the plan of DIR after position fixes, or with a newer "
        "forecast: the wind is conditioned on the fixes or read anew, the mission continues from its state, "
        "and the new plan is written into a results directory. Without --fix, --fixes and --wind the rest "
        "of the "
        "plan is unchanged. docs/replanning.md says more.",
    )
    parser.add_result()
    parser.add_argument(
        "--time", metavar="T", help="2018-10-09T06:00:00Z, 6h or 21600 (s after departure); with --fixes it "
        "is the time of the last fix",
    )  # fmt: skip
    parser.add_argument(
        "--fix", metavar="LAT,LON,SD", help="measured position [deg] and its standard deviation [m]; "
        "X,Y,SD [m] on a map without a place on Earth; write --fix=... if the first number is negative",
    )  # fmt: skip
    parser.add_argument(
        "--fixes", type=Path, metavar="FILE.csv", help="several fixes: columns time,lat,lon,sd_m or "
        "time,x,y,sd_m, with times as for --time",
    )  # fmt: skip
    parser.add_argument(
        "--wind", metavar="PATH", help="a newer forecast for the rest of the flight: a file or folder for "
        "the reader of the plan's wind",
    )  # fmt: skip
    parser.add_argument("--full", action="store_true", help="use the refinement settings of DIR")
    parser.add_argument("--out", type=Path, metavar="DIR2", help="default: DIR with _replanned and the time")
    return _replan(parser.parse_args(argv))


def _replan(options: argparse.Namespace) -> Answer:
    from pareto_ltl.run.replanning import comparison_lines, replan, replan_document

    if options.time is None and options.fixes is None:
        raise ConfigError(
            "replan needs --time, e.g. --time 6h, or --fixes FILE.csv with the times of the fixes"
        )
    fix = None if options.fix is None else read_fix(options.fix)
    place = options.out or default_place(options.directory, options.time or options.fixes.stem)
    done = replan(
        options.directory, options.time, fix, fixes=options.fixes, wind=options.wind, quick=not options.full,
        out=place,
    )  # fmt: skip
    document = {"directory": place, "advice": done.advice, **replan_document(done, str(options.directory))}
    return Answer(document, [*comparison_lines(done), f"results in {place}"], [place])


def read_fix(text: str) -> tuple[float, ...]:
    """Three numbers; raises ConfigError for anything else."""
    try:
        numbers = tuple(float(part) for part in text.split(","))
    except ValueError:
        numbers = ()
    if len(numbers) != 3:
        raise ConfigError(
            f"--fix must be LAT,LON,SD (or X,Y,SD), e.g. 37.5,-93.2,500, got {shown_value(text)}"
        )
    return numbers


def default_place(directory: Path, time: str) -> Path:
    """A folder beside ``directory``, with the time in its name."""
    directory = directory.resolve()
    kept = "".join(letter for letter in time if letter.isalnum())
    return directory.with_name(f"{directory.name}_replanned_{kept}")
