"""``pareto-ltl show DIR``: the page of a result in the default browser."""

from __future__ import annotations

from collections.abc import Sequence

from pareto_ltl.cli.arguments import CommandArguments


def show_command(argv: Sequence[str]) -> int:
    """Open the page of a result; return 0 with or without a browser."""
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
    if options.print:
        print(path)
    elif open_page(path):
        print(f"opened {path}")
    else:
        print(path)
        print("found no browser: copy this file to a machine with a browser, and open it there")
    return 0
