"""What a first run shows while it compiles, and what Ctrl-C leaves of it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from rich.console import Console

import plane_kernels
import plane_logic
from pareto_ltl import kernels
from pareto_ltl.run.compile_costs import COSTS
from pareto_ltl.run.progress import ProgressBar
from pareto_ltl.settings import PRESETS
from typed_kernels import code_cache, code_files
from typed_kernels.compile_time import CompileTime, seconds_text
from typed_kernels.watching import compilation_begins, compilation_ends

FOLDERS = KERNELS, PLANE_KERNELS, _ = [
    Path(str(package.__file__)).parent for package in (kernels, plane_kernels, plane_logic)
]


class Clock:
    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


def test_every_kernel_with_a_cost_exists() -> None:
    assert set(COSTS) == set(PRESETS)
    for costs in COSTS.values():
        assert len(costs) > 10
        for kernel in costs:
            module, name = kernel.split(".")
            sources = (folder / f"{module}.py" for folder in FOLDERS)
            (source,) = (file.read_text(encoding="utf-8") for file in sources if file.is_file())
            assert f"\ndef {name}(" in source, kernel


def test_the_time_that_is_left_follows_the_speed_of_the_machine() -> None:
    clock = Clock()
    costs = {"a.one": 10.0, "b.two": 30.0, "c.there": 500.0}
    work = CompileTime(costs, lambda kernel: kernel == "c.there", clock=clock)
    assert work.total == 2
    assert work.left() == pytest.approx(40.0)
    work.begins("a.one")
    clock.now += 20.0  # half of the measured speed
    work.ends("a.one")
    assert 30.0 < work.left() < 60.0  # 30 of work, at a speed between 1/2 and 1
    work.begins("b.two")
    before = work.left()
    clock.now += 10.0
    assert work.left() < before
    assert 0.3 < work.share() < 1.0
    clock.now += 1e4
    assert work.left() > 0.0  # it is not over before it is
    work.ends("b.two")
    assert work.left() == 0.0
    assert work.share() == 1.0


def test_what_a_second_process_writes_is_no_longer_waited_for() -> None:
    clock, written = Clock(), set[str]()
    work = CompileTime({"a.one": 10.0, "b.two": 30.0}, written.__contains__, 2, clock)
    work.begins("b.two")
    one = work.left()
    written.add("a.one")
    clock.now += 2.0
    assert work.left() < one - 5.0
    assert work.done == 1


def test_a_time_is_no_more_exact_than_it_is_known() -> None:
    times = (1.0, 32.0, 58.0, 74.0, 118.0, 200.0)
    assert [seconds_text(t) for t in times] == [
        "some seconds", "about 30 s", "about 60 s", "about 70 s", "about 120 s", "about 3 min",
    ]  # fmt: skip


def test_the_bar_names_the_kernel_and_the_time_in_place_of_the_stage(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(code_cache, "has_code", lambda kernel: False)

    def shown(bar: ProgressBar) -> str:
        console = Console(width=80)
        with console.capture() as capture:
            console.print(bar._bar.get_renderable())  # type: ignore[union-attr]  # noqa: SLF001
        return " ".join(capture.get().split())

    with ProgressBar(shown=True) as bar, bar.stage("forest", "Searching for paths"):
        assert "Searching for paths" in shown(bar)
        compilation_begins("growth.grow")
        text = shown(bar)
        assert "Compiling grow" in text
        assert f"1 of {len(COSTS['full'])}, once; about" in text
        assert "left" in text
        assert "Searching" not in text
        compilation_begins("path.check_path")
        assert "Compiling check_path" in shown(bar)
        compilation_ends("path.check_path")
        assert "Searching" not in shown(bar)
        compilation_ends("growth.grow")
        assert "Searching for paths" in shown(bar)
        assert "Compiling" not in shown(bar)
    compilation_begins("path.check_path")  # nobody watches


def test_whether_there_is_code_depends_on_the_source(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(code_cache.config, "CACHE_DIR", str(tmp_path))
    assert not code_cache.has_code("growth.grow")
    (folder,) = code_cache.code_folders(KERNELS)
    folder.mkdir()
    (folder / f"growth.grow-1-0123456789.abc{code_cache.SUFFIX}").touch()  # of another source
    assert not code_cache.has_code("growth.grow")
    mark = code_cache._mark(KERNELS / "growth.py")  # noqa: SLF001
    (folder / f"growth.grow-1-{mark}.abc{code_cache.SUFFIX}").touch()
    assert code_cache.has_code("growth.grow")


def test_ctrl_c_while_it_compiles_leaves_no_process_and_no_broken_code(tmp_path: Path) -> None:
    code = tmp_path / "code"
    env = os.environ | {"NUMBA_CACHE_DIR": str(code), "PARETO_LTL_CACHE": str(tmp_path / "cache")}
    command = [sys.executable, "-m", "pareto_ltl", "+experiment=hop", f"hydra.run.dir={tmp_path / 'run'}"]
    run = subprocess.Popen(command, env=env, stderr=subprocess.PIPE, text=True, start_new_session=True)
    while not list(code.rglob(f"*{code_cache.SUFFIX}")):  # the first of many, whichever it is
        assert run.poll() is None
        time.sleep(0.1)
    time.sleep(1.0)
    os.killpg(run.pid, signal.SIGINT)
    _, said = run.communicate(timeout=300)
    assert run.returncode == 130
    assert "Traceback" not in said
    with pytest.raises(ProcessLookupError):
        os.killpg(run.pid, 0)
    files = [path for path in code.rglob("*") if path.is_file()]
    assert files
    for file in files:
        assert not file.name.startswith("."), "a draft"
        kernel = file.read_bytes()[code_files.START :].split(b"\n", 1)[0].decode()
        (folder,) = (one for one in FOLDERS if file.parent.name.startswith(f"{one.name}_"))
        source = folder / f"{file.name.partition('.')[0]}.py"
        assert code_files.read_code(file, source, kernel) is not None
