"""The same again, byte by byte."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from pareto_ltl_apps.cli import hydra_app as app
from pareto_ltl_apps.cli.commands import run_command_line
from pareto_ltl_apps.cli.rerun_command import _file_difference

SMALL = (
    "+experiment=phi1", "wind=calm", "planner.trees=2", "fidelity=paper", "fidelity.refine=none",
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
    assert run_command_line(["rerun", str(place)]) == 0
    told = capsys.readouterr().out.splitlines()[-1]
    assert told.startswith("the same, byte for byte: scene.json, ")
    assert "wind.nc, trees.npz, front.csv, front.npz, plan.json, plan.csv, deployments.npz" in told
    assert told.endswith("plan.kml, plan.gpx, mission.plan, mavlink_script.json, corridor.geojson")
    assert run_command_line(["rerun", str(place), "--into", "again"]) == 0
    assert (here / "again" / "plan.json").read_bytes() == (place / "plan.json").read_bytes()
    assert run_command_line(["rerun", str(place), "--into", "again"]) == 2
    assert "it exists and is not empty" in capsys.readouterr().err

    plan, record = place / "plan.json", place / "run.json"
    plan.write_text(plan.read_text().replace('"dt": 1800.0', '"dt": 1800.5'))
    content = json.loads(record.read_text())
    content["packages"]["numpy"] = "1.0"
    content["inputs"] = {"gone.csv": "0" * 64}
    record.write_text(json.dumps(content))
    assert run_command_line(["rerun", str(place)]) == 1
    out = capsys.readouterr().out
    assert "plan.json differs, first in line 5 (dt)" in out
    assert "note: numpy was 1.0, is " in out
    assert "note: gone.csv is not what the run read" in out


def test_that_there_is_no_plan_is_found_again(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    place = made("planner.n_max=20")
    assert run_command_line(["rerun", str(place)]) == 0
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
    assert run_command_line(["rerun", str(place)]) == 2
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    expected = {
        "nothing": "is this a results directory?",
        "status": "its run failed",
        "settings": "seed",
    }
    assert expected[what] in err
    assert list(here.iterdir()) == [place]


def test_a_result_of_which_nothing_is_left_is_not_called_the_same(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    place = made("planner.n_max=800")
    (place / "plan.json").unlink()
    assert run_command_line(["rerun", str(place)]) == 1
    assert f"{place / 'plan.json'} missing" in capsys.readouterr().out

    settings = (place / "config_resolved.yaml").read_text()
    stages = settings.index("stages: [")
    (place / "config_resolved.yaml").write_text(
        settings[:stages] + "stages: [readings]" + settings[settings.index("]", stages) + 1 :]
    )
    assert run_command_line(["rerun", str(place)]) == 2
    assert "holds none of the files that its pipeline writes" in capsys.readouterr().err


def test_the_tables_of_a_study_are_compared_but_for_seconds(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    quick = ("evaluation.seeds=[0]", "compare.methods=[paper]", "hydra.run.dir=study", "planner.n_max=800")
    assert app.run_hydra([*SMALL, *quick, "pipelines=compare"]) == 0
    assert run_command_line(["rerun", "study"]) == 0
    told = capsys.readouterr().out.splitlines()[-1]
    assert "compare.csv, compare_seeds.csv" in told
    table = Path("study/compare_seeds.csv")
    table.write_text(table.read_text().replace("paper", "forged"))
    assert run_command_line(["rerun", "study"]) == 1
    assert "compare_seeds.csv differs, first in line" in capsys.readouterr().out


def ingested(folder: Path) -> Path:
    """A run of ``pipelines=ingest``, which wrote ``table.csv`` outside of its directory."""
    rows = [f"2018-10-09T00:00:00Z,{30 + i},{-90 + j},{i},{j}" for i in range(4) for j in range(4)]
    (folder / "winds.csv").write_text("\n".join(["time,lat,lon,u,v", *rows]) + "\n")
    words = (
        "wind=csv",
        "wind.path=winds.csv",
        "ingest.out=table.csv",
        "ingest.points=8",
        "hydra.run.dir=run",
    )
    assert app.run_hydra(["pipelines=ingest", *words]) == 0
    return folder / "run"


def test_the_second_result_stays_in_its_own_folder(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    place, table = ingested(here), here / "table.csv"
    assert run_command_line(["rerun", str(place)]) == 0
    assert "the same, byte for byte: table.csv" in capsys.readouterr().out

    victim = here / "victim.csv"
    victim.write_text("precious")
    settings = place / "config_resolved.yaml"
    settings.write_text(settings.read_text().replace("out: table.csv", f"out: {victim}"))
    before = {path: path.read_bytes() for path in here.rglob("*") if path.is_file()}
    assert run_command_line(["rerun", str(place)]) == 1  # the table that the run wrote is not made again
    assert {path: path.read_bytes() for path in here.rglob("*") if path.is_file()} == before
    assert victim.read_text() == "precious"
    assert table.is_file()


def test_an_edited_digest_of_a_table_elsewhere_is_noticed(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    place = ingested(here)
    record = json.loads((place / "run.json").read_text())
    (place / "run.json").write_text(json.dumps(record | {"outputs": {"table.csv": "0" * 64}}))
    assert run_command_line(["rerun", str(place)]) == 1
    assert "table.csv has other bytes" in capsys.readouterr().out


def test_settings_of_a_directory_do_not_read_the_environment(
    here: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("SECRET", "hush")
    place = made("planner.n_max=20")
    settings = place / "config_resolved.yaml"
    settings.write_text(settings.read_text().replace("name: phi1", "name: ${oc.env:SECRET}", 1))
    run_command_line(["rerun", str(place), "--into", "second"])
    text = "".join(path.read_text(errors="replace") for path in Path("second").rglob("*") if path.is_file())
    assert "hush" not in text + "".join(capsys.readouterr())


def test_of_a_file_that_is_no_table_nothing_is_quoted(tmp_path: Path) -> None:
    for name, quoted in (("front.csv", ""), ("run.log", ""), ("plan.json", " (dt)")):
        (tmp_path / name).write_text('"dt": secret\n')
        (tmp_path / "again").mkdir(exist_ok=True)
        (tmp_path / "again" / name).write_text('"dt": 2\n')
        found = _file_difference(tmp_path / name, tmp_path / "again" / name)
        assert found == f"{name} differs, first in line 1{quoted}"
    (tmp_path / "again" / "run.log").write_text('"dt": secret\nmore\n')
    assert "line 2, where one of both ends" in str(
        _file_difference(tmp_path / "run.log", tmp_path / "again" / "run.log")
    )
