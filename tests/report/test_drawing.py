"""Figures drawn by a process of their own: the same files, errors and warnings, and no process left."""

from __future__ import annotations

import logging
import os
import subprocess
import sys
import warnings
from collections.abc import Iterator
from dataclasses import fields, replace
from functools import partial
from pathlib import Path
from typing import Any

import psutil
import pytest

from drawn_world import run_records
from pareto_ltl.report import drawing
from pareto_ltl.report.drawing import DrawingEndedError, DrawingProcess, draw_run_figures, drawing_process
from pareto_ltl.report.figures import run_figures
from pareto_ltl.report.records import DrawnRun
from pareto_ltl.settings import ReportConfig, Settings
from pareto_ltl.support import second_process
from patience import PATIENCE, wait_until

CFG = ReportConfig(dpi=40, formats=["png", "svg"])


@pytest.fixture(scope="module")
def run() -> DrawnRun:
    return DrawnRun(**run_records())


@pytest.fixture
def process() -> Iterator[DrawingProcess]:
    started = DrawingProcess(CFG)
    yield started
    started.end()


class Spoken:
    """What prints when it is read, as a careless library."""

    def __reduce__(self) -> Any:
        return print, ("a library speaks",)


# --- what comes back ---------------------------------------------------------------------------


def test_another_process_draws_the_same_bytes_in_the_same_order(
    process: DrawingProcess, run: DrawnRun
) -> None:
    here = list(run_figures(CFG, run))
    assert list(process.figures(run)) == here
    assert list(process.figures(run)) == here  # it can be asked again
    assert [name for name, _ in here] == [
        f"{figure}.{kind}" for figure in ("plan", "wind", "front") for kind in ("png", "svg")
    ]


@pytest.mark.parametrize("order", ["of a run", "backwards"])
def test_records_that_come_one_by_one_give_the_same_figures(
    process: DrawingProcess, run: DrawnRun, order: str
) -> None:
    names = [part.name for part in fields(DrawnRun)]
    for name in names if order == "of a run" else reversed(names):
        process.record_made("deployment" if name == "deployments" else name, getattr(run, name))
    process.record_made("automaton", None)  # no figure shows it
    assert list(process.figures(run)) == list(run_figures(CFG, run))


def test_a_record_that_is_replaced_is_drawn_anew(process: DrawingProcess, run: DrawnRun) -> None:
    for name in ("scene", "decomposition", "wind", "forest", "front", "plan"):
        process.record_made(name, getattr(run, name))
    other = replace(run, plan=None)
    assert list(process.figures(other)) == list(run_figures(CFG, other))
    assert list(process.figures(run)) == list(run_figures(CFG, run))


def test_a_map_whose_mission_has_no_plan_is_drawn(process: DrawingProcess, run: DrawnRun) -> None:
    hopeless = DrawnRun(run.scene, run.decomposition, run.wind, run.forest)
    for name in ("scene", "decomposition", "wind", "forest"):
        process.record_made(name, getattr(run, name))
    files = list(process.figures(hopeless))
    assert files == list(run_figures(CFG, hopeless))
    assert [name for name, _ in files] == ["plan.png", "plan.svg", "wind.png", "wind.svg"]


def test_an_error_while_drawing_is_the_same_error_here_with_its_traceback(
    process: DrawingProcess, run: DrawnRun, tmp_path: Path
) -> None:
    unfinished: Any = "no wind"
    broken = replace(run, wind=unfinished)
    failures = []
    for how in (None, process):
        with pytest.raises(Exception) as failed:
            draw_run_figures(tmp_path, CFG, broken, how)
        failures.append(failed.value)
    here, there = failures
    assert type(here) is type(there)
    assert str(here) == str(there)
    assert "in draw_wind_arrows" in str(there.__cause__)
    assert [*process.figures(run)]  # it lives on


def test_what_a_library_prints_while_it_draws_is_no_answer(process: DrawingProcess, run: DrawnRun) -> None:
    noisy: Any = replace(run, forecasts={"none": Spoken()})
    assert list(process.figures(noisy)) == list(run_figures(CFG, run))


def test_warnings_while_drawing_appear_in_the_run(process: DrawingProcess, run: DrawnRun) -> None:
    odd = replace(run, wind=replace(run.wind, latent_var=-run.wind.latent_var))  # it has no square root
    told = []
    for draw in (partial(run_figures, CFG), process.figures):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            list(draw(odd))
        told.append([(str(one.message), one.category) for one in caught])
    assert told[0] == told[1] == [("invalid value encountered in sqrt", RuntimeWarning)]


# --- processes that end ------------------------------------------------------------------------


def test_a_run_draws_itself_what_a_killed_process_does_not(
    process: DrawingProcess, run: DrawnRun, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    psutil.Process(process.number).kill()
    process.record_made("forest", run.forest)
    with caplog.at_level(logging.WARNING):
        paths = draw_run_figures(tmp_path, ReportConfig(dpi=40), run, process)
    assert [path.name for path in paths] == ["plan.png", "wind.png", "front.png"] == sorted_by_age(tmp_path)
    assert "the run draws the figures itself" in caplog.text
    with pytest.raises(DrawingEndedError):
        list(process.figures(run))


def sorted_by_age(folder: Path) -> list[str]:
    return [path.name for path in sorted(folder.iterdir(), key=lambda path: path.stat().st_mtime_ns)]


def test_a_process_that_still_draws_is_ended_with_the_run(run: DrawnRun) -> None:
    process = DrawingProcess(ReportConfig(dpi=600, formats=["png", "svg"]))
    files = process.figures(run)
    next(files)
    process.end()
    assert not psutil.pid_exists(process.number)


@pytest.mark.parametrize("busy", [False, True])
def test_no_process_outlives_a_run_that_was_killed(busy: bool, tmp_path: Path) -> None:
    asks = "next(process.figures(DrawnRun(**run_records())))\n" if busy else ""
    code = (
        "import os, signal\n"
        "from pareto_ltl.report.drawing import DrawingProcess\n"
        "from pareto_ltl.report.records import DrawnRun\n"
        "from pareto_ltl.settings import ReportConfig\n"
        "from drawn_world import run_records\n"
        f"process = DrawingProcess(ReportConfig(dpi=600))\n{asks}print(process.number)\n"
        "os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path), "PYTHONUNBUFFERED": "1"}
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, env=environment) as killed:
        assert killed.stdout is not None
        number = int(killed.stdout.readline())
        killed.wait(PATIENCE)
    wait_until(lambda: not psutil.pid_exists(number))


# --- when there is one -------------------------------------------------------------------------


@pytest.fixture
def _fresh(monkeypatch: pytest.MonkeyPatch) -> None:
    """A program on two cores that has not imported matplotlib."""
    monkeypatch.setattr(second_process, "cores", lambda: 2)
    monkeypatch.setattr(drawing, "MATPLOTLIB", "a_package_that_nobody_imports")


@pytest.mark.usefixtures("_fresh")
def test_a_run_with_figures_has_a_process_that_draws() -> None:
    with drawing_process(Settings()) as process:
        assert process is not None
        assert psutil.pid_exists(process.number)
    assert not psutil.pid_exists(process.number)


@pytest.mark.usefixtures("_fresh")
@pytest.mark.parametrize("reason", ["no figures", "one core", "matplotlib is there", "no Python", "frozen"])
def test_a_run_draws_itself_where_a_process_would_gain_nothing(
    reason: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings = Settings(report=ReportConfig(figures=reason != "no figures"))
    if reason == "one core":
        monkeypatch.setattr(second_process, "cores", lambda: 1)
    elif reason == "matplotlib is there":
        monkeypatch.setattr(drawing, "MATPLOTLIB", "sys")
    elif reason == "no Python":
        monkeypatch.setattr(sys, "executable", None)
    elif reason == "frozen":
        monkeypatch.setattr(sys, "frozen", True, raising=False)
    with drawing_process(settings) as process:
        assert process is None


@pytest.mark.usefixtures("_fresh")
def test_a_run_draws_itself_where_no_process_can_be_started(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "executable", "/nowhere/python")
    with drawing_process(Settings()) as process:
        assert process is None
