"""Help, short and complete, and tab completion."""

from __future__ import annotations

import shutil
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from declared_settings import declarations
from pareto_ltl.settings import Settings
from pareto_ltl.support.resources import CONF, resource_folder
from pareto_ltl_apps.cli.command_table import COMMANDS, PIPELINE_COMMANDS, Command, PipelineCommand
from pareto_ltl_apps.cli.commands import run_command_line
from pareto_ltl_apps.cli.help_text import COMMON_SETTINGS, group_choices

SECTIONS = ("scene", "mission", "robot", "wind", "planner", "fidelity", "selection", "deployment", "report")


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def mine(here: Path) -> Path:
    """A folder with choices of one's own."""
    (here / "mine" / "planner").mkdir(parents=True)
    (here / "mine" / "experiment").mkdir()
    (here / "mine" / "planner" / "tiny.yaml").write_text("trees: 3\n")
    (here / "mine" / "experiment" / "harbour.yaml").write_text(
        "# @package _global_\ndefaults: [phi1, override /planner: tiny]\n"
    )
    return here / "mine"


def shown(capsys: pytest.CaptureFixture[str], *argv: str) -> str:
    assert run_command_line(argv) == 0
    out, err = capsys.readouterr()
    assert err == ""
    return out


def test_the_short_help_fits_two_screens_and_names_every_command(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = shown(capsys, "--help")
    assert len(text.splitlines()) <= 80
    assert max(map(len, text.splitlines())) <= 110
    for command in COMMANDS:
        assert f"\n  {command.name:<14}{command.meaning}\n" in text
    for key in COMMON_SETTINGS:
        assert f"\n  {key}=" in text
    assert all(name in text for name in CONF.names("experiment"))
    for hint in ("pareto-ltl COMMAND --help", "--help=all", 'eval "$(pareto-ltl -sc install=bash)"'):
        assert hint in text
    assert shown(capsys, "-h") == text
    assert list(here.iterdir()) == []


@pytest.mark.parametrize("flag", ["--help=all", "--help-all"])
def test_the_complete_help_names_every_choice_and_every_setting(
    flag: str, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = shown(capsys, flag)
    for group in (*SECTIONS, "experiment", "pipelines", "hydra/launcher"):
        assert f"\n  {group}: {', '.join(CONF.names(group))}\n" in text
    assert "\n  seed=0 " in text
    flat = " ".join(text.split())
    for section in (Settings(), *vars(Settings()).values(), Settings().scene.random, Settings().robot.power):
        for item, declared in declarations(section) if hasattr(section, "section") else ():
            assert f"\n  {section.section}.{item.name}=".replace("  .", "  ") in text
            unit = f" [{declared.unit}]" if declared.unit else ""
            limits = f"; {declared.range_text()}" if declared.range_text() else ""
            assert f"{declared.meaning}{unit}{limits}" in flat
    assert list(here.iterdir()) == []


def test_the_complete_help_shows_the_values_of_the_command_line(capsys: pytest.CaptureFixture[str]) -> None:
    text = shown(capsys, "+experiment=phi2", "robot.dt=600", "--help=all")
    assert "\n  name=phi2 " in text
    assert "\n  robot.dt=600.0 " in text
    assert "\n  mission.formula=F(a & F(b & F c)) | F(a & F(d & F c))\n" in text
    several = shown(capsys, "-m", "seed=1,2", "+experiment=phi1", "--help=all")
    assert "\n  seed=0 " in several


def test_a_folder_of_ones_own_is_in_the_help(mine: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for argv in (["--config-dir", "mine", "--help"], ["--help", "--config-dir=mine"]):
        assert "harbour, hop, phi1" in shown(capsys, *argv)
    text = shown(capsys, "--help=all", "+experiment=harbour", "--config-dir", str(mine))
    assert "\n  planner: default, dense, quick, tiny\n" in text
    assert "\n  planner.trees=3 " in text
    assert group_choices(None, None)["planner"] == ["default", "dense", "quick"]


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: str(command.name))
def test_every_command_has_its_help(command: Command, here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    name = command.name
    text = shown(capsys, name, "--help")
    assert f"pareto-ltl {name}" in text
    assert text.count("\n") > 5
    assert list(here.iterdir()) == []


@pytest.mark.parametrize("command", PIPELINE_COMMANDS, ids=lambda command: str(command.name))
def test_the_help_of_a_pipeline_explains_its_own_settings(
    command: PipelineCommand, capsys: pytest.CaptureFixture[str]
) -> None:
    text = shown(capsys, command.name, "--help")
    for section in command.sections:
        for item, _ in declarations(getattr(Settings(), section)):
            assert f"\n  {section}.{item.name}=" in text


def test_a_reader_that_leaves_early_is_no_error() -> None:
    program = subprocess.Popen(
        [sys.executable, "-m", "pareto_ltl", "--help=all"], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    assert program.stdout is not None
    program.stdout.close()
    assert program.stderr is not None
    assert program.stderr.read() == b""
    assert program.wait() == 141
    program.stderr.close()


# --- tab completion --------------------------------------------------------------------------

LINES = {
    "pareto-ltl pl": {"plan", "planner=", "planner."},
    "pareto-ltl plan +experiment=phi2": {"+experiment=phi2", "+experiment=phi2_calm"},
    "pareto-ltl +experiment=phi1 seed=1,2 -m wind=ca": {"wind=calm"},
    "pareto-ltl compare planner.n": {"planner.n_max=", "planner.near="},
    "pareto-ltl sweep fidelity=": {"fidelity=full", "fidelity=paper"},
    "pareto-ltl --config-dir mine planner=t": {"planner=tiny"},
    "pareto-ltl cache cl": set(),
    "pareto-ltl plan --typo w": set(),
    "pareto-ltl plan +experiment=phi9 w": {"wind=", "wind."},
}


@pytest.mark.parametrize("line", LINES)
def test_a_line_is_completed(
    line: str, mine: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COMP_LINE", line)
    monkeypatch.setattr(sys, "argv", ["pareto-ltl"])
    found = set(shown(capsys, "-sc", "query=bash").split())
    if "phi9" in line:  # it cannot be composed: no settings, groups only
        assert found <= LINES[line]
    else:
        assert found == LINES[line]


@pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")
def test_bash_completes_after_the_line_that_the_help_tells(here: Path) -> None:
    program = here / "pareto-ltl"
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m pareto_ltl "$@"\n')
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    script = (
        f'export PATH="{here}:$PATH"\n'
        'eval "$(pareto-ltl -sc install=bash)"\n'
        "complete -p pareto-ltl >&2\n"
        'COMP_LINE="pareto-ltl plan +experiment=phi2" COMP_CWORD=2 COMP_POINT=32\n'
        "hydra_bash_completion\n"
        'echo "${COMPREPLY[@]}"\n'
    )
    done = subprocess.run(["bash", "--norc", "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["+experiment=phi2", "+experiment=phi2_calm"]
    assert "-F hydra_bash_completion pareto-ltl" in done.stderr


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_is_for_the_program_also_under_the_module(shell: str, here: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "pareto_ltl", "-sc", f"install={shell}"],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert done.stdout.strip().splitlines()[-1].count("pareto-ltl") == 1
    assert resource_folder("conf").is_dir()
