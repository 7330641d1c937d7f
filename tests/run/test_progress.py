"""The progress bar of a run: its stage, and how much of it is done."""

from __future__ import annotations

import pytest

from pareto_ltl.run.progress import ProgressBar


def test_the_bar_has_the_counts_of_a_stage_or_its_state(capsys: pytest.CaptureFixture[str]) -> None:
    with ProgressBar(shown=True) as bar, bar.stage("compare"):
        bar(3, 1200)
        assert bar._bar is not None  # noqa: SLF001
        (task,) = bar._bar.tasks  # noqa: SLF001
        assert (task.description, task.fields["state"]) == ("compare", "3 of 1,200")
        bar(4, 1200, "2 paths")
        assert task.fields["state"] == "2 paths"
    assert capsys.readouterr().out == ""
