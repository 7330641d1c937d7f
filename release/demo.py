"""``make demo``: plan a first mission, and say how to look at it and how to go on."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

from declared_settings import install_command

MISSION = "phi1"
OUTPUTS = Path("outputs") / MISSION


def main() -> int:
    """Plan, and print the next commands; the exit code of the run."""
    print(
        "planning a first mission: a first run compiles its kernels, a minute or two, later ones do not",
        flush=True,
    )
    run = subprocess.Popen([sys.executable, "-m", "pareto_ltl", f"+experiment={MISSION}"])
    while True:
        try:
            code = run.wait()
            break
        except KeyboardInterrupt:  # the run ends by itself, which may take a moment
            continue
    if code == 0 and (folder := results_of(run.pid)) is not None:
        print("\n".join(next_steps(folder)))
    return code


def results_of(pid: int) -> Path | None:
    """The results directory of the run in the process ``pid``; the newest, as numbers come again."""
    found: list[Path] = []
    for file in OUTPUTS.glob("*/run.json"):
        with suppress(OSError, ValueError):
            if json.loads(file.read_text(encoding="utf-8")).get("pid") == pid:
                found.append(file)
    return max(found, key=lambda file: file.stat().st_mtime).parent if found else None


def next_steps(folder: Path) -> tuple[str, str]:
    """Two lines: the result as a page; the desk, and the tour in Python."""
    bin = os.path.relpath(Path(sys.executable).parent)
    notebook = f"{install_command('notebook')} && {bin}/jupyter notebook examples/tour.ipynb"
    return (
        f"look at it: {bin}/pareto-ltl show {folder}",
        f"go on: make desk (draw and plan in a browser), or a tour in Python: {notebook}",
    )


if __name__ == "__main__":
    sys.exit(main())
