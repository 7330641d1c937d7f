"""Arguments of commands that begin with a minus sign, for every option of every command."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from pareto_ltl.support.errors import ConfigError
from pareto_ltl_apps.cli.command_table import TOOL_COMMANDS, Argument, ToolCommand
from pareto_ltl_apps.cli.commands import parsed_options

FIX = "-43.8,-75.1,500"


def each_argument(command: ToolCommand) -> list[Argument]:
    rows = [(row,) if isinstance(row, Argument) else row for row in command.arguments]
    return [one for row in rows for one in row]


def values_of(option: Argument) -> list[str]:
    """Values of an option that begin with a minus sign: lists of coordinates, one or as many as it takes."""
    count = option.options.get("nargs")
    return [FIX] * (count if isinstance(count, int) else 1)


VALUED = [
    (command, option)
    for command in TOOL_COMMANDS
    for option in each_argument(command)
    if option.name.startswith("--") and option.options.get("action") != "store_true"
]


def words_before(command: ToolCommand, option: Argument, folder: Path) -> list[str]:
    """What the command needs beside ``option``: its positional arguments, one of each exclusive group."""
    words = []
    for row in command.arguments:
        if isinstance(row, Argument):
            if not row.name.startswith("--") and row.options.get("nargs") not in ("?", "*"):
                words.append(str(folder))
            elif row is not option and row.options.get("required"):
                words += [row.name, str(folder)]
        elif option not in row:
            words += [row[0].name, "0.5"]
    return words


@pytest.mark.parametrize(
    ("command", "option", "joined"),
    [
        pytest.param(command, option, joined, id=f"{command.name} {option.name} {way}")
        for command, option in VALUED
        for joined, way in ((True, "with ="), (False, "as the next word"))
        if not joined or len(values_of(option)) == 1  # two values are never written with =
    ],
)
def test_every_value_may_begin_with_a_minus_sign(
    command: ToolCommand, option: Argument, joined: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The option gets the text itself; readers, which may refuse it, are replaced."""
    values = values_of(option)
    plain = {key: value for key, value in option.options.items() if key not in ("type", "choices")}
    read: list[str] = []

    def reader(text: str) -> str:
        read.append(text)
        return text

    watched = Argument(option.name, {**plain, "type": reader})
    rows: list[Any] = [
        tuple(watched if one is option else one for one in row)
        if not isinstance(row, Argument)
        else (watched if row is option else row)
        for row in command.arguments
    ]
    changed = ToolCommand(
        command.name, command.meaning, command.target, command.purpose, tuple(rows), command.streams
    )
    given = [f"{option.name}={values[0]}"] if joined else [option.name, *values]
    parsed_options(changed, [*words_before(command, option, tmp_path), *given])
    assert read[-len(values) :] == values


def test_a_fix_in_the_south_or_west_is_three_numbers(tmp_path: Path) -> None:
    replan = next(command for command in TOOL_COMMANDS if command.name == "replan")
    for words in (["--fix", FIX], [f"--fix={FIX}"]):
        assert parsed_options(replan, [str(tmp_path), *words, "--time", "6h"]).fix == (-43.8, -75.1, 500.0)


def test_heights_below_zero_are_two_numbers(tmp_path: Path) -> None:
    export = next(command for command in TOOL_COMMANDS if command.name == "export")
    options = parsed_options(export, [str(tmp_path), "--between", "-30", "-12.5", "--altitude", "-3"])
    assert (options.between, options.altitude) == ([-30.0, -12.5], -3.0)


@pytest.mark.parametrize("word", ["--fixx", "--fix-", "-x", "-43.8"])
def test_a_word_that_no_argument_takes_is_named(word: str, tmp_path: Path) -> None:
    replan = next(command for command in TOOL_COMMANDS if command.name == "replan")
    with pytest.raises(ConfigError, match=f"unrecognized arguments: {word}"):
        parsed_options(replan, [str(tmp_path), word])


def test_a_flag_without_its_value_is_named(tmp_path: Path) -> None:
    replan = next(command for command in TOOL_COMMANDS if command.name == "replan")
    with pytest.raises(ConfigError, match="argument --fix: expected one argument"):
        parsed_options(replan, [str(tmp_path), "--fix", "--time", "6h"])
