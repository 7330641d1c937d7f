"""The same again, byte by byte."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from pareto_ltl.cli import hydra_app as app
from pareto_ltl.cli.rerun_command import rerun_command

SMALL = (
    "+experiment=phi1", "wind=calm", "planner.trees=2", "fidelity.refine=none",
    "deployment.runs=20", "report=none",
)  # fmt: skip


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def made(*argv: str) -> Path:
    app.run_hydra([*SMALL, *argv])
    (place,) = Path("outputs/phi1").iterdir()
    return place


def test_a_run_is_made_again_byte_by_byte_and_a_changed_plan_is_noticed(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    place = made("planner.n_max=800", "planner.threads=1")
    assert rerun_command([str(place)]) == 0
    assert "the same, byte for byte: plan.json, front.csv" in capsys.readouterr().out
    assert rerun_command([str(place), "--into", "again"]) == 0
    assert (here / "again" / "plan.json").read_bytes() == (place / "plan.json").read_bytes()
    assert rerun_command([str(place), "--into", "again"]) == 2
    assert "the folder is not empty" in capsys.readouterr().err

    plan, record = place / "plan.json", place / "run.json"
    plan.write_text(plan.read_text().replace('"dt": 1800.0', '"dt": 1800.5'))
    content = json.loads(record.read_text())
    content["packages"]["numpy"] = "1.0"
    content["inputs"] = {"gone.csv": "0" * 64}
    record.write_text(json.dumps(content))
    assert rerun_command([str(place)]) == 1
    out = capsys.readouterr().out
    assert 'plan.json differs, first in line 5 ("dt")' in out
    assert "note: numpy was 1.0, is " in out
    assert "note: gone.csv is not what the run read" in out


def test_that_there_is_no_plan_is_found_again(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    place = made("planner.n_max=20")
    assert rerun_command([str(place)]) == 0
    assert "infeasible again, for the same reason" in capsys.readouterr().out


@pytest.mark.parametrize("what", ["nothing", "status", "settings"])
def test_what_cannot_be_made_again_is_one_line(
    what: str, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    place = here / "place"
    place.mkdir()
    if what != "nothing":
        status = "failed" if what == "status" else "ok"
        (place / "run.json").write_text(
            json.dumps({"status": status, "inputs": {}, "packages": {}, "argv": []})
        )
        (place / "config_resolved.yaml").write_text("seed: many\n")
    assert rerun_command([str(place)]) == 2
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    expected = {"nothing": "is this a results directory?", "status": "ended as 'failed'", "settings": "seed"}
    assert expected[what] in err
    assert list(here.iterdir()) == [place]
