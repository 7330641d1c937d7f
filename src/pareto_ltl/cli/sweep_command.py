"""``pareto-ltl sweep``: many runs, or the summary of a sweep written again from its folder."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from pareto_ltl.cli.arguments import CommandArguments
from pareto_ltl.cli.output import Answer, Output, answered
from pareto_ltl.support.errors import ConfigError

if TYPE_CHECKING:
    from pareto_ltl.studies.sweep_summary import SweepSummary


def sweep_command(argv: Sequence[str], output: Output) -> int:
    """Run a sweep if ``argv`` has a setting (key=value), else write the summary of the folder that it names.

    ``pareto-ltl sweep +experiment=phi2 seed=0,1`` is ``pareto-ltl -m +experiment=phi2 seed=0,1``.
    """
    if any("=" in word and not word.startswith("-") for word in argv):
        from pareto_ltl.cli.hydra_app import run_hydra

        return run_hydra(argv, "sweep", output)
    return answered(partial(_summary_of_folder, argv), output)


def _summary_of_folder(argv: Sequence[str]) -> Answer:
    options = _sweep_arguments().parse_args(argv)
    if options.directory is None:
        raise ConfigError(
            "name the folder of a sweep (multirun/phi2), or settings to run (+experiment=phi2 seed=0,1); "
            "see pareto-ltl sweep --help"
        )
    from pareto_ltl.studies.sweep_summary import write_summary
    from pareto_ltl.studies.sweeps import OLDER_SWEEPS, FigureChoice

    figure = FigureChoice(options.x, options.y, options.by)
    found = write_summary(options.directory, options.sweep, figure)
    out = options.directory / OLDER_SWEEPS / options.sweep if options.sweep else options.directory
    return summary_answer(found, out / "summary.html")


def summary_answer(found: SweepSummary, page: Path) -> Answer:
    """The answer of a sweep whose summary is the file ``page``."""
    from pareto_ltl.studies.sweep_summary import summary_content

    return Answer(summary_content(found), [found.line(), f"summary in {page}"], [page])


def _sweep_arguments() -> CommandArguments:
    parser = CommandArguments(
        prog="pareto-ltl sweep",
        usage="pareto-ltl sweep [key=value ...] [group=choice ...]  or  pareto-ltl sweep DIR [options]",
        description="With settings (key=value1,value2): run every combination and write one table; the same "
        "as pareto-ltl -m. With a folder: write summary.csv, timings.csv, summary.json and "
        "summary.html of the sweep in it again.",
    )
    parser.add_argument("directory", type=Path, nargs="?", metavar="DIR", help="for example multirun/phi2")
    parser.add_argument("--sweep", metavar="KEY", help="an older sweep into the same folder: sweeps/KEY.json")
    parser.add_argument("--x", help="horizontal axis of the figure: a swept setting or a metric")
    parser.add_argument("--y", help="vertical axis of the figure: a metric")
    parser.add_argument("--by", help="one color in the figure for each value of this swept setting")
    return parser
