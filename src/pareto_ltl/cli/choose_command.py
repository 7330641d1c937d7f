"""``pareto-ltl choose DIR``: another path of the front as the plan, without planning again."""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pareto_ltl.cli.arguments import CommandArguments
from pareto_ltl.cli.output import Answer
from pareto_ltl.support.errors import ConfigError
from pareto_ltl.support.messages import shown_value

METRES = {"": 1.0, "m": 1.0, "km": 1e3, "nmi": 1852.0}
NUMBER = r"[0-9]+(?:\.[0-9]*)?(?:[eE][+-]?[0-9]+)?|\.[0-9]+"
LENGTH = re.compile(rf"({NUMBER})\s*(|m|km|nmi)")
SHARE = re.compile(rf"({NUMBER})\s*(%?)")


def choose_command(argv: Sequence[str]) -> Answer:
    """Write the plan of another path."""
    parser = CommandArguments(
        prog="pareto-ltl choose",
        description="Write the plan of another path of a front, without planning again: a whole results "
        "directory, with the bytes of a run with that selection. front.csv of DIR lists the paths.",
    )
    parser.add_result()
    wanted = parser.add_mutually_exclusive_group(required=True)
    wanted.add_argument(
        "--failure", metavar="P", help="the shortest path with at most this failure rate: 0.02 or 2%%"
    )
    wanted.add_argument(
        "--energy",
        metavar="P",
        help="the path with the least energy and at most this failure rate: 0.02 or 2%%",
    )
    wanted.add_argument(
        "--length", metavar="L", help="the safest path of at most this length: 1900km, 1.9e6 (m), 1020nmi"
    )
    wanted.add_argument(
        "--knee",
        action="store_true",
        help="the knee of the front: beyond it, a lower failure rate costs the most length",
    )
    wanted.add_argument("--point", metavar="N", help="path number N of front.csv")
    wanted.add_argument(
        "--rule",
        metavar="NAME",
        help="the path that this rule picks, one of selection.rule; also of another package",
    )
    parser.add_argument(
        "settings", nargs="*", metavar="selection.KEY=VALUE", help="with --rule: what the rule reads, e.g. "
        "selection.weights=[0.8,0.1,0.1] or selection.options.KEY=VALUE",
    )  # fmt: skip
    parser.add_argument(
        "--out", type=Path, metavar="DIR2", help="default: DIR with the choice added to its name"
    )
    return _choose(parser.parse_intermixed_args(argv), argv)


def _choose(options: argparse.Namespace, argv: Sequence[str]) -> Answer:
    from pareto_ltl.cli.summary import run_answer
    from pareto_ltl.cli.warning_lines import collected_warnings
    from pareto_ltl.run.choosing import Choice, chosen_run, default_place
    from pareto_ltl.run.metrics import run_metrics
    from pareto_ltl.run.results import load_results
    from pareto_ltl.studies.stages import application_stages

    choice = Choice(
        failure=None if options.failure is None else read_share(options.failure),
        energy=None if options.energy is None else read_share(options.energy, "--energy"),
        length=None if options.length is None else read_length(options.length),
        knee=options.knee,
        point=None if options.point is None else read_number(options.point),
        selection=read_selection(options.rule, options.settings),
    )
    results = load_results(options.directory)
    place = options.out or default_place(results.directory, choice)
    table = application_stages(results.settings)
    with collected_warnings() as warnings:
        run = chosen_run(results, choice, place, table, ("pareto-ltl", "choose", *argv))
    return run_answer(run.settings, place, run_metrics(run.records, run.seconds), warnings)


def read_selection(rule: str | None, words: Sequence[str]) -> dict[str, Any] | None:
    """Settings of the selection from ``rule`` and words ``selection.KEY=VALUE``; None without a rule.

    Raises
    ------
    ConfigError
        If there are words without a rule, or one that is no setting of the selection.
    """
    from omegaconf import OmegaConf
    from omegaconf.errors import OmegaConfBaseException
    from yaml import YAMLError

    words = [word.removeprefix("+") for word in words]  # Hydra asks for it before a new key
    for word in words:
        if rule is None or not word.startswith("selection.") or "=" not in word:
            raise ConfigError(
                f"{shown_value(word)} is not known; expected selection.KEY=VALUE, with --rule NAME"
            )
    try:
        read: Any = OmegaConf.to_container(OmegaConf.from_dotlist(words))
    except (OmegaConfBaseException, YAMLError) as error:
        raise ConfigError(f"{shown_value(' '.join(words))} cannot be read: {error}") from None
    return None if rule is None else {**read.get("selection", {}), "rule": rule}


def read_share(text: str, flag: str = "--failure") -> float:
    """A probability from ``0.02`` or ``2%``; raises ConfigError for anything else."""
    match = SHARE.fullmatch(text.strip())
    value = float(match[1]) / (100.0 if match[2] else 1.0) if match else -1.0
    if not 0.0 < value < 1.0:
        raise ConfigError(
            f"{flag} must be a probability between 0 and 1, e.g. 0.02 or 2%, got {shown_value(text)}"
        )
    return value


def read_length(text: str) -> float:
    """A length [m] from ``1900km``, ``1.9e6`` or ``1020nmi``; raises ConfigError for anything else."""
    match = LENGTH.fullmatch(text.strip())
    value = float(match[1]) * METRES[match[2]] if match else 0.0
    if not 0.0 < value <= 1e9:
        raise ConfigError(f"--length must be a length in m, km or nmi, e.g. 1900km, got {shown_value(text)}")
    return value


def read_number(text: str) -> int:
    """The number of a path; raises ConfigError for anything else."""
    if not (text.isascii() and text.isdigit()) or len(text) > 6:
        raise ConfigError(
            f"--point must be the number of a path in front.csv, e.g. 3, got {shown_value(text)}"
        )
    return int(text)
