"""``pareto-ltl serve``: the planning desk in a browser of this machine."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

from pareto_ltl.cli.arguments import CommandArguments
from pareto_ltl.cli.output import Answer, Output, print_answer
from pareto_ltl.support.errors import ConfigError

DEFAULT_FOLDER = Path("desk")
LARGEST_PORT = 65535


def serve_command(argv: Sequence[str], output: Output) -> int:
    """Serve the desk until Ctrl-C or a signal; return 0."""
    parser = CommandArguments(
        prog="pareto-ltl serve",
        description="Draw missions, plan them and take the plans, in a browser of this machine. The first "
        "line of the output is the address, with a token that each request needs; only 127.0.0.1 is served. "
        "docs/desk.md describes the page and its API.",
    )
    parser.add_argument("--port", type=int, default=0, metavar="N", help="default 0: a free port")
    parser.add_argument("--no-browser", action="store_true", help="only print the address")
    parser.add_argument(
        "--folder", type=Path, default=DEFAULT_FOLDER, metavar="DIR",
        help="for maps, winds and results, the only folder that is read and written (default: desk)",
    )  # fmt: skip
    options = parser.parse_args(argv)
    if not 0 <= options.port <= LARGEST_PORT:
        raise ConfigError(f"--port must be between 0 and {LARGEST_PORT}, got {options.port}")
    if missing := [name for name in ("starlette", "uvicorn") if find_spec(name) is None]:
        raise ConfigError(f"serve needs {' and '.join(missing)}: pip install 'pareto-ltl[serve]'")
    from pareto_ltl.serve.server import serve_desk

    def opened(address: str) -> None:
        print_answer(Answer({"address": address}, [address], [address]), output)
        sys.stdout.flush()  # a program that reads the address waits for it
        if not options.no_browser and not _open(address):
            print("found no browser: open this address in one on this machine", file=sys.stderr)

    serve_desk(options.folder, options.port, opened)
    return 0


def _open(address: str) -> bool:
    import webbrowser

    try:
        return webbrowser.open(address)
    except (OSError, webbrowser.Error):
        return False
