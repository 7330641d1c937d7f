"""Locks: one holder at a time, a note for the others, and nothing left that blocks after a kill."""

from __future__ import annotations

import errno
import fcntl
import logging
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from careful_io.locks import TakenError, hold_lock, is_held
from pareto_ltl.support.errors import DataError

HOLDER = """
import sys, time
from pathlib import Path
from careful_io.locks import hold_lock
with hold_lock(Path(sys.argv[1]), note="the first"):
    print("held", flush=True)
    time.sleep(60)
"""


def holder(path: Path) -> subprocess.Popen[str]:
    process = subprocess.Popen([sys.executable, "-c", HOLDER, str(path)], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "held\n"
    return process


def test_who_finds_a_lock_taken_reads_the_note_and_a_killed_holder_blocks_nobody(tmp_path: Path) -> None:
    path = tmp_path / "lock"
    with holder(path) as other:
        assert is_held(path)
        with pytest.raises(TakenError, match="the first"), hold_lock(path, wait=False):
            pass
        other.kill()
        other.wait()
    assert not is_held(path)
    with hold_lock(path, wait=False, note="the second") as left:
        assert left == "the first"  # it was killed: its note is still there
        assert path.read_text().strip() == "the second"
    assert not path.exists()
    with hold_lock(path) as left:
        assert left == ""


def test_the_file_of_a_lock_goes_also_after_an_error(tmp_path: Path) -> None:
    with hold_lock(tmp_path / "lock"):
        assert is_held(tmp_path / "lock")
    assert not (tmp_path / "lock").exists()
    with pytest.raises(ZeroDivisionError), hold_lock(tmp_path / "lock"):
        raise ZeroDivisionError
    assert not (tmp_path / "lock").exists()


def test_a_lock_that_was_removed_while_others_waited_for_it_still_has_one_holder(tmp_path: Path) -> None:
    """Many threads, each with a handle of its own, pass a lock whose file is removed at every turn."""
    path, inside, most = tmp_path / "lock", [0], [0]
    counted = threading.Lock()

    def enter_often() -> None:
        for _ in range(50):
            with hold_lock(path):
                with counted:
                    inside[0] += 1
                    most[0] = max(most[0], inside[0])
                with counted:
                    inside[0] -= 1

    threads = [threading.Thread(target=enter_often) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert most == [1]
    assert not path.exists()


def test_where_a_file_system_has_no_locks_the_work_is_done_and_the_log_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def refuse(handle: int, kind: int) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(fcntl, "flock", refuse)
    with caplog.at_level(logging.WARNING), hold_lock(tmp_path / "lock"):
        pass
    assert "no locks on this file system" in caplog.text
    assert not is_held(tmp_path / "lock")


def test_a_link_at_the_place_of_a_lock_is_refused_and_what_it_names_is_kept(tmp_path: Path) -> None:
    (tmp_path / "precious").write_text("kept")
    (tmp_path / "lock").symlink_to(tmp_path / "precious")
    with pytest.raises(DataError, match="is a symbolic link"), hold_lock(tmp_path / "lock", note="written"):
        pass
    assert not is_held(tmp_path / "lock")
    assert (tmp_path / "precious").read_text() == "kept"


def test_whoever_asks_whether_a_lock_is_held_keeps_nobody_from_taking_it(tmp_path: Path) -> None:
    path = tmp_path / "lock"
    path.touch()
    stop = threading.Event()

    def ask_often() -> None:
        while not stop.is_set():
            is_held(path)

    asking = threading.Thread(target=ask_often)
    asking.start()
    try:
        for _ in range(200):
            with hold_lock(path, wait=False):
                pass
    finally:
        stop.set()
        asking.join()
