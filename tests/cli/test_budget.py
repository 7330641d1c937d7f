"""A run with a budget of time: it ends in time, and Ctrl-C makes a plan from the paths so far."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time

import pytest

from patience import PATIENCE
from unmeasured import untraced

WORDS = ("+experiment=phi2", "planner.trees=2", "planner.n_max=800", "deployment.runs=50", "report=none")


def begun(folder, *words):
    command = [sys.executable, "-m", "pareto_ltl", *WORDS, f"hydra.run.dir={folder}", *words]
    return subprocess.Popen(
        command, env=untraced(), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def told(process):
    out, err = process.communicate(timeout=PATIENCE)
    return process.returncode, out, err


@pytest.mark.skipif(os.name == "nt", reason="Windows sends Ctrl-C to a whole console")
def test_ctrl_c_ends_the_budget_and_the_front_so_far_is_written(tmp_path):
    process = begun(tmp_path / "run", "planner.budget_seconds=100000")
    log, end = tmp_path / "run" / "run.log", time.monotonic() + PATIENCE
    while time.monotonic() < end and not (log.is_file() and "forest done" in log.read_text()):
        time.sleep(0.05)
    time.sleep(1.0)
    process.send_signal(signal.SIGINT)
    code, _, err = told(process)
    assert code == 0, err
    assert "made from the paths so far" in log.read_text()
    metrics = json.loads((tmp_path / "run" / "metrics.json").read_text())
    assert metrics["completed"]
    assert (tmp_path / "run" / "front.csv").read_text().count("\n") >= 2


def test_a_run_ends_with_its_budget(tmp_path):
    code, _, err = told(begun(tmp_path / "run", "planner.budget_seconds=0.5"))
    assert code == 0, err
    assert json.loads((tmp_path / "run" / "metrics.json").read_text())["completed"]


def test_a_budget_of_nothing_is_refused(tmp_path):
    code, _, err = told(begun(tmp_path / "run", "planner.budget_seconds=0"))
    assert code == 2
    assert err == "pareto-ltl: planner.budget_seconds must be positive and at most 1e9 [s], got 0.0\n"
    assert not (tmp_path / "run").exists()
