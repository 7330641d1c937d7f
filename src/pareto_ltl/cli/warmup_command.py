"""``pareto-ltl warmup``: compile the kernels of runs before they are needed."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import asdict

from pareto_ltl.cli.arguments import CommandArguments
from pareto_ltl.cli.output import Answer
from pareto_ltl.run.progress import ProgressBar
from pareto_ltl.run.warmup import DEFAULT, KINDS, Warmed, warm_up_all
from pareto_ltl.support.errors import ConfigError
from pareto_ltl.support.messages import shown_value


def warmup_command(argv: Sequence[str]) -> Answer:
    """What was compiled, by kind of run."""
    options = _warmup_arguments().parse_args(argv)
    if options.list:
        known = {name: kind.meaning for name, kind in KINDS.items()}
        return Answer({"kinds": known}, [f"{name:<24}{meaning}" for name, meaning in known.items()])
    names = _chosen(options)
    with ProgressBar() as bar, bar.stage("compiling"):
        found = list(warm_up_all(names, options.jobs, bar))
    kinds = [{**asdict(warmed), "seconds": round(warmed.seconds, 1)} for warmed in found]
    document = {"kinds": kinds, "compiled": sum(len(warmed.compiled) for warmed in found)}
    return Answer(document, list(_lines(found)))


def _chosen(options: argparse.Namespace) -> list[str]:
    """The kinds that the command line names."""
    if options.all:
        return list(KINDS)
    for name in options.kinds:
        if name not in KINDS:
            raise ConfigError(f"there is no kind {shown_value(name)}; pareto-ltl warmup --list shows them")
    return list(options.kinds) or list(DEFAULT)


def _lines(found: Sequence[Warmed]) -> Iterator[str]:
    for warmed in found:
        yield f"{warmed.name}: {len(warmed.compiled)} kernels compiled, {warmed.seconds:.0f} s"
        if not warmed.complete:
            yield f"{warmed.name}: its small mission found no path, so some kernels may be missing"


def _warmup_arguments() -> CommandArguments:
    parser = CommandArguments(
        prog="pareto-ltl warmup",
        description="Compile the kernels of a kind of run, which its first run would do otherwise, and keep "
        "the machine code. A small mission is planned for it. Without KIND: runs with default settings.",
    )
    parser.add_argument("kinds", nargs="*", metavar="KIND", help="for example paper; --list shows all")
    parser.add_argument("--all", action="store_true", help="all kinds of runs; takes some minutes")
    parser.add_argument("--list", action="store_true", help="show the kinds, and compile nothing")
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="kinds compiled at the same time")
    return parser
