"""Results that other people sent: links, runs that were killed, files that do not fit together."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path

import pytest

import pareto_ltl
from careful_io.locks import hold_lock
from pareto_ltl import Run
from pareto_ltl.run.directory import claimed_directory
from pareto_ltl.run.pipeline import files_of, known_stages
from pareto_ltl.support.errors import DataError
from pareto_ltl.support.run_status import RUN_LOCK, ending_text
from pareto_ltl_apps.cli.commands import run_command_line

SMALL = {"planner": {"trees": 2, "n_max": 300}, "refine": {"points": 3}, "deployment": {"runs": 50}}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("received") / "made"
    pareto_ltl.plan("phi1", "F(a & F b)", wind="calm", out=place, **SMALL)
    return place


@pytest.mark.parametrize("name", ["figures", ".hydra", "exports", "exports_point_3"])
def test_a_run_writes_nothing_through_links(name: str, tmp_path: Path) -> None:
    place, target = tmp_path / "received", tmp_path / "elsewhere"
    place.mkdir()
    target.mkdir()
    (target / "plan.png").write_bytes(b"mine")
    (place / name).symlink_to(target, target_is_directory=True)
    files = files_of(known_stages())  # also of commands after a run
    with pytest.raises(DataError, match=f"{name} is a link"), claimed_directory(place, files):
        pass
    assert [path.name for path in target.iterdir()] == ["plan.png"]
    assert not (place / RUN_LOCK).exists()


def test_the_command_line_refuses_a_link_before_anything_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    target = tmp_path / "elsewhere"
    target.mkdir()
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / ".hydra").symlink_to(target, target_is_directory=True)
    assert run_command_line(["plan", "+experiment=phi1", f"hydra.run.dir={tmp_path / 'out'}"]) == 2
    assert ".hydra is a link" in capsys.readouterr().err
    assert list(target.iterdir()) == []


@pytest.mark.parametrize("command", ["show", "export", "front", "choose", "verify", "rerun"])
def test_a_run_that_was_killed_is_called_so(
    command: str, made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    place = tmp_path / "killed"
    shutil.copytree(made, place)
    for name in ("report.html", "front.csv", "plan.json"):
        (place / name).unlink(missing_ok=True)
    record = json.loads((place / "run.json").read_text())
    (place / "run.json").write_text(json.dumps(record | {"status": "running"}))
    words = [command, str(place), *(["--point", "0"] if command == "choose" else [])]
    assert run_command_line(words) == 2
    assert "its run was killed; plan again with the same command" in capsys.readouterr().err


@pytest.mark.skipif(os.name == "nt", reason="a process does not see its own lock there")
def test_a_run_that_is_still_at_work_is_not_called_killed(tmp_path: Path) -> None:
    with hold_lock(tmp_path / RUN_LOCK):
        assert ending_text(tmp_path, "running") == "its run is still at work; wait for its end"
    assert ending_text(tmp_path, "running").startswith("its run was killed")
    assert ending_text(tmp_path, "odd") == "its run ended as 'odd'"


def test_a_map_without_a_region_of_the_mission_is_one_line(
    made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    place = tmp_path / "mixed"
    shutil.copytree(made, place)
    (place / "report.html").unlink(missing_ok=True)
    scene = json.loads((place / "scene.json").read_text())
    scene["regions"] = {"z" if name == "b" else name: part for name, part in scene["regions"].items()}
    (place / "scene.json").write_text(json.dumps(scene))
    assert run_command_line(["show", str(place), "--print"]) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert "scene.json has no region 'b', which automaton.json reads" in told
    assert not (place / "report.html").exists()


@pytest.mark.parametrize(
    ("file", "key", "value"),
    [
        ("automaton.json", "initial", 77),
        ("automaton.json", "initial", -1),
        ("scene.json", "bounds", [[0, 0], [0, 0]]),
        ("scene.json", "bounds", [[0, 0], [-1e5, 1e5]]),
        ("scene.json", "time_zero", ""),
        ("scene.json", "obstacles", [[[0, 0], [1e4, 1e4], [1e4, 0], [0, 1e4]]]),
        ("plan.json", "cov", None),
        ("plan.json", "q", None),
    ],
)
def test_numbers_that_cannot_be_are_one_line(
    file: str, key: str, value: object, made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    place = tmp_path / "odd"
    shutil.copytree(made, place)
    content = json.loads((place / file).read_text())
    if key == "q":
        value = [77] * len(content["q"])
    if key == "cov":
        value = [[[1.0, 2.0], [2.0, 1.0]]] * len(content["cov"])
    content = content | {key: value} if value is not None else {k: v for k, v in content.items() if k != key}
    (place / file).write_text(json.dumps(content))
    for command in ("explain", "export"):
        assert run_command_line([command, str(place)]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert file in line


def test_a_time_of_growth_that_is_missing_is_named_where_the_trees_are_read(
    made: Path, tmp_path: Path
) -> None:
    place = tmp_path / "odd"
    shutil.copytree(made, place)
    content = json.loads((place / "metrics.json").read_text())
    del content["growth_seconds"]
    (place / "metrics.json").write_text(json.dumps(content))
    run = Run.open(place)
    assert run.plan is not None
    with pytest.raises(DataError, match=r"metrics\.json: .*growth_seconds"):
        _ = run.forest
