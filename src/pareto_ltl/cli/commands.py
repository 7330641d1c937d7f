"""The command line of ``pareto-ltl``. Without a command, it is in the Hydra form."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module

from pareto_ltl import __version__
from pareto_ltl.cli.arguments import run_reported
from pareto_ltl.cli.command_table import Command, PipelineCommand, StreamingCommand, command_named
from pareto_ltl.cli.output import Answer, Output, answered, output_of, print_answer, print_problem
from pareto_ltl.cli.warning_lines import answer_with_warnings, printed_warnings
from pareto_ltl.support.errors import ConfigError

VALUE_FLAGS = (
    *("--config-dir", "-cd", "--config-path", "-cp", "--config-name", "-cn"),
    *("--cfg", "-c", "--package", "-p", "--info", "-i", "--experimental-rerun"),
)  # flags whose value is the next word


def run_command_line(argv: Sequence[str]) -> int:
    """Run the command line; return the exit code."""
    try:
        output, words = output_of(argv)
    except ConfigError as error:
        print_problem(str(error))
        return 2
    if words == ["--version"]:
        print_answer(Answer({"version": __version__}, [f"pareto-ltl {__version__}"]), output)
        return 0
    place = _command_place(words)
    if place is None:
        return _run_settings(words, None, output)
    rest = [*words[:place], *words[place + 1 :]]
    if {"--help", "-h"} & {*rest}:  # help is text for people in any form of the output
        output = Output.TEXT
    return run_reported(lambda: _run_command(command_named(words[place]), rest, output), output=output)


def _run_command(command: Command, rest: Sequence[str], output: Output) -> int:
    """Run a command with the other words; its module is imported now."""
    if isinstance(command, PipelineCommand):
        return _run_settings(rest, command.name, output)
    name = f"{command.name.replace('-', '_')}_command"
    run = getattr(import_module(f"pareto_ltl.cli.{name}"), name)
    if isinstance(command, StreamingCommand):
        with printed_warnings():
            code: int = run(rest, output)
        return code
    return answered(lambda: answer_with_warnings(lambda: run(rest)), output)


def _run_settings(argv: Sequence[str], command: str | None, output: Output) -> int:
    from pareto_ltl.cli.hydra_app import run_hydra  # Hydra is slow to import

    return run_hydra(argv, command, output)


def _command_place(argv: Sequence[str]) -> int | None:
    """Index of the command: the first word that is not a flag, a value of a flag or a setting."""
    for place, word in enumerate(argv):
        if word.startswith("-") or (place and argv[place - 1] in VALUE_FLAGS):
            continue
        return None if "=" in word or word.startswith(("+", "~")) else place
    return None
