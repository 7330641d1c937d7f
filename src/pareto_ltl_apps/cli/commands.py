"""The command line of ``pareto-ltl``. Without a command, it is in the Hydra form."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

from pareto_ltl import __version__
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl_apps.cli.arguments import HELP_FLAGS, CommandArguments, ToolArguments
from pareto_ltl_apps.cli.command_table import Argument, Command, PipelineCommand, ToolCommand, command_named
from pareto_ltl_apps.cli.output import (
    Answer,
    Output,
    answer_with_warnings,
    answered,
    output_of,
    print_answer,
    print_problem,
    printed_warnings,
    run_reported,
)

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
        return run_reported(lambda: _run_settings(words, None, output), output=output)
    rest = [*words[:place], *words[place + 1 :]]
    if {"--help", "-h"} & {*rest}:  # help is text for people in any form of the output
        output = Output.TEXT
    return run_reported(lambda: _run_command(command_named(words[place]), rest, output), output=output)


def _run_command(command: Command, words: Sequence[str], output: Output) -> int:
    """Run a command with the other words; its module is imported now."""
    has_setting = any("=" in word and not word.startswith("-") for word in words)
    if isinstance(command, PipelineCommand) or (command.name == "sweep" and has_setting):
        return _run_settings(words, command.name, output)
    assert isinstance(command, ToolCommand)
    options = parsed_options(command, words)
    module, _, name = command.target.partition(".")
    run = getattr(import_module(f"pareto_ltl_apps.cli.{module}"), name)
    if command.streams:
        with printed_warnings():
            code: int = run(options, output)
        return code
    return answered(lambda _tell: answer_with_warnings(lambda: run(options)), output)


def parsed_options(command: ToolCommand, words: Sequence[str]) -> argparse.Namespace:
    """The values of the arguments of ``command``, and ``words``.

    Raises
    ------
    ConfigError
        If the words are not as the row of the command says.
    DataError
        If the results directory does not exist.
    """
    parser = ToolArguments(
        prog=f"pareto-ltl {command.name}", usage=command.usage, description=command.purpose
    )
    for row in command.arguments:
        if isinstance(row, Argument):
            parser.add_argument(row.name, **row.options)
        else:
            exclusive = parser.add_mutually_exclusive_group(required=True)
            for one in row:
                exclusive.add_argument(one.name, **one.options)
    options = parser.parse_intermixed_args(words)
    place = getattr(options, "directory", None)
    if isinstance(place, Path) and not place.is_dir():
        raise DataError(f"{place}: no such folder; give a results directory")
    options.words = words
    return options


def _run_settings(argv: Sequence[str], command: str | None, output: Output) -> int:
    if sys.version_info >= (3, 14) and not _hydra_is_new():
        print_problem(
            f"Python {sys.version_info[0]}.{sys.version_info[1]} needs Hydra 1.4, which is not final: "
            "use Python 3.13"
        )
        return 2
    wanted = {HELP_FLAGS[word] for word in argv if word in HELP_FLAGS}
    if wanted == {"short"}:
        return run_reported(lambda: _print_help(argv, command))
    from pareto_ltl_apps.cli.hydra_app import run_hydra  # Hydra is slow to import

    return run_hydra(argv, command, output)


def _print_help(argv: Sequence[str], command: str | None) -> int:
    """Print the help of ``command``, or of the program; the flags for folders of settings are heeded."""
    from pareto_ltl_apps.cli.help_text import command_help, group_choices, short_help

    flags = CommandArguments(prog="pareto-ltl", add_help=False)
    flags.add_argument("--config-path", "-cp")
    flags.add_argument("--config-dir", "-cd")
    folders, _ = flags.parse_known_args([word for word in argv if word not in HELP_FLAGS])
    groups = group_choices(folders.config_path, folders.config_dir)
    known = None if command is None else command_named(command)
    print(command_help(known, groups) if isinstance(known, PipelineCommand) else short_help(groups))
    return 0


def _hydra_is_new() -> bool:
    """Whether the installed Hydra is at least 1.4; older ones fail on Python 3.14."""
    from importlib.metadata import version

    return tuple(map(int, version("hydra-core").split(".")[:2])) >= (1, 4)


def _command_place(argv: Sequence[str]) -> int | None:
    """Index of the command: the first word that is not a flag, a value of a flag or a setting."""
    for place, word in enumerate(argv):
        if word.startswith("-") or (place and argv[place - 1] in VALUE_FLAGS):
            continue
        return None if "=" in word or word.startswith(("+", "~")) else place
    return None
