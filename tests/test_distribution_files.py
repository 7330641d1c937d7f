"""Files that nobody runs here: the workflow of the forge, and the Containerfile."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

import yaml

ROOT = Path(__file__).resolve().parents[1]
PROJECT: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
EXTRAS = set(PROJECT["optional-dependencies"])


def test_the_workflow_has_every_supported_python_and_the_three_systems() -> None:
    jobs = yaml.safe_load((ROOT / ".github" / "workflows" / "ci.yml").read_text())["jobs"]
    lowest = PROJECT["requires-python"].split(",")[0].removeprefix(">=")
    pythons = jobs["check"]["strategy"]["matrix"]["python"]
    assert pythons == ["3.11", "3.12", "3.13"]
    assert pythons[0] == lowest
    listed = {name.rpartition(" ")[2] for name in PROJECT["classifiers"] if ":: 3." in name}
    assert listed in (set(), set(pythons))
    systems = {job["runs-on"] for job in jobs.values()} | set(jobs["systems"]["strategy"]["matrix"]["system"])
    for kind in ("ubuntu", "windows", "macos"):
        assert any(system.startswith(kind) for system in systems)
    commands = [step.get("run", "") for job in jobs.values() for step in job["steps"]]
    assert ".ci/run" in commands
    for command in commands:
        for extras in re.findall(r'"\.\[([\w,]+)\]"', command):
            assert set(extras.split(",")) <= EXTRAS
        for path in re.findall(r"\btests/[\w./]+", command):
            assert (ROOT / path).exists()


def test_the_container_installs_extras_that_exist_and_runs_as_a_user() -> None:
    lines = (ROOT / "Containerfile").read_text().splitlines()
    (extras,) = re.findall(r"/source\[([\w,]+)\]", "\n".join(lines))
    assert set(extras.split(",")) <= EXTRAS
    assert any(line.startswith("USER ") and line != "USER root" for line in lines)
    assert 'ENTRYPOINT ["pareto-ltl"]' in lines
    assert PROJECT["scripts"]["pareto-ltl"]
