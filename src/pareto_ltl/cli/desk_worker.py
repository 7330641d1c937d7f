"""The worker of a desk: ``python -m pareto_ltl.cli.desk_worker`` runs the command lines that it reads."""

from __future__ import annotations

from pareto_ltl.cli.commands import run_command_line
from pareto_ltl.serve.worker import work

if __name__ == "__main__":
    work(run_command_line)
