"""What commands answer before a flight; ``command_table`` has their arguments."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Sequence
from textwrap import wrap

from careful_io.messages import shown_value, wrong_value
from pareto_ltl.support.errors import ConfigError
from pareto_ltl_apps.cli.output import COLUMNS, Answer

NO_GO = 3  # exit code; 1 is for a crash, 2 for an input that cannot be read


def contain(options: Namespace) -> Answer:
    """How often the flight leaves its border, and the air that it needs; writes volumes and figure."""
    from pareto_ltl.extend import planned_run
    from pareto_ltl_apps.preflight.containment import contain
    from pareto_ltl_apps.preflight.containment_files import (
        FOLDER,
        containment_document,
        containment_lines,
        write_containment,
    )

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


def check(options: Namespace) -> Answer:
    """GO (exit code 0) or NO-GO (3) for a plan in a newer forecast."""
    from pareto_ltl.extend import planned_run
    from pareto_ltl_apps.preflight.check import check, check_document, check_lines
    from pareto_ltl_apps.preflight.check_files import FOLDER, write_check

    if options.wind is None:
        raise ConfigError("check needs the newer forecast: --wind FILE, e.g. --wind newer.grib2")
    limits = read_limits(options.settings)
    wind_limit = limits.pop("robot.wind_limit", None)
    run = planned_run(options.directory)
    found = check(
        run, options.wind, limits={key.removeprefix("limits."): value for key, value in limits.items()},
        wind_limit=wind_limit, volume=options.volume, flights=options.flights,
    )  # fmt: skip
    folder = options.out or options.directory / FOLDER
    write_check(run, found, folder)
    lines = [part for line in check_lines(found) for part in _wrapped(line)]
    document = {"directory": folder, **check_document(found)}
    return Answer(document, lines, [folder], 0 if found.go else NO_GO)


def read_limits(words: Sequence[str]) -> dict[str, float]:
    """The limits of words ``limits.KEY=VALUE`` and ``robot.wind_limit=VALUE``.

    Raises
    ------
    ConfigError
        If a word is none of these, or its value no number.
    """
    found = {}
    for word in words:
        key, equals, value = word.partition("=")
        if not equals or not (key.startswith("limits.") or key == "robot.wind_limit"):
            raise ConfigError(
                f"{shown_value(word)} is not known; expected limits.KEY=VALUE or robot.wind_limit=VALUE"
            )
        try:
            found[key] = float(value)
        except ValueError:
            raise wrong_value(key, "be a number", value) from None
    return found


def _wrapped(line: str) -> list[str]:
    """``line`` in lines of at most ``COLUMNS`` characters; those after an indented one are indented too."""
    indent = "  " if line.startswith("  ") else ""
    return wrap(line, COLUMNS, subsequent_indent=indent, break_on_hyphens=False)
