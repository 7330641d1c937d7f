"""Files appear whole or not at all; fingerprints change with what they stand for, and with nothing else."""

from __future__ import annotations

import errno
import hashlib
import os
from pathlib import Path

import pytest

from careful_io import fingerprints
from careful_io.files import remove_dead_drafts, whole_file, write_text
from careful_io.fingerprints import code_fingerprint, data_fingerprint, file_fingerprint
from pareto_ltl.support.errors import DataError


def test_the_place_of_a_file_is_empty_or_old_until_the_new_one_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    with whole_file(path) as draft:
        draft.write_text("new")
        assert not path.exists()
    assert path.read_text() == "new"
    write_text(path, "newer\r\n")
    assert path.read_bytes() == b"newer\r\n"
    assert list(tmp_path.iterdir()) == [path]


def test_an_error_names_the_file_and_not_its_draft(tmp_path: Path) -> None:
    path = tmp_path / "missing" / "a.txt"
    with pytest.raises(OSError, match="No such file or directory") as failed:
        write_text(path, "new")
    assert str(failed.value).endswith(f"'{path}'")


def test_an_error_of_a_full_disk_names_file_need_and_free_space(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(draft: Path, data: bytes) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(OSError, match=r"it needs 3 MB, .* MB are free") as failed:
        write_text(tmp_path / "wind.nc", "x" * 3_000_000)
    assert failed.value.filename == str(tmp_path / "wind.nc")
    assert not list(tmp_path.iterdir())


def test_a_link_at_the_place_of_a_draft_is_not_written_through(tmp_path: Path) -> None:
    precious = tmp_path / "precious"
    precious.write_text("kept")
    (tmp_path / f".{os.getpid()}.a.txt").symlink_to(precious)
    write_text(tmp_path / "a.txt", "new")
    assert precious.read_text() == "kept"
    assert not (tmp_path / "a.txt").is_symlink()


def test_only_drafts_of_ended_processes_are_removed(tmp_path: Path) -> None:
    kept = [
        tmp_path / name for name in (f".{os.getpid()}.a.json", ".hidden.json", "2.json", ".x-1.json.lock")
    ]
    dead = tmp_path / ".999999999.a.json"
    for path in (*kept, dead):
        path.touch()
    remove_dead_drafts(tmp_path)
    assert sorted(tmp_path.iterdir()) == sorted(kept)


def test_a_file_is_read_again_when_it_has_changed_however_soon(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "wind.csv"
    for text in ("one", "two"):  # as long as each other
        path.write_text(text)
        os.utime(path, ns=(0, path.stat().st_mtime_ns // 10**10 * 10**10))  # a file system with coarse dates
        monkeypatch.setattr(fingerprints.time, "time", lambda: path.stat().st_mtime)
        assert file_fingerprint(path) == hashlib.sha256(text.encode()).hexdigest()
    monkeypatch.setattr(fingerprints.time, "time", lambda: path.stat().st_mtime + 10)
    assert file_fingerprint(path) == hashlib.sha256(b"two").hexdigest()
    path.write_text("three")
    assert file_fingerprint(path) == hashlib.sha256(b"three").hexdigest()


def test_the_order_of_keys_is_no_part_of_a_fingerprint() -> None:
    assert data_fingerprint({"a": 1, "b": [2.5]}) == data_fingerprint({"b": [2.5], "a": 1})
    assert data_fingerprint({"a": 1}) != data_fingerprint({"a": 2})


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package of three modules in place of this one."""
    package = tmp_path / "pareto_ltl"
    for name in ("wind/gp.py", "wind/field.py", "cli/main.py", "__init__.py"):
        (package / name).parent.mkdir(parents=True, exist_ok=True)
        (package / name).write_text(name)
    monkeypatch.setattr(fingerprints, "SOURCES", tmp_path)
    code_fingerprint.cache_clear()
    return package


def prints() -> dict[str, str]:
    code_fingerprint.cache_clear()
    return {
        "all": code_fingerprint(),
        "wind": code_fingerprint("pareto_ltl.wind"),
        "wind.gp": code_fingerprint("pareto_ltl.wind.gp"),
        "without cli": code_fingerprint(without=("pareto_ltl.cli",)),
    }


@pytest.mark.parametrize(
    ("edited", "changed"),
    [
        ("wind/gp.py", {"all", "wind", "wind.gp", "without cli"}),
        ("wind/field.py", {"all", "wind", "without cli"}),
        ("cli/main.py", {"all"}),
        ("wind/new.py", {"all", "wind", "without cli"}),
    ],
)
def test_a_code_fingerprint_changes_with_the_modules_it_names(
    package: Path, edited: str, changed: set[str]
) -> None:
    before = prints()
    (package / edited).write_text("edited")
    after = prints()
    code_fingerprint.cache_clear()
    assert {name for name in before if before[name] != after[name]} == changed


def test_a_module_that_does_not_exist_is_refused() -> None:
    with pytest.raises(ValueError, match=r"no module or package 'pareto_ltl\.wind\.elsewhere'"):
        code_fingerprint("pareto_ltl.wind.elsewhere")
    assert code_fingerprint("careful_io", "wind_laws.gp") != code_fingerprint("careful_io")
    assert (fingerprints.SOURCES / "careful_io" / "fingerprints.py").is_file()


def test_a_device_or_a_folder_is_never_replaced(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    (tmp_path / "link").symlink_to(pipe)
    for place in (pipe, tmp_path / "link", tmp_path):
        with pytest.raises(DataError, match="is a folder or a device"):
            write_text(place, "x")
    assert pipe.is_fifo()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["link", "pipe"]
