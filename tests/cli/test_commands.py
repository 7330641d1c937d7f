"""One command line: commands and the Hydra form, flags in any order, and what is misspelt."""

from __future__ import annotations

import itertools
import json
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from hydra._internal.config_loader_impl import ConfigLoaderImpl

from pareto_ltl.run.pipeline import Pipeline
from pareto_ltl.settings import Settings
from pareto_ltl.support.errors import ConfigError
from pareto_ltl.support.resources import CONF, resource_folder
from pareto_ltl_apps.cli import composition, output
from pareto_ltl_apps.cli.command_table import COMMANDS, PIPELINE_COMMANDS
from pareto_ltl_apps.cli.commands import run_command_line

CELLS = ("+experiment=phi1", "pipelines.stages=[readings,scene,decomposition]")
NEEDS = {"ingest": ["wind=grib", "wind.path=DIR"]}


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def ran(monkeypatch: pytest.MonkeyPatch) -> list[Settings]:
    """The settings of the runs that were started; nothing is made."""
    found: list[Settings] = []

    def run(pipeline: Pipeline, *_: Any) -> dict[str, float]:
        found.append(pipeline.settings)
        return {"run_seconds": 0.0}

    monkeypatch.setattr(Pipeline, "complete", run)
    return found


def test_every_pipeline_that_ships_has_a_command() -> None:
    assert sorted(command.name for command in PIPELINE_COMMANDS) == CONF.names("pipelines")
    names = [command.name for command in COMMANDS]
    assert len(set(names)) == len(names)
    assert all(command.meaning and "\n" not in command.meaning for command in COMMANDS)


@pytest.mark.parametrize("name", CONF.names("pipelines"))
def test_a_pipeline_command_is_the_hydra_form_with_its_pipeline(
    name: str, here: Path, ran: list[Settings]
) -> None:
    words = [*NEEDS.get(name, ["+experiment=phi1"]), "seed=3"]
    assert run_command_line([name, *words]) == 0
    assert run_command_line([f"pipelines={name}", *words]) == 0
    assert ran[0] == ran[1]
    assert ran[0].seed == 3


def test_without_a_command_a_mission_is_planned(here: Path, ran: list[Settings]) -> None:
    assert run_command_line(["+experiment=phi1"]) == 0
    assert run_command_line(["plan", "+experiment=phi1"]) == 0
    assert ran[0] == ran[1]


def test_the_command_is_in_the_record_as_it_was_typed(here: Path) -> None:
    assert run_command_line(["plan", *CELLS, "name=trial"]) == 0
    (place,) = Path("outputs/trial").iterdir()
    record = json.loads((place / "run.json").read_text())
    assert record["argv"] == ["plan", *CELLS, "name=trial"]
    assert record["overrides"] == ["pipelines=plan", *CELLS, "name=trial"]
    assert (place / ".hydra" / "config.yaml").is_file()


@pytest.mark.parametrize("order", [*itertools.permutations(["+experiment=phi1", "seed=1,2", "-m"])])
def test_the_flag_of_a_sweep_may_stand_anywhere(order: Sequence[str]) -> None:
    flags = composition.parse_flags(order)
    with composition.opened_hydra(flags) as hydra:
        assert composition.prepare(hydra, flags).pipeline is None


@pytest.mark.parametrize("command", [[], ["plan"]])
def test_a_sweep_runs_with_its_flag_at_the_end(command: list[str], here: Path) -> None:
    assert run_command_line([*command, *CELLS, "seed=1,2", "-m"]) == 0
    assert len([*Path("multirun/phi1").glob("*/metrics.json")]) == 2


@pytest.mark.parametrize("place", range(4))
def test_a_folder_of_choices_may_be_named_anywhere(place: int, here: Path, ran: list[Settings]) -> None:
    (here / "mine" / "planner").mkdir(parents=True)
    (here / "mine" / "planner" / "tiny.yaml").write_text("trees: 3\n")
    words = ["plan", "+experiment=phi1", "planner=tiny"]
    words[place:place] = ["--config-dir", "mine"]
    assert run_command_line(words) == 0
    assert [settings.planner.trees for settings in ran] == [3]


def test_a_flag_before_the_command_is_no_command(here: Path) -> None:
    assert run_command_line(["-m", "plan", *CELLS, "seed=1,2"]) == 0
    assert len([*Path("multirun/phi1").glob("*/metrics.json")]) == 2


def test_a_sweep_is_run_by_its_command_and_summarized_from_its_folder(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_command_line(["sweep", *CELLS, "seed=1,2"]) == 0
    assert "2 ok of 2 jobs" in capsys.readouterr().out
    (here / "multirun" / "phi1" / "summary.csv").unlink()
    assert run_command_line(["sweep", "multirun/phi1"]) == 0
    assert "2 ok of 2 jobs" in capsys.readouterr().out
    assert (here / "multirun" / "phi1" / "summary.csv").is_file()


BAD = {
    ("plna", "+experiment=phi1"): "unknown command 'plna'; did you mean plan?",
    ("-m", "compar", "+experiment=phi1"): "unknown command 'compar'; did you mean compare?",
    ("xyzzy",): "unknown command 'xyzzy'; there are plan, compare, ",
    ("plan", "seeed=3"): "unknown setting seeed; did you mean seed?",
    ("compare", "compare.method=[paper]"): "did you mean compare.methods?",
    ("compare", "pipelines=plan"): "pareto-ltl compare sets the pipeline itself; leave out pipelines=plan",
    ("plan", "--config-dir", "nowhere"): "--config-dir nowhere: there is no such folder",
    ("plan", "--typo"): "--typo",
    ("plan", "-r", "-m"): "--run and --multirun exclude each other",
    ("sweep",): "name the folder of a sweep",
    ("sweep", "nowhere"): "nowhere",
    ("sweep", "DIR", "--typo"): "--typo; see pareto-ltl sweep --help",
    ("rerun",): "see pareto-ltl rerun --help",
    ("cache", "burn"): "see pareto-ltl cache --help",
    ("formula",): "see pareto-ltl formula --help",
    ("-sc", "+experiment=phi1"): "-sc needs install=SHELL",
}


@pytest.mark.parametrize("argv", BAD, ids=" ".join)
def test_a_wrong_command_line_is_one_line(
    argv: tuple[str, ...], here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_command_line(argv) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert BAD[argv] in err
    assert list(here.iterdir()) == []


def test_the_version_may_stand_anywhere(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command_line(["--version"]) == 0
    first = capsys.readouterr().out
    assert run_command_line(["+experiment=phi1", "--version"]) == 0
    assert capsys.readouterr().out == first


def test_a_bug_outside_a_run_is_one_line_with_the_place_of_its_traceback(
    capsys: pytest.CaptureFixture[str],
) -> None:
    def broken() -> int:
        raise RuntimeError("oops")

    assert output.run_reported(broken) == 1
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    log = Path(err.split("the traceback is in ")[1].rstrip(")\n"))
    assert "RuntimeError: oops" in log.read_text()
    log.unlink()


# --- once ------------------------------------------------------------------------------------


@pytest.fixture
def counted(monkeypatch: pytest.MonkeyPatch) -> dict[str, int]:
    """How often a configuration is composed and settings are made."""
    counts = {"composed": 0, "made": 0}
    compose = ConfigLoaderImpl._load_configuration_impl  # noqa: SLF001 - the one place where Hydra composes
    made = Settings.__post_init__

    def counting_compose(*args: Any, **kwargs: Any) -> Any:
        counts["composed"] += 1
        return compose(*args, **kwargs)

    def counting_made(settings: Settings) -> None:
        counts["made"] += 1
        made(settings)

    monkeypatch.setattr(ConfigLoaderImpl, "_load_configuration_impl", counting_compose)
    monkeypatch.setattr(Settings, "__post_init__", counting_made)
    return counts


def test_a_run_composes_once_and_makes_its_settings_once(here: Path, counted: dict[str, int]) -> None:
    assert run_command_line(["plan", *CELLS]) == 0
    assert counted == {"composed": 1, "made": 1}


def test_a_sweep_composes_its_own_configuration_once(here: Path, counted: dict[str, int]) -> None:
    assert run_command_line(["sweep", *CELLS, "seed=1,2,3"]) == 0
    # itself; its first and last point; the choices that all points share; one for each job
    assert counted["composed"] == 1 + 2 + 1 + 3


def test_hydras_own_words_reach_the_run(here: Path) -> None:
    assert run_command_line(["plan", *CELLS, "hydra.run.dir=there", "hydra.output_subdir=.conf"]) == 0
    noted = (here / "there" / ".conf" / "overrides.yaml").read_text()
    assert "pipelines=plan" in noted
    assert "mode: RUN" in (here / "there" / ".conf" / "hydra.yaml").read_text()


def test_a_mode_in_the_settings_counts_as_its_flag(here: Path) -> None:
    assert run_command_line([*CELLS, "seed=1,2", "hydra.mode=MULTIRUN"]) == 0
    assert len([*Path("multirun/phi1").glob("*/metrics.json")]) == 2


def test_a_configuration_is_shown_and_nothing_runs(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command_line(["plan", "+experiment=phi1", "--cfg", "job", "planner.trees=3"]) == 0
    assert "trees: 3" in capsys.readouterr().out
    assert run_command_line(["--hydra-help"]) == 0
    assert "Hydra" in capsys.readouterr().out
    info = [sys.executable, "-m", "pareto_ltl", "--info", "searchpath"]  # it changes the root logger
    done = subprocess.run(info, capture_output=True, text=True, check=True)
    assert str(resource_folder("conf")) in done.stdout
    assert list(here.iterdir()) == []


def test_settings_made_by_hand_are_checked_by_the_runner() -> None:
    with pytest.raises(ConfigError, match=r"pipelines\.stages is empty"):
        Pipeline.of(Settings())


def test_python_3_14_is_one_line_until_hydra_1_4(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "version_info", (3, 14, 0, "final", 0))
    assert run_command_line(["+experiment=phi1"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "Python 3.14 needs Hydra 1.4, which is not final: use Python 3.13" in line
