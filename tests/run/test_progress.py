"""The progress bar of a run: its stage, and how much of it is done."""

from __future__ import annotations

import io
import re
from contextlib import suppress

import pytest
from rich.console import Console

import pareto_ltl
from pareto_ltl.run.pipeline import known_stages
from pareto_ltl.run.plan_run import PLAN_STAGES, Run
from pareto_ltl.run.progress import Caller, ProgressBar
from pareto_ltl.support.errors import InfeasibleError
from pareto_ltl.support.resources import PACKAGE


def test_the_bar_has_the_counts_of_a_stage_or_its_state(capsys: pytest.CaptureFixture[str]) -> None:
    with ProgressBar(shown=True) as bar, bar.stage("compare"):
        bar(3, 1200)
        assert bar._bar is not None  # noqa: SLF001
        (task,) = bar._bar.tasks  # noqa: SLF001
        assert (task.description, task.fields["state"]) == ("compare", "3 of 1,200")
        bar(4, 1200, "2 paths")
        assert task.fields["state"] == "2 paths"
    assert capsys.readouterr().out == ""


def test_the_words_of_the_stages_are_those_of_the_desk() -> None:
    script = (PACKAGE.with_name("pareto_ltl_apps") / "desk" / "page" / "result.js").read_text(
        encoding="utf-8"
    )
    (table,) = re.findall(r"const STAGES = \{(.*?)\};", script, re.DOTALL)
    words = {stage.stage: stage.words for stage in known_stages() if stage.words}
    assert dict(re.findall(r'(\w+): "(.*?)"', table)) == words
    assert all(stage.words for stage in PLAN_STAGES)


def test_a_line_of_a_terminal_holds_the_time_and_the_words_of_the_front() -> None:
    screen = io.StringIO()
    with ProgressBar(shown=True) as bar, bar.stage("front", Run.front.words):
        assert bar._bar is not None  # noqa: SLF001
        bar(3, 64, "14 paths of at least 1,672 km; the safest fails 0.85 % at 2,102 km")
        Console(file=screen, width=80).print(bar._bar.get_renderable())  # noqa: SLF001
    text = " ".join(screen.getvalue().split())
    assert "Improving the paths" in text
    assert "0:00:00" in text
    assert "…" not in text


def test_a_function_hears_of_each_stage_and_its_counts() -> None:
    heard: list[tuple[str, int, int, str]] = []
    small = {"planner": {"trees": 1, "n_max": 200}, "fidelity": "paper", "wind": "calm"}
    with suppress(InfeasibleError):
        pareto_ltl.plan("phi1", "F a", on_progress=lambda *news: heard.append(news), **small)
    begun = [name for name, done, total, text in heard if (done, total, text) == (0, 0, "")]
    assert begun[:5] == ["readings", "scene", "decomposition", "automaton", "observations"]
    assert {total for name, _, total, _ in heard if name == "forest"} <= {0, 200}
    bar = ProgressBar(shown=False, watcher=Caller(lambda *news: heard.append(news)))
    with bar.stage("front"):
        bar(3, 8, "2 paths")
    assert heard[-1] == ("front", 3, 8, "2 paths")


def test_after_a_stage_inside_another_one_the_outer_one_goes_on() -> None:
    heard: list[str] = []
    bar = ProgressBar(shown=False, watcher=Caller(lambda name, *_: heard.append(name)))
    with bar.stage("plan"), bar.stage("front"):
        bar(1, 2)
    assert heard == ["plan", "front", "front", "plan"]
