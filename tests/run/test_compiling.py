"""Machine code for later stages: a second process makes it once, with the very types of the run."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from dataclasses import replace

import pytest
from numba import config, typeof

from pareto_ltl.kernels.letters import states_along
from pareto_ltl.run import compiling
from pareto_ltl.run.compiling import CompilingProcess, carry_out_small, code_marker, one_line_forest
from pareto_ltl.run.pipeline import Run
from pareto_ltl.run.records import DEPLOYMENTS, FORECASTS, FOREST, FRONT, PLAN, PROBLEM, WIND, Records
from pareto_ltl.settings import RobotConfig, Settings, preset
from problems import box, make_problem, make_scene, smooth_wind


def small(fidelity: str = "full", **robot: float):
    scene = make_scene(
        {"a": box(13, 2, 17, 6), "b": box(3, 13, 7, 17)}, [box(10, 9, 13, 12)], start=(2.0, 3.0)
    )
    wind = smooth_wind(scene, speed=1.0, sd=0.5, gust=0.3)
    craft = RobotConfig(dt=100.0, u_max=12.0, start_sd=100.0, **robot)
    models = preset(fidelity)
    problem = make_problem("F(a & F b)", scene, wind, craft, fidelity=models)
    return Settings(fidelity=models, robot=craft), wind, problem


@pytest.fixture(params=["full", "paper"])
def task(request):
    return small(request.param)


def test_a_taut_line_makes_a_forest_of_one_accepted_path(task):
    _, _, problem = task
    forest = one_line_forest(problem)
    (j, v), tree = forest.accepted[0], forest.trees[0]
    path = tree.path(v)
    assert j == 0
    assert len(path) == len(tree)
    assert problem.logic.distance[states_along(problem.cells, problem.logic, path)[-1]] == 0.0


def test_every_later_stage_is_carried_out(task):
    run = carry_out_small(*task)
    assert [key for key in (FRONT, PLAN, FORECASTS, DEPLOYMENTS) if key not in run.records] == []


def test_a_marker_stands_for_types_and_choices(task):
    settings, _, problem = task
    marker = code_marker(problem, settings)
    if config.DISABLE_JIT:
        assert marker is None
        return
    assert code_marker(problem, replace(settings, seed=5)) == marker
    others = replace(settings, fidelity=replace(settings.fidelity, refine="none"))
    assert code_marker(problem, others) != marker
    other = small("paper" if settings.fidelity == preset("full") else "full")[2]
    assert typeof(other.world) != typeof(problem.world)
    assert code_marker(other, settings) != marker


@pytest.fixture
def begun(monkeypatch, tmp_path):
    """Statements that processes were begun with; they wait for nothing and end. Nothing is compiled yet."""
    statements = []

    def begin(statement):
        statements.append(statement)
        return subprocess.Popen(
            [sys.executable, "-c", "import sys; sys.stdin.buffer.read()"], stdin=subprocess.PIPE
        )

    monkeypatch.setattr(compiling, "begin_process", begin)
    monkeypatch.setattr(compiling, "code_marker", lambda *_: tmp_path / "marker")
    return statements


def told(process, wind, problem):
    process.record_made("wind", wind)
    process.record_made("problem", problem)
    process.record_made("problem", problem)  # one process, however often


def test_one_process_begins_with_the_problem_where_nothing_is_compiled(begun, task):
    settings, wind, problem = task
    process = CompilingProcess(settings)
    told(process, wind, problem)
    assert begun == [compiling.PROGRAM]
    process.end()
    process.wait()


@pytest.mark.parametrize("terminal", [True, False])
def test_a_terminal_is_told_that_the_run_compiles(begun, task, terminal, monkeypatch, capsys):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: terminal)
    process = CompilingProcess(task[0])
    told(process, *task[1:])
    process.end()
    assert capsys.readouterr().err == (f"pareto-ltl: {compiling.NOTICE}\n" if terminal else "")


def test_none_begins_where_the_code_is_on_disk(begun, task, tmp_path):
    settings, wind, problem = task
    (tmp_path / "marker").touch()
    process = CompilingProcess(settings)
    told(process, wind, problem)
    process.wait()
    process.end()
    assert begun == []


def test_a_run_goes_on_where_no_process_can_begin(monkeypatch, begun, task):
    def refused(statement):
        raise OSError("no more processes")

    monkeypatch.setattr(compiling, "begin_process", refused)
    process = CompilingProcess(task[0])
    told(process, *task[1:])
    process.wait()
    process.end()


def test_the_process_leaves_its_marker(monkeypatch, task, tmp_path):
    monkeypatch.setattr(compiling, "code_marker", lambda *_: tmp_path / "marker")
    process = CompilingProcess(task[0])
    told(process, *task[1:])
    process.wait()
    process.end()
    assert (tmp_path / "marker").exists()


def test_a_mission_without_a_way_ends_the_process_quietly(monkeypatch, tmp_path, capfd):
    monkeypatch.setattr(compiling, "code_marker", lambda *_: tmp_path / "marker")
    settings, wind, _ = small()
    walled = make_scene({"a": box(13, 2, 17, 6)}, [box(8, 0, 9, 20)], start=(2.0, 3.0))
    without = make_problem("F a", walled, wind, settings.robot, fidelity=settings.fidelity)
    process = CompilingProcess(settings)
    told(process, wind, without)
    process.wait()
    process.end()
    assert not (tmp_path / "marker").exists()
    assert capfd.readouterr().err == ""


def test_ctrl_c_while_the_run_waits_ends_its_budget(task):
    """Here the wait is interrupted, there the front is made of what one look gives."""
    settings, wind, problem = task
    settings = replace(settings, planner=replace(settings.planner, budget_seconds=1e6))

    class Interrupted:
        def record_made(self, name, record):
            assert name == FRONT.name

        def wait(self):
            os.kill(os.getpid(), signal.SIGINT)

    run = Run(settings, records=Records({PROBLEM: problem, WIND: wind, FOREST: one_line_forest(problem)}))
    run.ahead["front"] = Interrupted()
    with run.budget.ends_at_key():
        run.perform(run.table["front"])
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)  # the front is made: this one is about the run
    assert run.budget.asked
    assert len(run[FRONT].paths) > 0
