"""What commands answer before a flight; ``command_table`` has their arguments."""

from __future__ import annotations

from argparse import Namespace
from textwrap import wrap

from pareto_ltl.cli.output import COLUMNS, Answer
from pareto_ltl.support.errors import ConfigError


def contain(options: Namespace) -> Answer:
    """How often the flight leaves its border, and the air that it needs; writes volumes and figure."""
    from pareto_ltl.preflight.containment import contain
    from pareto_ltl.preflight.containment_files import (
        FOLDER,
        containment_document,
        containment_lines,
        write_containment,
    )
    from pareto_ltl.run.results import planned_run

    if options.between is not None and not options.between[0] < options.between[1]:
        low, high = options.between
        raise ConfigError(f"--between needs a lower and a higher height [m], got {low:g} and {high:g}")
    run = planned_run(options.directory)
    found = contain(
        run, corridor=options.corridor, volume=options.volume, levels=options.levels, flights=options.flights
    )
    folder = options.out or options.directory / FOLDER
    band = None if options.between is None else (options.between[0], options.between[1])
    write_containment(run, found, folder, band)
    lines = [part for line in containment_lines(found, run.settings.medium.flows) for part in _wrapped(line)]
    document = {"directory": folder, **containment_document(found)}
    return Answer(document, [*lines, f"volumes and figure in {folder}"], [folder])


def _wrapped(line: str) -> list[str]:
    """``line`` in lines of at most ``COLUMNS`` characters; those after an indented one are indented too."""
    indent = "  " if line.startswith("  ") else ""
    return wrap(line, COLUMNS, subsequent_indent=indent, break_on_hyphens=False)
