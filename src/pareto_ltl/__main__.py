"""``python -m pareto_ltl``: the command line, an application that is found by its entry point."""

from __future__ import annotations

from pareto_ltl.support.extensions import COMMAND_GROUP, installed_object

if __name__ == "__main__":
    installed_object(COMMAND_GROUP, "pareto-ltl")()
