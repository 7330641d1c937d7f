"""Benchmarks, which only a person runs, call the code of today: names and arguments that exist."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
STALE = re.compile(r"error: .*\[(?:attr-defined|call-arg|name-defined)\]$")


def test_benchmarks_call_what_exists() -> None:
    places = os.pathsep.join(str(ROOT / name) for name in ("tests", "benchmarks"))
    command = [sys.executable, "-m", "mypy", "benchmarks", "--no-error-summary", "--hide-error-context"]
    done = subprocess.run(
        command, cwd=ROOT, env=os.environ | {"MYPYPATH": places}, capture_output=True, text=True, check=False
    )
    assert done.stderr == ""
    assert [line for line in done.stdout.splitlines() if STALE.search(line)] == []
