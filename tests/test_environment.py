"""``make`` on a machine with Python and pip: the environment, its locks, and what can go wrong on the way.

A small project takes the place of this one, with the same ``Makefile`` and ``release``, and packages that are
made here: nothing is downloaded.
"""

from __future__ import annotations

import base64
import hashlib
import importlib.util
import os
import shutil
import signal
import subprocess
import sys
import time
import zipfile
from collections import namedtuple
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[1]
FETCHED_UV = '''"""In place of the uv that pip fetches: notes its words, and lets pip install."""
import os, subprocess, sys

def main():
    words = sys.argv[1:]
    if words == ["cache", "dir"]:
        return print(os.path.expanduser("~/.cache/uv"))
    with open(os.environ["CALLS"], "a") as calls:
        print("uv", *words, file=calls)
        print("index", os.environ.get("UV_DEFAULT_INDEX"), file=calls)
    at = words.index("--python")
    return subprocess.call([words[at + 1], "-m", "pip", "install", *words[2:at], *words[at + 2:]])
'''
UV = """#!/bin/sh
echo "uv $* cache $UV_CACHE_DIR" >> "$CALLS"
case "$1" in
  venv) for place; do :; done; exec python3 -m venv --without-pip --clear "$place";;
  cache) echo "$HOME/.cache/uv";;
  pip) [ -z "$SLOW" ] || exec sleep "$SLOW"; [ -z "$UV_FAILS" ] || { echo "error: $UV_FAILS"; exit 2; };;
esac
"""
BACKEND = """import zipfile
INFO = "pareto_ltl-1.0.dist-info/"
HEAD = "Metadata-Version: 2.1\\nName: pareto-ltl\\nVersion: 1.0\\n"
WHEEL = "Wheel-Version: 1.0\\nGenerator: x\\nRoot-Is-Purelib: true\\nTag: py3-none-any\\n"

def build_editable(folder, settings=None, metadata=None):
    name = "pareto_ltl-1.0-py3-none-any.whl"
    with zipfile.ZipFile(folder + "/" + name, "w") as wheel:
        for file, text in (("METADATA", HEAD), ("WHEEL", WHEEL), ("RECORD", "")):
            wheel.writestr(INFO + file, text)
    return name
"""


def make_wheel(folder: Path, name: str, code: str = "", script: str = "") -> str:
    """A wheel of one module; its line in a lock."""
    info = f"{name}-1.0.dist-info"
    files = {
        f"{name}.py": code,
        f"{info}/METADATA": f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n",
        f"{info}/WHEEL": "Wheel-Version: 1.0\nGenerator: test\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
    }
    if script:
        files[f"{info}/entry_points.txt"] = f"[console_scripts]\n{script}\n"
    record = "".join(
        f"{path},sha256={base64.urlsafe_b64encode(hashlib.sha256(text.encode()).digest()).decode().rstrip('=')},{len(text.encode())}\n"
        for path, text in files.items()
    )
    path = folder / f"{name}-1.0-py3-none-any.whl"
    with zipfile.ZipFile(path, "w") as wheel:
        for place, text in {**files, f"{info}/RECORD": record + f"{info}/RECORD,,\n"}.items():
            wheel.writestr(place, text)
    return f"{name}==1.0 \\\n    --hash=sha256:{hashlib.sha256(path.read_bytes()).hexdigest()}\n"


class Project:
    """A checkout whose folder has a space in its name, and the settings of its user."""

    def __init__(self, folder: Path, *, uv: bool) -> None:
        self.root, self.wheels = folder / "a checkout", folder / "wheels"
        (self.root / "release").mkdir(parents=True)
        self.wheels.mkdir()
        for name in ("Makefile", "release/environment.py", "release/watching.py"):
            shutil.copy(ROOT / name, self.root / name)
        runs, tested, desk = (make_wheel(self.wheels, name) for name in ("runs", "tested", "desk"))
        fetched = make_wheel(self.wheels, "uv", FETCHED_UV, "uv = uv:main")
        (self.root / "requirements.lock").write_text(runs)
        (self.root / "requirements-dev.lock").write_text(desk + runs + tested + fetched)
        (self.root / "pyproject.toml").write_text(
            '[build-system]\nrequires = []\nbuild-backend = "backend"\nbackend-path = ["."]\n'
        )
        (self.root / "backend.py").write_text(BACKEND)
        self.calls, self.home = folder / "calls", folder / "home"
        self.home.mkdir()
        tools = folder / "bin"
        tools.mkdir()
        for tool in ("make", "sh", "bash", "env", "rm", "touch", "mkdir", "sleep"):
            if (found := shutil.which(tool)) is not None:
                (tools / tool).symlink_to(found)
        (tools / "python3").write_text(f'#!/bin/sh\nexec "{base_python()}" "$@"\n')
        (tools / "python3").chmod(0o755)
        if uv:
            (tools / "uv").write_text(UV)
            (tools / "uv").chmod(0o755)
        self.env = {
            "PATH": str(tools), "HOME": str(self.home), "CALLS": str(self.calls), "PIP_NO_INDEX": "1",
            "PIP_FIND_LINKS": self.wheels.as_uri(), "PIP_CONFIG_FILE": os.devnull, "LC_ALL": "C.UTF-8",
        }  # fmt: skip

    def make(self, target: str, *words: str, **env: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            ["make", "--no-print-directory", target, *words], cwd=self.root, capture_output=True, text=True,
            env=self.env | env, check=False, timeout=300,
        )  # fmt: skip

    def packages(self) -> set[str]:
        found = self.root.glob(".venv/lib/python*/site-packages/*.dist-info")
        return {path.name.partition("-")[0] for path in found} - {"pip", "setuptools"}

    def installed(self) -> list[str]:
        text = self.calls.read_text() if self.calls.exists() else ""
        return [line for line in text.splitlines() if line.startswith("uv pip install")]


def base_python() -> str:
    return str(getattr(sys, "_base_executable", sys.executable))


@pytest.fixture
def bare(tmp_path: Path) -> Project:
    """On a machine with Python and pip."""
    return Project(tmp_path, uv=False)


@pytest.fixture
def project(tmp_path: Path) -> Project:
    """On a machine with uv, of which the stand-in only notes what it shall do."""
    return Project(tmp_path, uv=True)


def environment(monkeypatch: pytest.MonkeyPatch, name: str = "environment") -> ModuleType:
    monkeypatch.syspath_prepend(str(ROOT / "release"))
    spec = importlib.util.spec_from_file_location(name, ROOT / "release" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_pip_fetches_uv_which_installs_what_a_run_needs_and_tests_only_add(bare: Project) -> None:
    config = bare.home / "pip.conf"
    config.write_text("[global]\nindex-url = https://mirror.example/simple\n")
    bare.env["PIP_CONFIG_FILE"] = str(config)
    done = bare.make(".venv/.ready-run")
    assert done.returncode == 0, done.stdout + done.stderr
    assert bare.packages() == {"uv", "runs", "pareto_ltl"}
    assert len(bare.installed()) == 3  # pip as a program, the lock, and the project
    assert (bare.root / ".venv" / "bin" / "pip").exists()
    assert "index https://mirror.example/simple" in bare.calls.read_text()
    for words in ("installing uv", "1 packages of requirements.lock into .venv, with uv: about", "done in"):
        assert words in done.stdout
    file = next(bare.root.glob(".venv/lib/python*/site-packages/runs.py"))
    before = file.stat().st_ctime_ns
    assert "up to date" in bare.make(".venv/.ready-run").stdout
    more = bare.make(".venv/.ready")
    assert more.returncode == 0, more.stdout + more.stderr
    assert bare.packages() == {"uv", "runs", "pareto_ltl", "desk", "tested"}
    assert file.stat().st_ctime_ns == before
    assert "up to date" in bare.make(".venv/.ready-run").stdout


def test_without_uv_pip_goes_on(bare: Project) -> None:
    (bare.wheels / "uv-1.0-py3-none-any.whl").unlink()
    done = bare.make(".venv/.ready-run")
    assert done.returncode == 0, done.stdout + done.stderr
    assert bare.packages() == {"runs", "pareto_ltl"}
    (line,) = done.stderr.splitlines()
    assert line.startswith("uv cannot be fetched (")
    assert line.endswith("pip goes on")
    assert "with pip: about" in done.stdout


def test_without_a_network_one_line_says_what_to_do(bare: Project) -> None:
    for wheel in bare.wheels.iterdir():
        wheel.unlink()
    done = bare.make(".venv/.ready-run")
    assert done.returncode == 2
    assert (
        "pareto_ltl: installing 1 packages of requirements.lock into .venv: the package index" in done.stderr
    )
    assert "pip config set global.index-url URL" in done.stderr
    assert not (bare.root / ".venv" / ".ready-run").exists()


def test_a_uv_that_fails_is_followed_by_pip(project: Project) -> None:
    done = project.make(".venv/.ready-run", UV_FAILS="tunnel error: the proxy refused")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "uv failed (error: tunnel error: the proxy refused); pip goes on" in done.stderr
    assert "runs" in project.packages()


def test_a_full_disk_ends_with_one_line_and_not_with_pip(project: Project) -> None:
    done = project.make(".venv/.ready-run", UV_FAILS="failed to write: No space left on device (os error 28)")
    assert done.returncode == 2
    (line,) = (line for line in done.stderr.splitlines() if not line.startswith("make"))
    assert "the disk is full: free some space" in line
    assert not (project.root / ".venv" / ".ready-run").exists()


def test_an_extra_adds_its_packages_in_the_versions_of_the_lock(project: Project) -> None:
    done = project.make(".venv/.ready-run-serve")
    assert done.returncode == 0, done.stdout + done.stderr
    assert ".pins" in project.installed()[-1]
    assert f"{project.root}[serve]" in project.installed()[-1]


def test_a_lock_that_changed_makes_the_environment_anew(project: Project) -> None:
    assert project.make(".venv/.ready-run").returncode == 0
    assert project.make(".venv/.ready").returncode == 0
    lock = project.root / "requirements-dev.lock"
    lock.write_text(lock.read_text().replace("tested==1.0", "tested==1.1"))
    os.utime(lock, (time.time() + 5, time.time() + 5))
    assert project.calls.read_text().count("uv venv") == 1
    assert project.make(".venv/.ready").returncode == 0
    assert project.calls.read_text().count("uv venv") == 2


def test_a_home_that_cannot_be_written_is_not_needed(project: Project) -> None:
    done = project.make(".venv/.ready-run", HOME="/dev/null")
    assert done.returncode == 0, done.stdout + done.stderr
    assert f"cache {project.root}/.venv/.scratch" in project.installed()[0]
    assert not (project.root / ".venv" / ".scratch").exists()


def test_two_at_the_same_time_are_one_after_the_other(project: Project) -> None:
    words = ["make", "--no-print-directory", ".venv/.ready-run"]
    pipe = subprocess.PIPE
    both = [
        subprocess.Popen(words, cwd=project.root, env=project.env, stdout=pipe, stderr=pipe, text=True)
        for _ in range(2)
    ]
    said = [process.communicate(timeout=300) for process in both]
    assert [process.returncode for process in both] == [0, 0], said
    assert len(project.installed()) == 2  # of one of them


def test_who_waits_for_another_installation_is_told(project: Project) -> None:
    import fcntl

    place = os.open(project.root, os.O_RDONLY)
    fcntl.flock(place, fcntl.LOCK_EX)
    words = ["make", "--no-print-directory", ".venv/.ready-run"]
    second = subprocess.Popen(words, cwd=project.root, env=project.env, stderr=subprocess.PIPE, text=True)
    assert second.stderr is not None
    assert second.stderr.readline() == f"waiting for another installation in {project.root}\n"
    assert project.installed() == []
    os.close(place)
    assert second.wait(timeout=300) == 0
    second.stderr.close()
    assert len(project.installed()) == 2


def test_an_interrupted_installation_begins_again(project: Project) -> None:
    (project.root / ".venv").mkdir()
    (project.root / ".venv" / "pyvenv.cfg").touch()
    assert project.make(".venv/.ready-run").returncode == 0
    assert (project.root / ".venv" / ".ready-run").exists()
    (project.root / ".venv" / ".ready-run").unlink()
    assert project.make(".venv/.ready-run").returncode == 0
    assert project.calls.read_text().count("uv venv") == 2


def test_ctrl_c_ends_the_installer_and_the_next_call_begins_again(project: Project) -> None:
    words = ["make", "--no-print-directory", ".venv/.ready-run"]
    first = subprocess.Popen(
        words, cwd=project.root, env=project.env | {"SLOW": "100"}, stderr=subprocess.PIPE, text=True,
        start_new_session=True,
    )  # fmt: skip
    while not project.installed():
        time.sleep(0.05)
    os.killpg(first.pid, signal.SIGINT)
    _, said = first.communicate(timeout=60)
    assert first.returncode != 0
    assert "stopped; 'make' begins again with .venv" in said
    assert "Traceback" not in said
    assert not (project.root / ".venv" / ".ready-run").exists()
    assert project.make(".venv/.ready-run").returncode == 0


def test_a_folder_with_other_files_is_not_removed(project: Project) -> None:
    (project.root / "data").mkdir()
    (project.root / "data" / "mine").touch()
    done = project.make("data/.ready-run", "VENV=data")
    assert done.returncode == 2
    assert "data is not an environment of Python: name another one with VENV=FOLDER" in done.stderr
    assert (project.root / "data" / "mine").exists()


@pytest.mark.parametrize(
    ("version", "words"),
    [((3, 10), "is 3.10: name one"), ((3, 14), "is 3.14, for which Hydra 1.4 is awaited")],
)
def test_a_python_that_is_not_supported_is_one_line(
    project: Project, tmp_path: Path, version: tuple[int, int], words: str
) -> None:
    python = tmp_path / "bin" / "other"
    python.write_text(
        f'#!/bin/sh\nexec "{base_python()}" -c "import sys; sys.version_info = {version!r}; $2"\n'
    )
    python.chmod(0o755)
    done = project.make(".venv/.ready-run", "PYTHON=other")
    assert done.returncode == 2
    (line,) = (line for line in done.stderr.splitlines() if not line.startswith("make"))
    assert line.startswith("pareto_ltl needs Python 3.11, 3.12 or 3.13, and other " + words)
    assert "make PYTHON=python3.13" in line
    assert not (project.root / ".venv").exists()


def test_a_disk_that_is_too_small_is_named_before_anything_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    module = environment(monkeypatch)
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(module.shutil, "disk_usage", lambda _: usage(10**10, 10**10 - 10**8, 10**8))
    assert module.main([str(tmp_path / "venv"), "run"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"the packages need 0.8 GB in {tmp_path}, and 0.1 GB are free" in line
    assert list(tmp_path.iterdir()) == []


def test_progress_of_uv_and_of_pip_has_an_amount_and_the_time_that_is_left(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    module = environment(monkeypatch, "watching")
    uv, pip = module.Progress(50), module.Progress(4)
    for line in (
        "Resolved 46 packages in 2ms\n",
        "Downloading scipy (30.0MiB)\n",
        "Downloading numpy (10.0MiB)\n",
    ):
        uv.heard(line)
    uv.heard(" Downloaded scipy\n")
    assert uv.line(6.0) == "  6 s, 31 of 42 MB, about 2 s left, downloading"
    for line in (
        "Collecting numpy==2.4.6 (from -r requirements.lock (line 3))\n",
        "  Downloading numpy.whl (1 kB)\n",
    ):
        pip.heard(line)
    assert pip.line(2.0) == "  2 s, 1 of 4 packages, about 6 s left, numpy"


def test_the_demo_ends_with_two_lines_of_commands_for_its_own_result(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = environment(monkeypatch, "demo")
    monkeypatch.chdir(tmp_path)
    for name, pid in (("early", 7), ("late", 8)):
        (tmp_path / "outputs" / "phi1" / name).mkdir(parents=True)
        (tmp_path / "outputs" / "phi1" / name / "run.json").write_text(f'{{"pid": {pid}}}')
    (tmp_path / "outputs" / "phi1" / "damaged").mkdir()
    (tmp_path / "outputs" / "phi1" / "damaged" / "run.json").write_text("{")
    assert module.results_of(9) is None
    folder = module.results_of(7)
    assert folder == Path("outputs/phi1/early")
    look, on = module.next_steps(folder)
    program = look.removeprefix("look at it: ").split()[0]
    assert look.endswith("/pareto-ltl show outputs/phi1/early")
    assert (tmp_path / program).exists()  # as printed, from here
    assert "make desk" in on
    assert "install notebook" in on
    assert (ROOT / "examples" / "tour.ipynb").exists()
