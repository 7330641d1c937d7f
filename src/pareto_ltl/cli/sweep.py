"""``python -m pareto_ltl.cli.sweep DIR``: the summary of a sweep, from its directories alone."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import NoReturn

from pareto_ltl.support.errors import ConfigError, ParetoLtlError


class _Arguments(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise ConfigError(f"{message}; see python -m pareto_ltl.cli.sweep --help")


def main(argv: list[str]) -> int:
    """Write the summary; 0, or 2 with one line."""
    try:
        options = _arguments().parse_args(argv)
        from pareto_ltl.studies.sweeps.manifest import OLDER_SWEEPS, FigureChoice
        from pareto_ltl.studies.sweeps.summary import write_summary

        figure = FigureChoice(options.x, options.y, options.by)
        found = write_summary(options.directory, options.sweep, figure)
        out = options.directory / OLDER_SWEEPS / options.sweep if options.sweep else options.directory
        print(f"{found.line()}\nsummary in {out / 'summary.html'}")
    except SystemExit as leave:  # --help
        return int(leave.code or 0)
    except (ParetoLtlError, OSError) as error:
        print(f"pareto-ltl: {error}", file=sys.stderr)
        return 2
    return 0


def _arguments() -> argparse.ArgumentParser:
    parser = _Arguments(
        prog="python -m pareto_ltl.cli.sweep",
        description="Write summary.csv, timings.csv, summary.json and summary.html of a sweep anew.",
    )
    parser.add_argument("directory", type=Path, help="for example multirun/phi2")
    parser.add_argument("--sweep", metavar="KEY", help="an older sweep into the same folder: sweeps/KEY.json")
    parser.add_argument("--x", help="the figure: a swept setting or a metric")
    parser.add_argument("--y", help="the figure: a metric")
    parser.add_argument("--by", help="the figure: one colour for each value of this swept setting")
    return parser


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
