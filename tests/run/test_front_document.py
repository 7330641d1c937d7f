"""docs/front.md names every column, rule and option that there is, and no other."""

from __future__ import annotations

import re
import shlex
from itertools import pairwise
from pathlib import Path

import pytest

from pareto_ltl.planning.costs import COSTS
from pareto_ltl.planning.plan_files import FRONT_HEADER
from pareto_ltl.settings.planner import SELECTION_RULES
from pareto_ltl.support.resources import CONF
from pareto_ltl_apps.cli.arguments import read_length, read_number, read_share

TEXT = (Path(__file__).parents[2] / "docs" / "front.md").read_text(encoding="utf-8")
COMMANDS = re.findall(r"^    pareto-ltl choose ([^#\n]*)", TEXT, re.MULTILINE)
READERS = {"--failure": read_share, "--energy": read_share, "--length": read_length, "--point": read_number}


def first_cells(head: str) -> list[str]:
    """The names in the first column of the table that begins with ``head``."""
    table = TEXT.split(head, 1)[1].split("\n\n", 1)[0].splitlines()[2:]
    return [name for row in table for name in re.findall(r"`([^`]*)`", row.split("|")[1])]


def test_the_columns_are_those_of_the_file() -> None:
    assert sorted(first_cells("| column | meaning |")) == sorted(
        {*FRONT_HEADER, *(cost.column for cost in COSTS.values())}
    )


def test_the_rules_are_those_of_the_settings_and_each_has_a_file() -> None:
    assert first_cells("| `selection.rule` |") == list(SELECTION_RULES)
    assert sorted(SELECTION_RULES) == CONF.names("selection")


@pytest.mark.parametrize("line", COMMANDS)
def test_a_command_asks_for_what_choose_reads(line: str) -> None:
    words = shlex.split(line)
    for option, value in pairwise(words):
        if option in READERS:
            assert READERS[option](value) > 0


def test_there_is_a_command_of_each_kind() -> None:
    assert {word for line in COMMANDS for word in shlex.split(line) if word.startswith("--")} == {
        *READERS, "--knee", "--out", "--rule",
    }  # fmt: skip
