"""One directory, one run: an earlier run is cleared away, other files stay, two at once do not mix."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import pareto_ltl
from careful_io.locks import hold_lock
from pareto_ltl.extend import Pipeline
from pareto_ltl.run.directory import BOOKKEEPING, RUN_LOCK, claimed_directory
from pareto_ltl.run.pipeline import files_of, known_stages
from pareto_ltl.run.plan_run import Run
from pareto_ltl.settings import Settings
from pareto_ltl.support.errors import ConfigError, DataError, InfeasibleError
from pareto_ltl_apps.exports.kinds import BRANCH_FILES, FORMATS
from quick_plan import QUICK_SEARCH

MAP = {
    "bounds": [[0, 0], [1e6, 1e6]],
    "start": [1e5, 1e5],
    "regions": {"a": [[4e5, 4e5], [7e5, 4e5], [5e5, 7e5]]},
}
QUICK: dict[str, Any] = {
    "planner": {"trees": 1, "n_max": 300},
    "deployment": {"runs": 5},
    "wind": "calm",
    "report": {"figures": False},
    **QUICK_SEARCH,
}


def made(place: Path, **sections: object) -> None:
    pareto_ltl.plan(MAP, "F a", out=place, **QUICK | sections)


def test_nothing_of_an_earlier_run_is_left_beside_the_answer_of_a_later_one(tmp_path: Path) -> None:
    made(tmp_path)
    (tmp_path / "notes.txt").write_text("mine")
    (tmp_path / "figures").mkdir()
    (tmp_path / "figures" / "old.png").touch()
    (tmp_path / "compare.csv").touch()
    assert pareto_ltl.load_results(tmp_path).done
    with pytest.raises(InfeasibleError):
        made(tmp_path, planner={"trees": 1, "n_max": 2}, robot={"u_max": 0.001, "dt": 100.0})
    left = {path.name for path in tmp_path.iterdir() if path.is_file()}
    assert left.isdisjoint({"plan.json", "plan.csv", "front.csv", "deployments.npz", "compare.csv", RUN_LOCK})
    assert not list((tmp_path / "figures").iterdir())
    assert "notes.txt" in left
    assert json.loads((tmp_path / "run.json").read_text())["status"] == "infeasible"
    assert pareto_ltl.load_results(tmp_path).done  # that there is no plan is an answer
    assert (tmp_path / "run.log").read_text().count("run plan, seed 0") == 1


def test_a_failed_run_leaves_no_answer_of_an_earlier_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made(tmp_path)

    def broken(run: Run, stage: object) -> None:
        raise DataError("no such wind")

    monkeypatch.setattr(Run, "_make", broken)
    with pytest.raises(DataError):
        made(tmp_path)
    assert not pareto_ltl.load_results(tmp_path).done
    assert not (tmp_path / "metrics.json").exists()
    assert not (tmp_path / "plan.json").exists()


def test_done_means_that_the_status_says_so(tmp_path: Path) -> None:
    made(tmp_path)
    results = pareto_ltl.load_results(tmp_path)
    record = json.loads((tmp_path / "run.json").read_text())
    for status in ("running", "failed", "stopped"):
        (tmp_path / "run.json").write_text(json.dumps(record | {"status": status}))
        assert not results.done
    (tmp_path / "run.json").unlink()
    assert not results.done


def test_a_second_run_into_a_directory_at_work_is_refused_and_touches_nothing(tmp_path: Path) -> None:
    made(tmp_path)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()}
    with hold_lock(tmp_path / RUN_LOCK, note="process 1 on moon"):
        with pytest.raises(ConfigError, match=r"a run is at work in .* already \(process 1 on moon\)"):
            made(tmp_path)
        command = [sys.executable, "-m", "pareto_ltl", "+experiment=phi1", f"hydra.run.dir={tmp_path}"]
        second = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path.parent, check=False)
    assert second.returncode == 2
    assert second.stderr.count("\n") == 1
    assert "a run is at work in" in second.stderr
    assert not (tmp_path / ".hydra").exists()
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()} == before


def test_a_file_in_the_place_of_a_directory_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with (
        pytest.raises(DataError, match="is a file, and results need a folder"),
        claimed_directory(tmp_path / "file", ()),
    ):
        pass


def test_files_of_every_stage_are_cleared_also_of_studies_that_do_not_run(tmp_path: Path) -> None:
    old = [tmp_path / pattern.replace("*", "old") for pattern in files_of(known_stages())]
    old += [tmp_path / "exports_point_3" / "plan.kml", tmp_path / "replan.json"]
    for path in old:
        path.parent.mkdir(exist_ok=True)
        path.touch()
    (tmp_path / "sitl.txt").touch()
    settings = Settings.of({"pipelines": "plan", "scene": MAP, "mission": {"formula": "F a"}} | QUICK)
    with Pipeline.of(settings).claimed(tmp_path):
        left = {path.name for path in tmp_path.rglob("*") if path.is_file()}
    assert left == {"sitl.txt", RUN_LOCK}
    assert len(old) > 40


def test_a_run_writes_what_its_stages_declare_and_nothing_else(tmp_path: Path) -> None:
    settings = Settings.of(
        {
            "pipelines": "plan",
            "scene": MAP | {"centre": [37.0, -92.0]},
            "mission": {"formula": "F a", "start_time": "2018-10-09T00:00:00Z"},
        }
        | QUICK
        | {"report": {"dpi": 30, "formats": ["png", "svg", "pdf"]}}
        | {"exports": {"formats": list(FORMATS), "altitude_lower": 100.0, "altitude_upper": 200.0}}
    )
    pipeline = Pipeline.of(settings)
    pipeline.run(tmp_path)
    declared = {name for stage in pipeline.stages for name in (*stage.writes, *stage.shows)}
    found = {path for pattern in (*declared, *BOOKKEEPING) for path in tmp_path.glob(pattern)}
    assert found == {path for path in tmp_path.rglob("*") if path.is_file()}
    assert all(any(tmp_path.glob(pattern)) for pattern in declared.difference(BRANCH_FILES))
