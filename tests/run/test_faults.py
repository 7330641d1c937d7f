"""Runs that are killed, that find no room, no home or another run: nothing lost, nothing half-written.

``PARETO_LTL_FAULTS`` says how often runs and sweeps are killed: 200 with ``make faults``, else two and one.
"""

from __future__ import annotations

import json
import os
import random
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import psutil
import pytest

from pareto_ltl import load_results
from pareto_ltl_apps.cli.commands import run_command_line
from patience import PATIENCE, wait_until
from unmeasured import untraced
from whole_files import check_whole

KILLS = int(os.environ.get("PARETO_LTL_FAULTS", "2"))
SWEEP_KILLS = int(os.environ.get("PARETO_LTL_FAULTS", "1"))
SMALL = (
    "+experiment=phi1", "wind=calm", "planner.trees=2", "planner.n_max=800", "fidelity=paper",
    "fidelity.refine=none", "deployment.runs=20", "report.dpi=30",
)  # fmt: skip
GRID = ("seed=range(0,4)", "hydra/launcher=joblib", "hydra.launcher.n_jobs=2", "report=none")
ANSWER = ("plan.json", "front.csv", "trees.npz", "wind.nc", "deployments.npz", "scene.json")


def started(*words: str, **options: object) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "pareto_ltl", *words]
    options = {"env": untraced()} | options
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True, **options
    )


def ended(*words: str, **options: object) -> subprocess.CompletedProcess[str]:
    with started(*words, **options) as process:
        out, err = process.communicate(timeout=PATIENCE)
    return subprocess.CompletedProcess(words, process.returncode, out, err)


def kill_after(process: subprocess.Popen[str], seconds: float) -> bool:
    """SIGKILL to the process and its children after ``seconds``, unless it ends before; True if so."""
    try:
        process.communicate(timeout=seconds)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate(timeout=PATIENCE)
        return True
    return False


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, float]:
    """A run that nothing disturbs, and how long it took when all was compiled and cached [s]."""
    place = tmp_path_factory.mktemp("undisturbed")
    for _ in range(2):
        began = time.monotonic()
        done = ended(*SMALL, f"hydra.run.dir={place}")
        assert done.returncode == 0, done.stderr
    return place, time.monotonic() - began


def check_same(place: Path, other: Path) -> None:
    for name in ANSWER:
        assert (place / name).read_bytes() == (other / name).read_bytes(), name


def test_a_run_that_was_killed_at_any_moment_is_made_by_the_same_command(
    undisturbed: tuple[Path, float], tmp_path: Path
) -> None:
    whole, seconds = undisturbed
    moments, place = random.Random(11), tmp_path / "place"
    sent = 0
    for _ in range(KILLS):
        sent += kill_after(started(*SMALL, f"hydra.run.dir={place}"), moments.uniform(0.0, 1.1 * seconds))
        check_whole(tmp_path)
        if place.is_dir() and (place / "run.json").exists() and load_results(place).done:
            check_same(place, whole)
    assert sent > 0
    done = ended(*SMALL, f"hydra.run.dir={place}")
    assert done.returncode == 0, done.stderr
    check_same(place, whole)
    files = {path.relative_to(place) for path in place.rglob("*")}
    assert files == {path.relative_to(whole) for path in whole.rglob("*")}  # no draft, no lock


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM"])
def test_a_run_that_is_stopped_leaves_no_process_and_no_figure(tmp_path: Path, name: str) -> None:
    process = started(*SMALL, "planner.n_max=1000000", f"hydra.run.dir={tmp_path / 'place'}")
    record = tmp_path / "place" / "run.json"
    log = tmp_path / "place" / "run.log"  # before, packages are imported, which a signal can make fail
    wait_until(lambda: log.exists() and "problem done" in log.read_text())
    time.sleep(1.0)
    begun = psutil.Process(process.pid).children(recursive=True)
    os.killpg(process.pid, signal.Signals[name])
    err = process.communicate(timeout=PATIENCE)[1]
    assert err.count("\n") == 1, err
    assert not any(child.is_running() for child in begun)
    assert json.loads(record.read_text())["status"] == "stopped"
    assert not (tmp_path / "place" / "figures").exists()


def test_a_reader_that_leaves_early_does_not_end_the_run(
    undisturbed: tuple[Path, float], tmp_path: Path
) -> None:
    """As ``head`` does: the summary is printed before the figures are made."""
    place = tmp_path / "place"
    process = started(*SMALL, f"hydra.run.dir={place}")
    assert process.stdout is not None
    assert process.stderr is not None
    process.stdout.close()
    assert process.stderr.read() == ""
    assert process.wait(PATIENCE) == 141
    process.stderr.close()
    assert json.loads((place / "run.json").read_text())["status"] == "ok"
    check_same(place, undisturbed[0])
    files = {path.relative_to(place) for path in place.rglob("*")}
    assert files == {path.relative_to(undisturbed[0]) for path in undisturbed[0].rglob("*")}


def test_a_sweep_that_was_killed_at_any_moment_is_finished_by_the_same_command(tmp_path: Path) -> None:
    words = ("-m", *SMALL, *GRID)
    began = time.monotonic()
    assert ended(*words, "hydra.sweep.dir=whole", cwd=tmp_path).returncode == 0
    seconds, moments = time.monotonic() - began, random.Random(12)
    for _ in range(SWEEP_KILLS):
        process = started(*words, "hydra.sweep.dir=place", cwd=tmp_path)
        kill_after(process, moments.uniform(0.0, 1.1 * seconds))
        check_whole(tmp_path / "place")
    done = ended(*words, "hydra.sweep.dir=place", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    place, whole = tmp_path / "place", tmp_path / "whole"
    assert (place / "summary.csv").read_bytes() == (whole / "summary.csv").read_bytes()
    for plan in whole.glob("*/plan.json"):
        assert (place / plan.parent.name / "plan.json").read_bytes() == plan.read_bytes()
    assert not list(place.glob("*/run.lock"))


def test_of_two_runs_into_one_directory_at_once_one_works_and_one_says_so(
    undisturbed: tuple[Path, float], tmp_path: Path
) -> None:
    processes = [started(*SMALL, f"hydra.run.dir={tmp_path / 'place'}") for _ in range(2)]
    told = [process.communicate(timeout=PATIENCE)[1] for process in processes]
    codes = [process.returncode for process in processes]
    assert sorted(codes) in ([0, 2], [0, 0])  # the second may have come when the first was done
    for code, err in zip(codes, told, strict=True):
        assert err.count("\n") == (1 if code == 2 else 0), err
        assert code == 0 or "a run is at work in" in err
    check_same(tmp_path / "place", undisturbed[0])


@contextmanager
def mounted(place: Path, *options: str) -> Iterator[Path]:
    """A file system of its own at ``place``, in memory; only root can mount one."""
    place.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", ",".join(options), "tmpfs", str(place)], check=True)
    try:
        yield place
    finally:
        subprocess.run(["umount", "--lazy", str(place)], check=True)


def can_mount() -> bool:
    if not hasattr(os, "geteuid") or os.geteuid() != 0:
        return False
    probe = "mount -t tmpfs tmpfs /mnt && umount /mnt"
    return (
        subprocess.run(["unshare", "-m", "sh", "-c", probe], capture_output=True, check=False).returncode == 0
    )


needs_mount = pytest.mark.skipif(not can_mount(), reason="a file system is mounted, which only root can")


@needs_mount
@pytest.mark.parametrize(
    ("size", "own_process"),
    [("8k", True), ("24k", False), ("48k", False), ("120k", False), ("200k", True), ("300k", False)],
)
def test_a_disk_that_fills_up_is_one_line_and_no_file_is_cut(
    tmp_path: Path, size: str, own_process: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    """In two cases in a process, whose end writes no further line; a call takes half the time."""
    with mounted(tmp_path / "disk", f"size={size}") as disk:
        words = (*SMALL, "report.formats=[png,svg]", f"hydra.run.dir={disk / 'place'}")
        if own_process:
            done = ended(*words)
            code, err = done.returncode, done.stderr
        else:
            code, err = run_command_line(words), capsys.readouterr().err
        assert code == 2, err
        lines = err.splitlines()
        assert len(lines) == 1, err
        assert re.search(rf"{disk}\S+: No space left on device", lines[0])  # the path
        assert "free some space" in lines[0]
        record = disk / "place" / "run.json"
        assert not record.exists() or json.loads(record.read_text())["status"] in ("running", "failed")
        for path in disk.rglob("*.json"):
            json.loads(path.read_text())
        assert not (disk / "place" / "metrics.json").exists()


@needs_mount
def test_a_disk_that_cannot_be_written_is_one_line(tmp_path: Path) -> None:
    with mounted(tmp_path / "disk", "ro") as disk:
        for words in ((), ("-m", "seed=0,1", f"hydra.sweep.dir={disk / 'sweep'}")):
            done = ended(*SMALL, f"hydra.run.dir={disk / 'place'}", *words)
            assert done.returncode == 2, done.stderr
            assert done.stderr.count("\n") == 1, done.stderr
            assert "Read-only file system" in done.stderr


def test_a_user_without_a_home_gets_a_plan_and_no_folder_named_tilde(
    undisturbed: tuple[Path, float], tmp_path: Path
) -> None:
    hidden = ("HOME", "PARETO_LTL_CACHE", "XDG_CACHE_HOME", "USERPROFILE", "XDG_CONFIG_HOME")
    environment = {name: value for name, value in os.environ.items() if name not in hidden}
    words = (*SMALL, "wind=sample", "wind.max_points=20", "report=none", "hydra.run.dir=place")
    nobody = "import pwd, sys\ndef unknown(*_): raise KeyError('uid')\npwd.getpwuid = unknown\n"
    main = "from pareto_ltl.__main__ import main\nmain()\n"
    command = [sys.executable, "-c", nobody + main, *words]
    done = subprocess.run(
        command,
        cwd=tmp_path,
        env=environment | {"TMPDIR": str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert {path.name for path in tmp_path.iterdir()} == {"place", f"pareto_ltl-{os.geteuid()}"}


def test_files_from_the_future_disturb_nothing(
    undisturbed: tuple[Path, float], tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    """As after the clock was set back: all that is there seems to be made tomorrow."""
    monkeypatch.chdir(tmp_path)
    place, tomorrow = tmp_path / "place", time.time() + 86_400
    run = (*SMALL, f"hydra.run.dir={place}")
    words = ("-m", *SMALL, "report=none", "seed=0", "hydra.sweep.dir=sweep")
    assert run_command_line(run) == 0
    assert run_command_line(words) == 0
    for path in tmp_path.rglob("*"):
        os.utime(path, (tomorrow, tomorrow))
    assert run_command_line(run) == 0
    check_same(place, undisturbed[0])
    capsys.readouterr()
    assert run_command_line(words) == 0
    assert "all 1 jobs of sweep have their answers" in capsys.readouterr().out
