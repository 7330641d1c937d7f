"""Files that nobody runs here: the workflow of the forge, the Containerfile, the table of licences."""

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


def test_every_dependency_of_the_core_has_its_licence_in_the_table() -> None:
    text = (ROOT / "docs" / "install.md").read_text()
    rows = re.findall(r"^\| ([\w.-]+) \| ([\w.]+) \| ([^|]+) \| ([\d.]+) \|$", text, re.MULTILINE)
    licences = {name.lower(): licence.strip() for name, _, licence, _ in rows}
    wanted = {re.match(r"[\w-]+", line)[0].lower() for line in PROJECT["dependencies"]}  # type: ignore[index]
    assert wanted <= set(licences)
    assert all(licences.values())
    copyleft = {name for name, licence in licences.items() if re.search(r"\b[AL]?GPL", licence)}
    assert copyleft == {"moocore"}
    assert "**moocore is LGPL-2.1-or-later**" in text
