"""What Windows and macOS lack or do in another way, imitated: no fcntl, no resource, an old code page."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

BLOCKED = """
import builtins, sys
real = builtins.__import__
def refusing(name, space=None, *more, **named):
    asks = str((space or {}).get("__name__", ""))
    gone = name in ("fcntl", "grp", "pwd") or name == "resource" and asks.startswith("pareto_ltl")
    if gone:  # psutil has code of its own for each system, and needs resource on this one
        raise ModuleNotFoundError(f"No module named {name!r}", name=name)
    return real(name, space, *more, **named)
builtins.__import__ = refusing
for name in ("fcntl", "resource", "grp", "pwd"):
    sys.modules.pop(name, None)
"""
RUN = "from pareto_ltl.__main__ import main\nmain()\n"
SMALL = (
    "+experiment=phi1", "wind=calm", "planner.trees=1", "planner.n_max=800", "fidelity=paper",
    "fidelity.refine=none", "deployment.runs=5", "report.dpi=30",
)  # fmt: skip


def test_a_plan_is_made_where_fcntl_and_resource_do_not_exist(tmp_path: Path) -> None:
    place = tmp_path / "Pläne für März" / "φ1 (2)"
    command = [sys.executable, "-W", "ignore", "-c", BLOCKED + RUN, *SMALL, f"hydra.run.dir='{place}'"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    assert json.loads((place / "run.json").read_text())["status"] == "ok"
    assert json.loads((place / "metrics.json").read_text())["memory_mib"] > 10
    assert not (place / "run.lock").exists()


def test_the_memory_of_a_run_is_known_without_resource() -> None:
    told = "from pareto_ltl.run.metrics import peak_memory\nprint(peak_memory())\n"
    done = subprocess.run([sys.executable, "-c", BLOCKED + told], capture_output=True, text=True, check=True)
    assert 10 < float(done.stdout) < 10_000


@pytest.mark.parametrize("encoding", ["ascii", "cp1252"])
@pytest.mark.parametrize("words", [["--help=all"], ["formula", "F(a & F b)"], ["+experiment=φ1"]])
def test_a_terminal_that_lacks_a_letter_gets_another_one(encoding: str, words: list[str]) -> None:
    command = [sys.executable, "-m", "pareto_ltl", *words]
    environment = os.environ | {"PYTHONIOENCODING": encoding}
    done = subprocess.run(command, capture_output=True, env=environment, check=False)
    assert done.returncode in (0, 2), done.stderr
    assert b"bug" not in done.stderr
