"""``pareto-ltl replan DIR``: the rest of a flight planned again, from a fix or in a new forecast."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from pareto_ltl.cli.arguments import CommandArguments
from pareto_ltl.support.errors import ConfigError
from pareto_ltl.support.messages import shown_value


def replan_command(argv: Sequence[str]) -> int:
    """Write a new plan for the rest of a flight; return 0."""
    parser = CommandArguments(
        prog="pareto-ltl replan",
        description="Plan the rest of a flight of the plan of DIR after a position fix, or in a new "
        "forecast: the wind is conditioned on the fix or read from the forecast, the mission continues from "
        "its state, and the new plan, never worse than the rest of the old one, is written into a results "
        "directory. Without --fix and --wind the rest is unchanged. docs/replanning.md says more.",
    )
    parser.add_result()
    parser.add_argument(
        "--time", required=True, metavar="T", help="2018-10-09T06:00:00Z, 6h or 21600 (s after departure)"
    )
    parser.add_argument(
        "--fix", metavar="LAT,LON,SD", help="measured position [deg] and its standard deviation [m]; "
        "X,Y,SD [m] on a map without a place on Earth; write --fix=... if the first number is negative",
    )  # fmt: skip
    parser.add_argument(
        "--wind", metavar="PATH", help="a newer forecast (GRIB2, NetCDF or CSV), for the rest of the flight"
    )
    parser.add_argument("--full", action="store_true", help="use the refinement settings of DIR")
    parser.add_argument("--out", type=Path, metavar="DIR2", help="default: DIR with _replanned and the time")
    return _replan(parser.parse_args(argv))


def _replan(options: argparse.Namespace) -> int:
    from pareto_ltl.run.interface import replan
    from pareto_ltl.run.replan_files import comparison_lines

    fix = None if options.fix is None else read_fix(options.fix)
    place = options.out or default_place(options.directory, options.time)
    quick, wind = not options.full, options.wind
    done = replan(options.directory, options.time, fix, quick=quick, wind=wind, out=place)
    print("\n".join([*comparison_lines(done), f"results in {place}"]))
    return 0


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
