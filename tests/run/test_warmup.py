"""Compiling before it is needed, and in two processes."""

from __future__ import annotations

import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from pareto_ltl.planning.evaluate import evaluate_path
from pareto_ltl.planning.pack_logic import LIVE
from pareto_ltl.run import second_process
from pareto_ltl.run.plan_run import Run
from pareto_ltl.settings import PRESETS, FidelityConfig, Settings
from pareto_ltl.support.budget import Budget
from pareto_ltl_apps.cli import warmup
from pareto_ltl_apps.cli.commands import run_command_line
from typed_kernels import code_cache, watching


def test_each_preset_has_a_kind_and_one_for_every_model_changed() -> None:
    assert set(PRESETS) <= set(warmup.KINDS)
    assert all(kind.meaning and kind.formula for kind in warmup.KINDS.values())
    changed = [kind.sections.get("fidelity") for name, kind in warmup.KINDS.items() if "-" in name]
    models = [sections for sections in changed if isinstance(sections, dict)]
    assert len(models) == 4 * len(PRESETS)
    for sections in models:
        (model,) = set(sections) - {"name"}
        assert sections[model] != PRESETS[sections["name"]][model]


@pytest.mark.parametrize("name", warmup.KINDS)
def test_every_kind_makes_a_problem(name: str) -> None:
    kind = warmup.KINDS[name]
    sections = {"pipelines": "plan", "mission": {"formula": kind.formula}, **warmup.small_sections(kind)}
    problem = Run(Settings.of(sections)).problem
    assert (len(problem.logic.distance) > LIVE) == name.endswith("large")


@pytest.mark.parametrize("name", ["full", "paper", "full-fixes"])
def test_the_given_path_completes_its_mission_and_is_within_reach(name: str) -> None:
    sections = warmup.small_sections(warmup.KINDS[name])
    settings = Settings.of({"pipelines": "plan", "mission": {"formula": "F a"}, **sections})
    problem = Run(settings).problem
    forest = warmup.path_forest(problem)
    (tree,) = forest.trees
    assert problem.automaton.accepting[tree.q[-1]]
    assert (tree.cell >= 0).all()
    np.testing.assert_array_equal(tree.path(len(tree) - 1), tree.x)
    assert evaluate_path(problem, tree.x, "", tight=False).objectives.length == pytest.approx(tree.length[-1])


def test_a_helper_compiles_nothing_of_growth(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    loaded: list[str] = []
    load = code_cache.KernelCache.load_overload

    def noted(self: code_cache.KernelCache, *words: object) -> object:
        loaded.append(self.start)
        return load(self, *words)

    monkeypatch.setattr(code_cache.KernelCache, "load_overload", noted)
    warmup.warm_up("full", grown=False)
    assert "growth.grow-" not in loaded


def test_kinds_of_settings() -> None:
    assert second_process.kind_of(Settings()) == "full"
    assert second_process.kind_of(Settings.of({"fidelity": "paper"})) == "paper"
    assert (
        second_process.kind_of(Settings.of({"scene": {"landmarks": [[[0, 0], [1, 0], [1, 1]]]}}))
        == "full-fixes"
    )
    assert second_process.kind_of(Settings.of({"robot": {"feedback_time": 60.0}})) is None
    assert second_process.kind_of(Settings(fidelity=FidelityConfig(judge="bound"))) is None
    landmarks = {"landmarks": [[[0, 0], [1, 0], [1, 1]]]}
    assert second_process.kind_of(Settings.of({"fidelity": "paper", "scene": landmarks})) == "paper"
    assert "full-fixes" in warmup.KINDS


class Started:
    """In place of a process that ends after it was asked ``polls`` times."""

    def __init__(self, polls: float) -> None:
        self.polls, self.calls = polls, list[str]()

    def poll(self) -> int | None:
        self.polls -= 1
        return None if self.polls >= 0 else 0

    def kill(self) -> None:
        self.calls.append("kill")

    def wait(self) -> int:
        self.calls.append("wait")
        return 0


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[str]:
    """The kinds for which a second process was started; the processes are stand-ins."""
    kinds: list[str] = []
    monkeypatch.setenv("PARETO_LTL_CACHE", str(tmp_path))
    monkeypatch.setattr(second_process, "cores", lambda: 2)
    monkeypatch.setattr(second_process, "_process", lambda kind, folder: (kinds.append(kind), Started(2))[1])
    return kinds


def announce(kernel: str) -> None:
    watching.compilation_begins(kernel)


def test_a_second_process_is_started_when_growth_is_compiled_and_only_then(started: list[str]) -> None:
    with second_process.compiling_in_two(Settings(), Budget()):
        announce("path.check_path")
        assert started == []
        announce("growth.grow")
        announce("growth.grow")
        assert started == ["full"]
    assert watching.WATCHERS == []


def test_of_two_runs_one_has_a_second_process(started: list[str]) -> None:
    with second_process.compiling_in_two(Settings(), Budget()):
        announce("growth.grow")
        with second_process.compiling_in_two(Settings.of({"fidelity": "paper"}), Budget()):
            announce("growth.grow")
    assert started == ["full"]


def test_with_one_core_there_is_none(started: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(second_process, "cores", lambda: 1)
    with second_process.compiling_in_two(Settings(), Budget()):
        announce("growth.grow")
    assert started == []


def test_a_second_process_that_takes_too_long_is_ended(
    started: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    slow = Started(math.inf)
    monkeypatch.setattr(second_process, "_process", lambda kind, folder: slow)
    monkeypatch.setattr(second_process, "LONGEST", 0.3)
    with second_process.compiling_in_two(Settings(), Budget()):
        announce("growth.grow")
    assert slow.calls == ["kill", "wait"]


def test_a_time_limit_that_is_over_ends_it(started: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    slow, budget = Started(math.inf), Budget(1e-3)
    budget.begin()
    monkeypatch.setattr(second_process, "_process", lambda kind, folder: slow)
    with second_process.compiling_in_two(Settings(), budget):
        announce("growth.grow")
    assert slow.calls == ["kill", "wait"]


def test_a_second_process_that_cannot_start_changes_nothing(
    started: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def none(kind: str, folder: str) -> None:
        raise OSError("no more processes")

    monkeypatch.setattr(second_process, "_process", none)
    with second_process.compiling_in_two(Settings(), Budget()):
        announce("growth.grow")


def test_the_second_process_ends_with_the_first(tmp_path: Path) -> None:
    gone = subprocess.Popen([sys.executable, "-c", "pass"])
    gone.wait()
    command = [sys.executable, "-c", second_process.CODE, "full", str(gone.pid)]
    done = subprocess.run(command, cwd=tmp_path, check=False, timeout=100, stderr=subprocess.DEVNULL)
    assert done.returncode == 1


def test_an_error_ends_the_second_process(started: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    process = Started(0)
    monkeypatch.setattr(second_process, "_process", lambda kind, folder: process)

    def interrupted() -> None:
        with second_process.compiling_in_two(Settings(), Budget()):
            announce("growth.grow")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert process.calls == ["kill", "wait"]


def test_the_command_lists_its_kinds_and_refuses_others(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command_line(["warmup", "--list"]) == 0
    assert [line.split()[0] for line in capsys.readouterr().out.splitlines()] == list(warmup.KINDS)
    assert run_command_line(["warmup", "fulll"]) == 2
    assert "pareto-ltl warmup --list" in capsys.readouterr().err


def test_the_command_says_what_was_compiled(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(warmup, "warm_up", lambda name, watcher: warmup.Warmed(name, ("growth.grow",), 31.4))
    assert run_command_line(["warmup", "paper", "full"]) == 0
    assert capsys.readouterr().out.splitlines() == [
        "paper: 1 kernels compiled, 31 s",
        "full: 1 kernels compiled, 31 s",
    ]
