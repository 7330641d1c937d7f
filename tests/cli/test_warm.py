"""A warm process: results, output, signals and codes of a plain run; where it cannot answer, a plain run."""

from __future__ import annotations

import json
import os
import pty
import re
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from pareto_ltl_apps.cli import warm_client, warm_process
from pareto_ltl_apps.cli.warm_client import (
    SOCKET_NAME,
    UnsafeError,
    check_folder,
    check_peer,
    identity,
    read_message,
    send_message,
    warm_answer,
)
from quick_wind import wind_words

pytestmark = pytest.mark.skipif(not hasattr(os, "pidfd_open"), reason="a warm process needs Linux")

BYTES = (
    "plan.json",
    "plan.csv",
    "front.csv",
    "front.npz",
    "trees.npz",
    "deployments.npz",
    "wind.nc",
    "plan.kml",
)
SMALL = (
    "plan", "+experiment=hop", "selection=worth", "fidelity=paper", "planner.trees=2", "planner.n_max=2000",
    "deployment.runs=10", "report=none", *wind_words(),
)  # fmt: skip
PATIENCE = 300.0  # [s]


class Place:
    """A folder for the socket, which has a short name, and command lines that look for it there."""

    def __init__(self, folder: Path, cache: Path) -> None:
        self.folder = folder / "pareto_ltl"
        self.environment = os.environ | {"XDG_RUNTIME_DIR": str(folder), "PARETO_LTL_CACHE": str(cache)}

    def popen(self, *words: str, **options: Any) -> subprocess.Popen[str]:
        """A process of the command line."""
        defaults = {
            "stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "env": self.environment,
        }  # fmt: skip
        return subprocess.Popen([sys.executable, "-m", "pareto_ltl", *words], **defaults | options)

    def run(self, *words: str, **options: Any) -> subprocess.CompletedProcess[str]:
        """The same, after its end."""
        process = self.popen(*words, **options)
        out, err = process.communicate(timeout=PATIENCE)
        return subprocess.CompletedProcess(words, process.returncode, out, err)


@pytest.fixture(scope="module")
def short_folder() -> Iterator[Path]:
    folder = Path(tempfile.mkdtemp(prefix="w"))
    yield folder
    shutil.rmtree(folder)


@pytest.fixture(scope="module")
def warm(short_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Place]:
    """A warm process that has loaded what plans need."""
    place = Place(short_folder, tmp_path_factory.mktemp("cache"))
    started = place.run("warm", "--json")
    assert started.returncode == 0, started.stderr
    yield place
    place.run("warm", "--stop")


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder with a short name, in which this process looks for a warm one."""
    folder = Path(tempfile.mkdtemp(prefix="w"))
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(folder))
    (folder / "pareto_ltl").mkdir(mode=0o700)
    yield folder / "pareto_ltl"
    shutil.rmtree(folder)


def parent_of(process: int) -> int:
    return int(Path(f"/proc/{process}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()[1])


# --- with a real one -------------------------------------------------------------------------------


def test_a_warm_plan_has_the_bytes_of_a_plain_one(warm: Place, tmp_path: Path) -> None:
    plain = Place(tmp_path / "none", Path(warm.environment["PARETO_LTL_CACHE"]))
    results = {}
    for name, place in (("warm", warm), ("plain", plain)):
        folder = tmp_path / name
        folder.mkdir()
        done = place.run(*SMALL, "hydra.run.dir=plan", cwd=folder)
        assert (done.returncode, done.stderr) == (0, "")
        results[name] = [line for line in done.stdout.splitlines() if not re.search("a second|in all", line)]
    assert results["warm"] == results["plain"]
    for name in BYTES:
        assert (tmp_path / "warm/plan" / name).read_bytes() == (tmp_path / "plain/plan" / name).read_bytes()
    records = [json.loads((tmp_path / name / "plan/run.json").read_text()) for name in results]
    assert {key for key in records[0] if records[0][key] != records[1][key]} <= {
        "started", "finished", "seconds", "folder", "pid",
    }  # fmt: skip


def test_codes_streams_folder_and_environment_are_those_of_the_client(warm: Place, tmp_path: Path) -> None:
    wrong = warm.run("plan", "typo=1", cwd=tmp_path)
    assert (wrong.returncode, wrong.stdout, wrong.stderr.count("\n")) == (2, "", 1)
    assert list(tmp_path.iterdir()) == []
    document = warm.run("front", str(tmp_path / "nowhere"), "--json", cwd=tmp_path)
    assert document.returncode == 2
    assert "nowhere" in json.loads(document.stdout)["error"]
    umask = os.umask(0o027)
    try:
        done = warm.run("pipelines.stages=[scene]", "+experiment=phi1", "hydra.run.dir=made", cwd=tmp_path)
    finally:
        os.umask(umask)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "made").stat().st_mode & 0o777 == 0o750


def test_a_terminal_is_the_clients(warm: Place, tmp_path: Path) -> None:
    ours, theirs = pty.openpty()
    done = warm.popen("plan", "typo=1", cwd=tmp_path, stdout=theirs, stderr=theirs)
    os.close(theirs)
    assert done.wait(PATIENCE) == 2
    assert os.read(ours, 4096).startswith(b"pareto-ltl: unknown setting typo")
    os.close(ours)


@pytest.mark.parametrize(
    ("number", "code", "line"),
    [(signal.SIGINT, 130, "interrupted"), (signal.SIGTERM, 143, "stopped by SIGTERM")],
)
def test_a_signal_to_the_client_stops_the_run_which_records_it(
    number: int, code: int, line: str, warm: Place, tmp_path: Path
) -> None:
    process = begun(warm, tmp_path)
    process.send_signal(number)
    _, err = process.communicate(timeout=PATIENCE)
    assert (process.returncode, line in err) == (code, True)
    assert json.loads((tmp_path / "plan/run.json").read_text())["status"] == "stopped"


def test_a_run_ends_with_a_client_that_is_killed(warm: Place, tmp_path: Path) -> None:
    process = begun(warm, tmp_path)
    process.kill()
    process.communicate()
    latest = time.monotonic() + PATIENCE
    while time.monotonic() < latest:
        if json.loads((tmp_path / "plan/run.json").read_text())["status"] != "running":
            break
        time.sleep(0.1)
    assert json.loads((tmp_path / "plan/run.json").read_text())["status"] == "stopped"


def begun(warm: Place, folder: Path) -> subprocess.Popen[str]:
    """A run of more than ten seconds, in a child of the warm process, once it has begun."""
    words = ("+experiment=phi2", "planner.trees=40", "planner.n_max=100000", "report=none")
    process = warm.popen(*words, "hydra.run.dir=plan", cwd=folder)
    latest = time.monotonic() + PATIENCE
    while not (folder / "plan/wind.nc").exists() and time.monotonic() < latest:
        time.sleep(0.1)
    note = (warm.folder / warm_process.LOCK_NAME).read_bytes()[1:].decode()
    server = int(note.split()[1])
    children = Path(f"/proc/{server}/task/{server}/children").read_text(encoding="utf-8").split()
    assert len(children) == 1  # and none of this process
    assert parent_of(int(children[0])) == server
    return process


def test_there_is_one_and_it_says_so(warm: Place) -> None:
    again = warm.run("warm")
    assert again.returncode == 0
    assert again.stdout.startswith("there is a warm process already (process ")
    assert warm.folder.stat().st_mode & 0o777 == 0o700


@pytest.mark.parametrize("changed", ["PARETO_LTL_CACHE", "NUMBA_OPT", "LANG"])
def test_another_environment_is_not_answered(
    changed: str, warm: Place, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, value in warm.environment.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setenv(changed, "2")
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(warm.folder.parent))
    assert warm_answer(["plan", "typo=1"]) is None


# --- what is wrong with the other side -------------------------------------------------------------


def serve_once(place: Path, *replies: dict[str, Any]) -> threading.Thread:
    """A process that accepts one connection, reads a message and sends ``replies``."""
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    listener.bind(str(place))
    listener.listen(1)

    def run() -> None:
        with listener, listener.accept()[0] as client:
            _, streams = read_message(client, 3)
            for stream in streams:
                os.close(stream)
            for reply in replies:
                send_message(client, reply)

    thread = threading.Thread(target=run)
    thread.start()
    return thread


@pytest.mark.parametrize(
    "replies", [(), ({"refused": True},), ({"process": 1},), ({"process": -1},), ({"process": "1"},)]
)
def test_whatever_does_not_begin_a_run_is_a_plain_run(
    replies: tuple[dict[str, Any], ...], here: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    other = serve_once(here / SOCKET_NAME, *replies)
    assert warm_answer(["plan"]) is None
    other.join()
    assert capfd.readouterr() == ("", "")


def test_a_process_that_is_killed_with_a_run_is_one_line(
    here: Path, capfd: pytest.CaptureFixture[str], keeps_signals: None
) -> None:
    ended = subprocess.Popen([sys.executable, "-c", "pass"])
    ended.wait()
    other = serve_once(here / SOCKET_NAME, {"process": ended.pid})
    assert warm_answer(["plan"]) == 1
    other.join()
    assert capfd.readouterr().err == "pareto-ltl: the warm process was killed; run the command again\n"


@pytest.fixture
def keeps_signals() -> Iterator[None]:
    """A client changes the handlers of its signals; it ends with the run."""
    numbers = (*warm_client.FORWARDED, signal.SIGTSTP)
    before = [signal.getsignal(number) for number in numbers]
    yield
    for number, handler in zip(numbers, before, strict=True):
        signal.signal(number, handler)


def test_a_code_is_the_answer(here: Path, keeps_signals: None) -> None:
    other = serve_once(here / SOCKET_NAME, {"process": 2**22}, {"code": 137})
    assert warm_answer(["plan"]) == 137
    other.join()


def test_a_stale_socket_is_a_plain_run(here: Path, capfd: pytest.CaptureFixture[str]) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as gone:
        gone.bind(str(here / SOCKET_NAME))
    assert warm_answer(["plan"]) is None
    (here / SOCKET_NAME).unlink()
    (here / SOCKET_NAME).write_text("no socket")
    assert warm_answer(["plan"]) is None
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("mode", [0o770, 0o707, 0o755])
def test_a_folder_that_others_may_enter_is_not_used(
    mode: int, here: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (here / SOCKET_NAME).touch()
    here.chmod(mode)
    assert warm_answer(["plan"]) is None
    err = capfd.readouterr().err
    assert err.count("\n") == 1
    assert "is open to others" in err
    with pytest.raises(UnsafeError):
        check_folder(here)


def test_a_folder_of_another_user_is_not_used(
    here: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    (here / SOCKET_NAME).touch()
    monkeypatch.setattr(os, "geteuid", lambda: 12345)
    assert warm_answer(["plan"]) is None
    assert "is no folder of yours" in capfd.readouterr().err


def test_the_process_of_another_user_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    one, other = socket.socketpair(socket.AF_UNIX)
    with one, other:
        check_peer(one)
        monkeypatch.setattr(os, "geteuid", lambda: 12345)
        with pytest.raises(UnsafeError, match="another user's"):
            check_peer(one)


def test_a_link_is_no_folder(here: Path) -> None:
    (here.parent / "link").symlink_to(here)
    with pytest.raises(UnsafeError, match="no folder of yours"):
        check_folder(here.parent / "link")


@pytest.mark.parametrize(
    "content",
    [b"", b"\0\0", b"\xff\xff\xff\xff", b"\0\0\0\3[1]", b"\0\0\0\2{", b"\0\0\0\1x", b"\0\0\0\4\xff\xfe{}"],
)
def test_a_message_that_is_none_is_refused(content: bytes) -> None:
    one, other = socket.socketpair(socket.AF_UNIX)
    with one, other:
        other.sendall(content)
        other.shutdown(socket.SHUT_WR)
        with pytest.raises(ValueError, match=r"message|struct|Expecting|codec"):
            read_message(one)


@pytest.mark.parametrize(
    "changed",
    [
        {"argv": [1]},
        {"argv": None},
        {"folder": 3},
        {"environment": {"A": 1}},
        {"umask": "077"},
        {"ignored": ["x"]},
    ],
)
def test_a_request_of_other_types_is_refused(changed: dict[str, Any]) -> None:
    whole = {
        "program": "pareto-ltl", "argv": ["plan"], "folder": "/", "environment": {"A": "1"}, "umask": 63,
        "ignored": [1],
    }  # fmt: skip
    assert warm_process.Request.of(whole).argv == ["plan"]
    with pytest.raises(ValueError, match="not a request"):
        warm_process.Request.of(whole | changed)


@pytest.mark.parametrize(
    "words", ["--help", "plan -h", "--version", "warm --stop", "verify DIR", "rerun DIR", "serve"]
)
def test_commands_that_need_no_planner_or_must_not_share_one_run_here(words: str, here: Path) -> None:
    other = serve_once(here / SOCKET_NAME)
    assert warm_answer(words.split()) is None
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as asked:  # nobody has asked it yet
        asked.connect(str(here / SOCKET_NAME))
        send_message(asked, {"a": 1}, (0, 1, 2))
    other.join()


def test_the_source_of_every_package_is_looked_at() -> None:
    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text(encoding="utf-8"))
    packages = project["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]
    assert {Path(package).name for package in packages} == set(warm_client.OURS)


def test_what_is_loaded_differs_with_source_and_environment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "src/pareto_ltl").mkdir(parents=True)
    (tmp_path / "conf").mkdir()
    source, choice = tmp_path / "src/pareto_ltl/a.py", tmp_path / "conf/a.yaml"
    for file in (source, choice):
        file.write_text("a")
    monkeypatch.setattr(warm_client, "SOURCES", tmp_path / "src")
    seen = [identity()]
    assert identity() == seen[0]
    for file in (source, choice):
        file.write_text("ab")
        seen.append(identity())
    monkeypatch.setenv("OMP_NUM_THREADS", "17")
    seen.append(identity())
    assert len(set(seen)) == len(seen)


# --- the process itself ----------------------------------------------------------------------------


def test_it_ends_when_it_was_idle_and_when_its_socket_is_gone(here: Path) -> None:
    place = here / SOCKET_NAME
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as listener:
        listener.bind(str(place))
        listener.listen()
        began = time.monotonic()
        warm_process.Warm(listener, place, identity(), 0.3, lambda _: 0).serve()
        assert 0.3 <= time.monotonic() - began < 20.0
        place.unlink()
        place.touch()  # of another process
        other = warm_process.Warm(listener, place, "of another source", 1e4, lambda _: 0)
        assert not other._is_current(os.lstat(place))  # noqa: SLF001
        assert not warm_process.Warm(listener, place, identity(), 1e4, lambda _: 0)._is_current(  # noqa: SLF001
            os.lstat(here)
        )


def test_a_path_too_long_for_a_socket_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from pareto_ltl_apps.cli.commands import run_command_line

    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / ("long" * 30)))
    assert run_command_line(["warm"]) == 2
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    assert "too long for the name of a socket" in err
    assert list(tmp_path.iterdir()) == []
