"""``pareto-ltl explain DIR``: a plan leg by leg, in the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain
from textwrap import wrap

from pareto_ltl.cli.arguments import CommandArguments
from pareto_ltl.cli.choose_command import read_number
from pareto_ltl.cli.output import Answer

COLUMNS = 80
LEG_NUMBER = "  12-14  "  # at the begin of a line on legs


def explain_command(argv: Sequence[str]) -> Answer:
    """A plan leg by leg, or what limits it."""
    parser = CommandArguments(
        prog="pareto-ltl explain",
        description="Print a plan leg by leg: time, heading, airspeed, wind and its standard deviation, "
        "the goal of the leg, the closest obstacle, and the share of flights that have failed by its end.",
    )
    parser.add_result()
    parser.add_point()
    parser.add_argument(
        "--limits", action="store_true", help="show only the segments that come closest to planner.epsilon"
    )
    parser.add_argument(
        "--legs", action="store_true", help="each leg on a line; default: legs of one heading together"
    )
    options = parser.parse_args(argv)
    point = None if options.point is None else read_number(options.point)
    from pareto_ltl.run.showing import explanation

    told = explanation(options.directory, point=point, limits=options.limits, each=options.legs)
    lines = list(chain.from_iterable(map(_in_columns, told.lines)))
    return Answer({"directory": options.directory, **told.document}, lines)


def _in_columns(line: str) -> list[str]:
    """``line`` in lines of at most ``COLUMNS`` characters, those after the first one indented."""
    indent = " " * (len(LEG_NUMBER) if line.startswith(" ") else 2)
    return wrap(line, COLUMNS, subsequent_indent=indent, break_on_hyphens=False) or [line]
