"""The hooks before a commit use the tools of the environment at hand, whichever it is."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
TOOL = Path(".ci", "tool")

pytestmark = pytest.mark.skipif(os.name != "posix", reason="runs a shell script")


def environment(place: Path, *names: str) -> Path:
    """A folder that looks like an environment; its tools print where they are."""
    (place / "bin").mkdir(parents=True)
    for name in names:
        program = place / "bin" / name
        program.write_text(f'#!/bin/sh\necho "{place} $*"\n')
        program.chmod(0o755)
    return place


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A folder with the script alone."""
    place = tmp_path / "check out"
    (place / ".ci").mkdir(parents=True)
    shutil.copy(ROOT / TOOL, place / TOOL)
    return place


def run_tool(checkout: Path, **variables: Path) -> subprocess.CompletedProcess[str]:
    told = {name: str(value) for name, value in variables.items()}
    return subprocess.run(
        [checkout / TOOL, "ruff", "check", "a file.py"],
        env={"PATH": "/usr/bin:/bin"} | told, cwd="/", capture_output=True, text=True, check=False,
    )  # fmt: skip


@pytest.mark.parametrize("variable", ["VIRTUAL_ENV", "CONDA_PREFIX"])
def test_the_active_environment_comes_first(checkout: Path, tmp_path: Path, variable: str) -> None:
    environment(checkout / ".venv", "ruff", "pareto-ltl")
    active = environment(tmp_path / "active", "ruff", "pareto-ltl")
    assert run_tool(checkout, **{variable: active}).stdout == f"{active} check a file.py\n"


def test_an_active_environment_of_another_project_is_passed_over(checkout: Path, tmp_path: Path) -> None:
    own = environment(checkout / ".venv", "ruff", "pareto-ltl")
    other = environment(tmp_path / "other", "ruff")
    assert run_tool(checkout, VIRTUAL_ENV=other).stdout == f"{own} check a file.py\n"


def test_without_an_environment_the_path_decides(checkout: Path, tmp_path: Path) -> None:
    installed = environment(tmp_path / "installed", "ruff", "pareto-ltl")
    path = Path(f"{installed / 'bin'}:/usr/bin:/bin")
    assert run_tool(checkout, PATH=path).stdout == f"{installed} check a file.py\n"


def test_no_environment_is_one_line_that_says_what_to_do(checkout: Path) -> None:
    done = run_tool(checkout)
    assert done.returncode == 1
    assert done.stdout == ""
    assert done.stderr.count("\n") == 1
    assert "make install" in done.stderr


def test_a_commit_is_checked_by_the_tools_of_this_environment(checkout: Path, tmp_path: Path) -> None:
    """In a repository without ``.venv``, the hook of ruff mends a file and stops the commit."""
    for name in (".pre-commit-config.yaml", "pyproject.toml"):
        shutil.copy(ROOT / name, checkout / name)
    (checkout / "mended.py").write_text('"""One module."""\n\nimport os\n')
    git = ["git", "-C", str(checkout), "-c", "user.name=n", "-c", "user.email=e@example.org"]
    subprocess.run([*git, "init", "-q"], check=True)
    subprocess.run([*git, "add", "."], check=True)
    variables = {name: value for name, value in os.environ.items() if not name.startswith(("GIT_", "CONDA_"))}
    variables |= {"VIRTUAL_ENV": sys.prefix, "PRE_COMMIT_HOME": str(tmp_path / "kept")}
    command = [sys.executable, "-m", "pre_commit", "run", "ruff-check", "--all-files"]
    done = subprocess.run(command, cwd=checkout, env=variables, capture_output=True, text=True, check=False)
    assert done.returncode == 1, done.stderr
    assert "Failed" in done.stdout
    assert (checkout / "mended.py").read_text().strip() == '"""One module."""'
