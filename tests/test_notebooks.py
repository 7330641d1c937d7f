"""The notebooks run in a kernel from their first cell to their last, and store small outputs."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import nbformat
import pytest

from levels import AT_NIGHT

EXAMPLES = Path(__file__).parents[1] / "examples"
NOTEBOOKS = sorted(EXAMPLES.glob("*.ipynb"))
LONGEST = 1800  # [s] of a cell that compiles on a busy machine
PNG = "image/png"
EXECUTE = """
import sys, nbformat
from jupyter_client.manager import AsyncKernelManager
from nbclient import NotebookClient

notebook = nbformat.read(sys.argv[1], as_version=4)
manager = AsyncKernelManager(kernel_name="python3", transport="ipc", ip="./kernel")
NotebookClient(notebook, km=manager, timeout=int(sys.argv[2])).execute()
nbformat.write(notebook, sys.argv[3])
"""  # by a separate process: the client leaves sockets open until it ends
FIGURES = {"forecast_doubt": 5, "own_mission": 3, "tour": 4, "trade_off_phi2": 5}


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_stores_small_outputs_and_nothing_of_a_machine(path: Path) -> None:
    """They are written by benchmarks/notebooks.py."""
    content = json.loads(path.read_text(encoding="utf-8"))
    assert set(content["metadata"]) == {"kernelspec", "language_info"}
    assert content["metadata"]["kernelspec"]["name"] == "python3"
    code = [cell for cell in content["cells"] if cell["cell_type"] == "code"]
    assert [cell["execution_count"] for cell in code] == list(range(1, len(code) + 1))
    outputs = [output for cell in code for output in cell["outputs"]]
    assert sum(PNG in output.get("data", {}) for output in outputs) == FIGURES[path.stem]
    assert [output for output in outputs if output.get("name") == "stderr"] == []
    assert all(cell["metadata"] == {} for cell in content["cells"])
    words = json.dumps([{**output, "data": {**output.get("data", {}), PNG: ""}} for output in outputs])
    assert re.search(r"/(?:tmp|home|root|Users)/", words) is None
    assert path.stat().st_size < 400_000


def test_every_notebook_is_tested_and_named_in_the_readme() -> None:
    readme = (EXAMPLES.parent / "README.md").read_text(encoding="utf-8")
    assert {path.stem for path in NOTEBOOKS} == set(FIGURES)
    assert [path.name for path in NOTEBOOKS if f"examples/{path.name}" not in readme] == []


# One before a change is taken in, all at night: 14 s each.
@pytest.fixture(
    scope="module",
    params=NOTEBOOKS if AT_NIGHT else [EXAMPLES / "own_mission.ipynb"],
    ids=lambda path: path.stem,
)
def executed(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Any]:
    """Name and cells of a notebook that has run; all notebooks share the kernels that the first compiled."""
    folder = tmp_path_factory.mktemp(request.param.stem)
    command = [sys.executable, "-c", EXECUTE, str(request.param), str(LONGEST), "done.ipynb"]
    environment = os.environ | {"TMPDIR": str(folder)}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return request.param.stem, nbformat.read(folder / "done.ipynb", as_version=4).cells


def outputs_of(cells: Any) -> list[Any]:
    return [output for cell in cells if cell.cell_type == "code" for output in cell.outputs]


def said_by(cells: Any) -> str:
    """What cells print, and the text of the values that they show."""
    shown = ((output.get("text"), output.get("data", {})) for output in outputs_of(cells))
    return "\n".join(text or data.get("text/plain", "") for text, data in shown)


def test_a_notebook_runs_without_a_warning_and_shows_its_figures(executed: tuple[str, Any]) -> None:
    name, cells = executed
    outputs = outputs_of(cells)
    assert [output.text for output in outputs if output.get("name") == "stderr"] == []
    assert sum(PNG in output.get("data", {}) for output in outputs) == FIGURES[name]
    for output in outputs:
        shown = output.get("data", {})
        if "text/html" in shown:
            assert shown["text/html"].startswith("<table>")
            assert "\n" not in shown["text/plain"]


def test_a_notebook_says_what_its_text_speaks_of(executed: tuple[str, Any]) -> None:
    name, cells = executed
    said = said_by(cells)
    if name == "tour":
        assert "unknown setting planner.treez; did you mean planner.trees?" in said
        assert "'plan.json'" in said
        assert 0.0 <= float(re.search(r"coherent: ([0-9.]+) of 500", said)[1]) < 1.0  # type: ignore[index]
    elif name == "trade_off_phi2":
        shown = re.findall(r"^ *\d+ +(\d+) km .* fails ([\d.]+) %", said, re.MULTILINE)
        lengths, failures = zip(*((float(length), float(rate)) for length, rate in shown), strict=True)
        assert len(shown) >= 3
        assert list(lengths) == sorted(lengths, reverse=True)
        assert list(failures) == sorted(failures)
        safe, short, both = map(int, re.findall(r"(\d+) (?:are too much|for the short|for both)", said))
        assert both <= safe < short
    elif name == "forecast_doubt":
        rates = [float(rate) for rate in re.findall(r"([\d.]+)% of 1,000 flights fail", said)]
        assert len(rates) == 2
        assert rates[0] < rates[1]
        assert "forecast error by the law gfs for leads 0 to 39 h" in said
    else:
        assert "to {springfield}" in said
        assert all(file in said for file in ("plan.kml", "plan.gpx", "mission.plan", "report.html"))
        assert "leg,time_utc" in said
