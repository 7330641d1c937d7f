"""The worker of a desk: ``python -m pareto_ltl_apps.cli.desk_worker`` runs the command lines it reads."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

from pareto_ltl_apps.cli.commands import run_command_line
from pareto_ltl_apps.cli.hydra_app import run_accepted
from pareto_ltl_apps.desk.allowed import check_composed
from pareto_ltl_apps.desk.folder import DeskFolder
from pareto_ltl_apps.desk.missions import COMMANDS
from pareto_ltl_apps.desk.worker import work


def run_at_desk(argv: Sequence[str]) -> int:
    """Run a command line in the folder of a desk, which is the working directory; return the exit code.

    The settings of a new plan are checked once more when they are composed, before anything is read.
    """
    command, *words = argv
    if command not in COMMANDS:
        return run_command_line(argv)
    return run_accepted(words, command, partial(check_composed, DeskFolder.opened(Path())))


if __name__ == "__main__":
    work(run_at_desk)
