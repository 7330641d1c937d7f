"""The process of a command line: ``python -m pareto_ltl`` and the console script ``pareto-ltl``."""

from __future__ import annotations

import gc
import io
import sys

from pareto_ltl_apps.cli.warm_client import warm_answer

GARBAGE = (50_000, 10, 10)  # objects and rounds between collections: at Python's 700, they take 10 % of a run


def main() -> None:
    """Run the command line and leave with its exit code."""
    if (code := warm_answer(sys.argv[1:])) is not None:
        sys.exit(code)
    from pareto_ltl_apps.cli.commands import run_command_line

    gc.set_threshold(*GARBAGE)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a terminal may lack a character of a message
            stream.reconfigure(errors="replace")
    sys.exit(run_command_line(sys.argv[1:]))
