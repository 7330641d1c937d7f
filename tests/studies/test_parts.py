"""Parts: worked out once, whole or not at all, and the same however the work was interrupted."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from careful_io.files import remove_dead_drafts
from pareto_ltl.settings import PlannerConfig, Settings, WindConfig
from pareto_ltl.support.errors import DataError
from pareto_ltl_apps.studies import parts
from pareto_ltl_apps.studies.parts import Part
from pareto_ltl_apps.studies.settings import EvaluationConfig
from pareto_ltl_apps.view.settings import ReportConfig
from small_study import files

ONE = EvaluationConfig(jobs=1)
CALLS: list[int] = []


def some(count: int) -> list[Part]:
    return [Part(f"square-{k}", (k,), parts.part_key(Settings(), "square", k)) for k in range(count)]


def square(context: int, k: int) -> dict[str, float]:
    CALLS.append(k)
    return {"value": context + k * k, "third": k / 3}


@pytest.fixture(autouse=True)
def _count_anew() -> None:
    CALLS.clear()


def test_results_come_in_the_order_of_the_parts(tmp_path: Path) -> None:
    done = parts.work_parts(ONE, tmp_path, square, 100, some(4))
    assert [result["value"] for result in done] == [100, 101, 104, 109]


def test_what_is_finished_is_not_done_again(tmp_path: Path) -> None:
    first = parts.work_parts(ONE, tmp_path, square, 0, some(3))
    seen: list[tuple[int, int]] = []
    again = parts.work_parts(ONE, tmp_path, square, 0, some(5), lambda *done: seen.append(done))
    assert CALLS == [0, 1, 2, 3, 4]
    assert again[:3] == first
    assert seen == [(4, 5), (5, 5)]


def test_parts_with_one_key_are_done_once(tmp_path: Path) -> None:
    part = some(1)[0]
    twin = replace(part, name="twin")
    one, two = parts.work_parts(ONE, tmp_path, square, 0, [part, twin])
    assert one == two
    assert CALLS == [0]


def test_an_interrupted_run_says_how_to_go_on_and_does_so_with_the_same_bytes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def weary(context: int, k: int) -> dict[str, float]:
        if k == 2:
            raise KeyboardInterrupt
        return square(context, k)

    with pytest.raises(KeyboardInterrupt):
        parts.work_parts(ONE, tmp_path / "a", weary, 0, some(4))
    assert f"2 of 4 parts are stored; evaluation.resume={tmp_path / 'a'}" in capsys.readouterr().err
    parts.work_parts(ONE, tmp_path / "a", square, 0, some(4))
    assert CALLS == [0, 1, 2, 3]
    parts.work_parts(ONE, tmp_path / "b", square, 0, some(4))
    assert files(tmp_path / "a" / parts.PARTS_FOLDER) == files(tmp_path / "b" / parts.PARTS_FOLDER)


def test_processes_do_what_one_process_does(tmp_path: Path) -> None:
    for jobs in (1, 2):
        parts.work_parts(EvaluationConfig(jobs=jobs), tmp_path / str(jobs), square, 3, some(5))
    assert files(tmp_path / "1" / parts.PARTS_FOLDER) == files(tmp_path / "2" / parts.PARTS_FOLDER)


@pytest.mark.parametrize(
    "damage", [b"", b'{"key": "', b"[1, 2]", b'{"key": "another", "result": {}}', b"\xff\xfe"]
)
def test_a_damaged_file_is_named_in_one_line_and_made_again(
    damage: bytes, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    expected = parts.work_parts(ONE, tmp_path, square, 0, some(3))
    hurt = tmp_path / parts.PARTS_FOLDER / some(3)[1].file
    hurt.write_bytes(damage)
    assert parts.work_parts(ONE, tmp_path, square, 0, some(3)) == expected
    assert CALLS == [0, 1, 2, 1]
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    assert str(hurt) in err
    assert "made again" in err


def test_a_holder_that_ends_while_it_is_looked_at_was_not_killed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (one,) = some(1)
    parts.work_parts(ONE, tmp_path, square, 0, [one])
    job = parts.PartJob(tmp_path / parts.PARTS_FOLDER, one)
    job.lock.write_text("a process at work", encoding="utf-8")

    def ending(lock: Path) -> bool:
        lock.unlink()  # as the holder does, between the first look and this one
        return False

    monkeypatch.setattr("pareto_ltl_apps.studies.jobs.is_held", ending)
    assert job.look().answered
    job.lock.write_text("a process that was killed", encoding="utf-8")
    monkeypatch.setattr("pareto_ltl_apps.studies.jobs.is_held", lambda _lock: False)
    assert not job.look().answered


def test_drafts_of_dead_processes_are_swept_and_those_of_the_living_left(tmp_path: Path) -> None:
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    dead, alive = tmp_path / f".{gone.pid}.x-1.json", tmp_path / f".{os.getpid()}.x-2.json"
    dead.touch()
    alive.touch()
    remove_dead_drafts(tmp_path)
    assert not dead.exists()
    assert alive.exists()


def test_results_that_cannot_be_written_are_not_half_written(tmp_path: Path) -> None:
    def broken(context: int, k: int) -> dict[str, object]:
        return {"value": object()}

    with pytest.raises(TypeError):
        parts.work_parts(ONE, tmp_path, broken, 0, some(1))
    assert files(tmp_path / parts.PARTS_FOLDER) == {}


def test_a_key_changes_with_what_matters_and_with_nothing_else(tmp_path: Path) -> None:
    plain = Settings()
    same = Settings(name="other", report=ReportConfig(dpi=90), evaluation=EvaluationConfig(jobs=7))
    same.planner.threads = 2
    assert parts.part_key(same, 1) == parts.part_key(plain, 1)
    for other in (Settings(seed=1), Settings(planner=PlannerConfig(n_max=99))):
        assert parts.part_key(other, 1) != parts.part_key(plain, 1)
    assert parts.part_key(plain, 2) != parts.part_key(plain, 1)


def test_a_key_changes_with_the_content_of_the_wind_file(tmp_path: Path) -> None:
    file = tmp_path / "wind.csv"
    keys = []
    for text in ("one", "two"):
        file.write_text(text)
        keys.append(parts.part_key(Settings(wind=WindConfig(source="csv", path=str(file)))))
    assert keys[0] != keys[1]


def test_resuming_uses_the_folder_of_the_earlier_run(tmp_path: Path) -> None:
    parts.work_parts(ONE, tmp_path / "old", square, 0, some(2))
    go_on = EvaluationConfig(jobs=1, resume=str(tmp_path / "old"))
    parts.work_parts(go_on, tmp_path / "new", square, 0, some(3))
    assert CALLS == [0, 1, 2]
    assert len(files(tmp_path / "old" / parts.PARTS_FOLDER)) == 3


def test_resuming_nothing_says_so(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"evaluation\.resume=.*no folder parts/"):
        parts.work_parts(EvaluationConfig(resume=str(tmp_path)), tmp_path / "new", square, 0, some(1))
    assert not (tmp_path / "new").exists()


def fatal(context: Path, k: int) -> dict[str, float]:
    """Kills its process while there are files that ask for it, one for each time."""
    for order in sorted(context.glob(f"kill_{k}_*"))[:1]:
        order.unlink()
        os.kill(os.getpid(), signal.SIGKILL)
    return {"value": float(k)}


def test_a_part_whose_process_is_killed_is_worked_out_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "kill_1_a").touch()
    done = parts.work_parts(EvaluationConfig(jobs=2), tmp_path, fatal, tmp_path, some(4))
    assert [result["value"] for result in done] == [0, 1, 2, 3]
    assert "were killed; continuing with the others" in capsys.readouterr().err


def test_a_part_that_is_killed_every_time_is_named_and_the_others_are_kept(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for time in "abc":
        (tmp_path / f"kill_2_{time}").touch()
    with pytest.raises(DataError, match=r"1 of 4 parts have no result: square-2 \(was given up \(killed"):
        parts.work_parts(EvaluationConfig(jobs=2), tmp_path, fatal, tmp_path, some(4))
    kept = [name for name in files(tmp_path / parts.PARTS_FOLDER) if not name.startswith(".")]  # drafts
    assert sorted(kept) == sorted(part.file for part in some(4))
    capsys.readouterr()
    parts.work_parts(EvaluationConfig(jobs=2), tmp_path, fatal, tmp_path, some(4))
    err = capsys.readouterr().err
    assert f"{some(4)[2].file} was given up" in err
    assert err.count("\n") == 1


def test_a_part_at_work_elsewhere_is_waited_for_and_taken_over(tmp_path: Path) -> None:
    """Two studies that share a folder: the second waits for the lock and finds the result."""
    (part,) = some(1)
    place = parts.parts_folder(ONE, tmp_path)
    code = (
        "import sys, time\nfrom pathlib import Path\n"
        "from pareto_ltl_apps.studies.parts import Part, PartJob\n"
        "def slow():\n    print('held', flush=True)\n    time.sleep(0.5)\n    return {'value': 7.0}\n"
        "PartJob(Path(sys.argv[1]), Part(sys.argv[2], (), sys.argv[3])).keep_result(slow)\n"
    )
    words = [sys.executable, "-c", code, str(place), part.name, part.key]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "held\n"
        assert parts.PartJob(place, part).look().status == "running"
        assert parts.work_parts(ONE, tmp_path, square, 0, [part]) == [{"value": 7.0}]
    assert CALLS == []
