"""Tab completion of Hydra, extended by the commands."""

from __future__ import annotations

import argparse
import os
import sys
from contextlib import suppress

from pareto_ltl.cli.command_table import COMMANDS, PIPELINE_COMMANDS
from pareto_ltl.cli.composition import config_name, opened_hydra, parse_flags
from pareto_ltl.cli.error_lines import CONFIGURATION_ERRORS
from pareto_ltl.support.errors import ConfigError

SETTINGS_WORDS = {"sweep", *(command.name for command in PIPELINE_COMMANDS)}  # settings follow these commands


def complete_shell(arguments: argparse.Namespace) -> int:
    """Install, remove or answer tab completion: ``-sc install=bash``, ``-sc query=bash``; return 0."""
    asked = [word.partition("=")[0] for word in arguments.overrides]
    if asked not in (["install"], ["uninstall"], ["query"]):
        raise ConfigError(
            "-sc needs install=SHELL, uninstall=SHELL or query=SHELL; SHELL is bash, zsh or fish"
        )
    sys.argv[:1] = ["pareto-ltl"]  # the program that Hydra completes, also under python -m
    if asked != ["query"]:
        with opened_hydra(arguments) as hydra:
            hydra.shell_completion(config_name(arguments), arguments.overrides)
        return 0
    with suppress(*CONFIGURATION_ERRORS):  # a line that cannot be read has no completion
        _complete_line(arguments)
    return 0


def _complete_line(arguments: argparse.Namespace) -> None:
    """Print the words that can follow the line in ``COMP_LINE``."""
    line = os.environ.get("COMP_LINE", "")
    words = line.split()[1:]
    last = words.pop() if words and not line.endswith(" ") else ""
    if not words:
        found = [command.name for command in COMMANDS if command.name.startswith(last)]
        print("\n".join(found))
    elif words[0] in SETTINGS_WORDS:
        words = words[1:]
    elif words[0] in {command.name for command in COMMANDS}:
        return
    typed = parse_flags(words)
    mode = ["-m"] if typed.multirun else []
    os.environ["COMP_LINE"] = " ".join(["pareto-ltl", *mode, *typed.overrides, last])
    arguments.config_dir = typed.config_dir
    with opened_hydra(arguments) as hydra:
        hydra.shell_completion(config_name(arguments), arguments.overrides)
