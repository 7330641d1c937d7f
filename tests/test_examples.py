"""The examples run as they stand, and the documents name only what exists."""

from __future__ import annotations

import json
import pathlib
import re
import shlex
import subprocess
import sys
from functools import cache

import pytest

from unmeasured import untraced

ROOT = pathlib.Path(__file__).parents[1]
SCRIPTS = sorted((ROOT / "examples").glob("*.py"))


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    """What the process of an example told, which is run once."""

    @cache
    def run(script):
        command, place = [sys.executable, str(script)], tmp_path_factory.mktemp(script.stem)
        return subprocess.run(command, cwd=place, env=untraced(), capture_output=True, text=True, check=False)

    return run


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_an_example_runs_and_says_something(script, ran):
    done = ran(script)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip()
    assert "Warning" not in done.stderr


def test_the_python_example_reports_a_promise_and_what_came_of_it(ran):
    done = ran(ROOT / "examples" / "plan_from_python.py")
    promised = float(re.search(r"promised failure ([0-9.]+)", done.stdout)[1])
    simulated = float(re.search(r"simulated failure ([0-9.]+) in 500", done.stdout)[1])
    assert 0 <= promised < 0.02
    assert simulated < promised + 0.05


def test_the_counter_examples_break_the_papers_bound_and_not_the_ordered_one(ran):
    lines = ran(ROOT / "examples" / "bound_counterexamples.py").stdout.strip().splitlines()
    assert len(lines) == 2
    for line in lines:
        promised = float(line.split("Theorem 2 says ")[1].split(",")[0])
        ordered = float(line.split("ordered bound ")[1].split(";")[0])
        low, high = (float(end) for end in line.split("95 %: ")[1].rstrip(")").split(" to "))
        assert promised < 0.1 * low
        assert low < ordered < 8 * high  # a bound that says something: less than 1
        assert high < 0.1


def test_the_map_of_the_examples_is_read():
    from pareto_ltl.settings import SceneConfig
    from pareto_ltl.world.scene_settings import scene_from_settings as read_scene

    scene = read_scene(SceneConfig(file=str(ROOT / "examples" / "ozarks.geojson")), None)
    assert set(scene.regions) == {"springfield", "cairo", "memphis"}
    assert len(scene.obstacles) == 1


def documented_command(folder):
    """The words after ``pareto-ltl`` of the first command in the README of an example."""
    text = (ROOT / "examples" / folder / "README.md").read_text()
    command = re.search(r"^    (pareto-ltl (?:.*\\\n)*.*)$", text, re.MULTILINE)[1]
    return shlex.split(command.replace("\\\n", " "))[1:]


@pytest.mark.parametrize(
    ("folder", "result"), [("coast_survey", "recommended/plan.json"), ("glider_current", "plan.json")]
)
def test_the_command_of_an_example_folder_makes_a_plan(folder, result, tmp_path, monkeypatch):
    """In a small form: without coherent winds, and two starts."""
    from pareto_ltl_apps.cli.commands import run_command_line

    monkeypatch.chdir(ROOT)
    words = documented_command(folder)
    small = [
        "fidelity=paper",
        "planner.epsilon=0.99",
        "scene.border=wall",
        "planner.trees=2",
        "planner.n_max=2000",
        "report=none",
    ]
    if words[0] == "departure":
        words = [word for word in words if not word.startswith("departure.every")]
        small += ["departure.starts=[2018-10-09T00:00:00Z,2018-10-09T06:00:00Z]", "departure.flights=100"]
    assert run_command_line([*words, *small, f"hydra.run.dir={tmp_path}/run"]) == 0
    plan = json.loads((tmp_path / "run" / result).read_text())
    shown = {name for label in plan["label"] for name in label}
    assert set(plan["atoms"]) <= shown


def test_the_invented_current_is_what_its_script_writes(tmp_path):
    folder = ROOT / "examples" / "glider_current"
    (tmp_path / "make_current.py").write_text((folder / "make_current.py").read_text())
    subprocess.run([sys.executable, str(tmp_path / "make_current.py")], check=True)
    assert (tmp_path / "current.csv").read_bytes() == (folder / "current.csv").read_bytes()


@pytest.mark.parametrize(
    "document",
    [
        "README.md",
        "CONTRIBUTING.md",
        *(str(p.relative_to(ROOT)) for f in ("docs", "examples") for p in (ROOT / f).rglob("*.md")),
    ],
)
def test_links_in_a_document_lead_somewhere(document):
    text = (ROOT / document).read_text(encoding="utf-8")
    for target in re.findall(r"\]\((?!http)([^)#]+)", text):
        assert ((ROOT / document).parent / target).exists(), target


def test_an_example_of_the_interface_is_short():
    for script in SCRIPTS:
        code = [line for line in script.read_text().splitlines() if line.strip()]
        assert len(code) <= 15 or script.stem in (
            "bound_counterexamples",
            "objects_in_and_out",
            "send_mavlink",
            "telemetry_of_a_flight",
        ), script.name
