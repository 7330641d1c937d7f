"""The worker of a desk: ``python -m pareto_ltl.cli.desk_worker`` runs the command lines that it reads."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

from pareto_ltl.cli.commands import run_command_line
from pareto_ltl.cli.hydra_app import run_accepted
from pareto_ltl.serve.allowed import check_composed
from pareto_ltl.serve.folder import DeskFolder
from pareto_ltl.serve.missions import COMMANDS
from pareto_ltl.serve.worker import work


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
