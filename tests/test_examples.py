"""The examples run as they stand, and the documents name only what exists."""

from __future__ import annotations

import os
import pathlib
import re
import subprocess
import sys

import pytest

ROOT = pathlib.Path(__file__).parents[1]
SCRIPTS = sorted((ROOT / "examples").glob("*.py"))


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_an_example_runs_and_says_something(script, tmp_path):
    environment = os.environ | {"PARETO_LTL_CACHE": str(tmp_path / "cache")}
    done = subprocess.run(
        [sys.executable, str(script)],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip()
    assert "Warning" not in done.stderr


def test_the_python_example_reports_a_promise_and_what_came_of_it(tmp_path):
    environment = os.environ | {"PARETO_LTL_CACHE": str(tmp_path / "cache")}
    script = ROOT / "examples" / "plan_from_python.py"
    done = subprocess.run(
        [sys.executable, str(script)],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    promised = float(re.search(r"ordered bound ([0-9.]+)", done.stdout)[1])
    simulated = float(re.search(r"simulated failure ([0-9.]+) in 500", done.stdout)[1])
    assert 0 <= promised < 0.2
    assert simulated < promised + 0.1


def test_the_map_of_the_examples_is_read():
    from pareto_ltl.settings import SceneConfig
    from pareto_ltl.world.scene_settings import scene_from_settings as read_scene

    scene = read_scene(SceneConfig(file=str(ROOT / "examples" / "ozarks.geojson")), None)
    assert set(scene.regions) == {"springfield", "cairo", "memphis"}
    assert len(scene.obstacles) == 1


@pytest.mark.parametrize(
    "document", ["README.md", "CONTRIBUTING.md", *(f"docs/{p.name}" for p in (ROOT / "docs").glob("*.md"))]
)
def test_links_in_a_document_lead_somewhere(document):
    text = (ROOT / document).read_text(encoding="utf-8")
    for target in re.findall(r"\]\((?!http)([^)#]+)", text):
        assert ((ROOT / document).parent / target).exists(), target
