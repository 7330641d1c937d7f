"""``pareto-ltl show DIR``: the page of a result in the default browser."""

from __future__ import annotations

from collections.abc import Sequence

from pareto_ltl.cli.arguments import CommandArguments
from pareto_ltl.cli.output import Answer


def show_command(argv: Sequence[str]) -> Answer:
    """Open the page of a result; without a browser, only its path is given."""
    parser = CommandArguments(
        prog="pareto-ltl show",
        description="Open report.html of a result in the default browser; it is written first if it is "
        "missing.",
    )
    parser.add_result()
    parser.add_argument("--print", action="store_true", help="only print its path, do not open it")
    parser.add_argument("--again", action="store_true", help="write the page again, even if it exists")
    options = parser.parse_args(argv)
    from pareto_ltl.run.showing import open_page, page_of

    path = page_of(options.directory, again=options.again).resolve()
    opened = not options.print and open_page(path)
    lines = [f"opened {path}" if opened else str(path)]
    if not opened and not options.print:
        lines.append("found no browser: copy this file to a machine with a browser, and open it there")
    return Answer({"page": path, "opened": opened}, lines, [path])
