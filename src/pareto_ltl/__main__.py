"""``python -m pareto_ltl``: the command line, an application that is found by its entry point."""

from __future__ import annotations

from pareto_ltl.support.extensions import COMMANDS


def main() -> None:
    """Run the command line and leave with its exit code."""
    COMMANDS.required("pareto-ltl")()


if __name__ == "__main__":
    main()
