"""Nothing received acts: every command on results directories of another person.

``docs/security.md`` names a test of this or another file beside each of its claims.
"""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import socket
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

import pareto_ltl
from careful_io.fingerprints import file_hashes
from careful_io.locks import hold_lock
from careful_io.netcdf4 import refuse_other_files
from documents import ROOT
from map_files import GOAL, KML, START, WALL
from pareto_ltl.extend import Frame
from pareto_ltl.settings import Settings
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl.wind.netcdf import read_netcdf
from pareto_ltl_apps.cli.command_table import DIR, TOOL_COMMANDS
from pareto_ltl_apps.cli.commands import run_command_line
from pareto_ltl_apps.received import GRANTED, allowed_settings, granted_settings
from quick_plan import QUICK_PLAN
from received import (
    COMMANDS,
    TELEMETRY,
    contents,
    listening,
    no_connections,
    opened_paths,
    received,
    words_of,
)

SMALL = QUICK_PLAN | {"exports": {"flights": 100}}
FIX = ("--time", "2h", "--fix", "34.75,-96.48,20000")  # near the plan
SECRET = "time,lat,lon,u,v\n2018-10-09T00:00:00Z,36,-96,1,2\nhush\n"


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("sent") / "made"
    pareto_ltl.plan("phi1", "F(a & F b)", wind="calm", out=place, **SMALL)
    return place


@pytest.fixture
def log(tmp_path: Path) -> Path:
    path = tmp_path / "telemetry.csv"
    path.write_text(TELEMETRY)
    return path


@pytest.fixture
def elsewhere(tmp_path: Path) -> Path:
    """A folder that no command was given, with a file of each kind that settings can name."""
    folder = tmp_path / "elsewhere"
    (folder / "parts").mkdir(parents=True)
    for name in ("winds.csv", "map.geojson", "law.json", "mission.hoa", "front.npz", "parts/a.json"):
        (folder / name).write_text(SECRET)
    return folder


def said(capsys: pytest.CaptureFixture[str]) -> str:
    """The one line on the error stream."""
    (line,) = capsys.readouterr().err.splitlines()
    return line


def test_every_command_that_reads_a_results_directory_is_tested() -> None:
    assert {command.name for command in TOOL_COMMANDS if DIR in command.arguments} == set(COMMANDS)


# --- settings ----------------------------------------------------------------------------------


@pytest.mark.parametrize("source", ["noaa", "csv"])
@pytest.mark.parametrize("command", COMMANDS)
def test_no_command_connects_reads_or_writes_where_the_settings_of_a_result_say(
    command: str, source: str, made: Path, elsewhere: Path, log: Path, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    with listening() as server:
        place = received(
            made, tmp_path / "sent" / "place",
            evaluation__cluster=f"tcp://127.0.0.1:{server.port}", evaluation__resume=str(elsewhere),
            wind__source=source, wind__base_url=f"http://127.0.0.1:{server.port}",
            wind__path=str(elsewhere / "winds.csv") if source == "csv" else None,
            wind__forecast_error=str(elsewhere / "law.json"),
            scene__file=str(elsewhere / "map.geojson"), selection__extra_paths=str(elsewhere),
            ingest__out=str(elsewhere / "winds.csv"),
        )  # fmt: skip
        before = contents(elsewhere)
        monkeypatch.chdir(tmp_path)
        with no_connections(monkeypatch, tmp_path / "notes") as notes, opened_paths() as opened:
            code = run_command_line(words_of(command, place, log))
        assert not [path for path in opened if path.startswith(str(elsewhere))]
        assert notes.read_text() == ""
        assert server.heard == []
    assert contents(elsewhere) == before
    told = capsys.readouterr()
    assert "hush" not in told.out + told.err
    if command == "check":  # the law of the errors of its forecast would be read there
        assert code == 2
        assert "wind.forecast_error=" in told.err
        return
    if command != "rerun":
        assert code in (0, 3), told.err  # claims about edited settings fail
        return
    assert code == 2
    (line,) = told.err.splitlines()
    for word in ("evaluation.cluster=tcp:", "evaluation.resume=", "wind.base_url=http:", "scene.file="):
        assert f"{word}" in line.partition("to allow it, add")[2]
    assert sorted(path.name for path in place.parent.iterdir()) == ["place"]


ACTS = {
    "evaluation__cluster": "tcp://127.0.0.1:PORT",
    "evaluation__resume": "ELSEWHERE",
    "wind__source": "noaa",
    "wind__base_url": "http://127.0.0.1:PORT",
    "scene__file": "ELSEWHERE/map.geojson",
    "mission__automaton": "ELSEWHERE/mission.hoa",
    "wind__forecast_error": "ELSEWHERE/law.json",
    "selection__extra_paths": "ELSEWHERE",
}


@pytest.mark.parametrize("key", ACTS)
def test_rerun_refuses_a_setting_that_acts_in_one_line_with_the_word_that_allows_it(
    key: str, made: Path, elsewhere: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    value = ACTS[key].replace("ELSEWHERE", str(elsewhere)).replace("PORT", "9")
    place = received(made, tmp_path / "place", **{key: value})
    with no_connections(monkeypatch, tmp_path / "notes") as notes:
        assert run_command_line(["rerun", str(place), "--into", str(tmp_path / "again")]) == 2
    line = said(capsys)
    assert line.endswith(f"to allow it, add {key.replace('__', '.')}={value}, or another value")
    assert notes.read_text() == ""
    assert not (tmp_path / "again").exists()


def test_rerun_reads_no_zones_elsewhere(
    made: Path, elsewhere: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    zones = [str(elsewhere / "zones.txt"), str(elsewhere / "map.geojson")]
    place = received(made, tmp_path / "place", scene__zones=zones)
    with opened_paths() as opened:
        assert run_command_line(["rerun", str(place), "--into", str(tmp_path / "again")]) == 2
    assert not [path for path in opened if path.startswith(str(elsewhere))]
    word = f"'scene.zones=[{','.join(zones)}]'"
    assert said(capsys).endswith(f"to allow it, add {word}, or another value")


def test_every_setting_that_names_a_place_can_be_allowed_and_nothing_else() -> None:
    assert all(key in Settings.by_key() for key in GRANTED)
    for words in (["planner.trees=3"], ["wind.path"], ["hydra.run.dir=x"]):
        with pytest.raises(pareto_ltl.ConfigError, match="the directory has all other settings"):
            granted_settings(words)


def test_rerun_makes_a_result_again_whose_settings_the_user_sets_aside(
    made: Path, elsewhere: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    place = received(
        made, tmp_path / "place", evaluation__cluster="tcp://127.0.0.1:9", evaluation__resume=str(elsewhere)
    )
    with no_connections(monkeypatch, tmp_path / "notes") as notes:
        words = ["rerun", str(place), "evaluation.cluster=null", "evaluation.resume=null"]
        assert run_command_line(words) == 0
    assert "the same, byte for byte" in capsys.readouterr().out
    assert notes.read_text() == ""


def test_a_mirror_that_the_user_names_is_asked(
    made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with listening() as theirs, listening() as mine:
        place = received(
            made, tmp_path / "place", wind__source="noaa", wind__base_url=f"http://127.0.0.1:{theirs.port}",
            wind__retries=0, wind__cycle="2018-10-09T00:00:00Z", mission__start_time="2018-10-09T00:00:00Z",
        )  # fmt: skip
        words = ["rerun", str(place), f"wind.base_url=http://127.0.0.1:{mine.port}"]
        assert run_command_line(words) == 2
        assert mine.heard[0].startswith(b"GET /")
        assert theirs.heard == []
    assert f"127.0.0.1:{mine.port}" in said(capsys)


def test_a_cluster_that_the_user_names_is_asked_and_one_that_the_settings_name_is_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("distributed")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("pareto_ltl_apps.studies.cluster.PATIENCE", 1.0)
    study = ["compare", "scene=phi1", "mission.formula=F a", "wind=calm", "fidelity=paper", "report=none"]
    small = ["planner.trees=1", "planner.n_max=300", "evaluation.seeds=[0]", "compare.methods=[paper]"]
    assert run_command_line([*study, *small, "deployment.runs=20", "hydra.run.dir=study"]) == 0
    with listening() as theirs, listening() as mine:
        place = received(
            tmp_path / "study", tmp_path / "place", evaluation__cluster=f"tcp://127.0.0.1:{theirs.port}"
        )
        capsys.readouterr()
        assert run_command_line(["rerun", str(place)]) == 2
        assert f"evaluation.cluster=tcp://127.0.0.1:{theirs.port}" in said(capsys)
        word = f"evaluation.cluster=tcp://127.0.0.1:{mine.port}"
        assert run_command_line(["rerun", str(place), word]) == 2
        assert "no scheduler of Dask answers" in said(capsys)
        assert mine.heard
        assert theirs.heard == []


def test_a_wind_file_is_read_again_if_it_is_the_one_that_the_run_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Unchanged it is read; changed, or exchanged for a file that run.json does not list, it is not."""
    monkeypatch.chdir(tmp_path)
    rows = [f"2018-10-09T00:00:00Z,{30 + i},{-90 + j},{i},{j}" for i in range(4) for j in range(4)]
    table = Path("winds.csv")
    table.write_text("\n".join(["time,lat,lon,u,v", *rows]) + "\n")
    wind = ("wind=csv", "wind.path=winds.csv", "ingest.points=8", "hydra.run.dir=run")
    assert run_command_line(["ingest", *wind]) == 0
    shutil.copy(table, "same.csv")
    capsys.readouterr()
    assert run_command_line(["rerun", "run"]) == 0
    table.write_text(table.read_text().replace(",3,3\n", ",3,4\n"))
    with opened_paths():
        assert run_command_line(["rerun", "run"]) == 2
    line = said(capsys)
    assert "read winds.csv, which is not there or not what the run read" in line
    assert run_command_line(["rerun", "run", "wind.path=same.csv"]) == 0
    assert run_command_line(["rerun", "run", "wind.path=winds.csv"]) == 1


@pytest.mark.parametrize("key", ["scene.file", "scene.zones"])
def test_a_file_to_which_a_map_links_is_read_again_if_it_is_the_one_that_the_run_read(
    key: str, made: Path, tmp_path: Path
) -> None:
    zones, drawn = tmp_path / "zones.kml", tmp_path / "m.kml"
    zones.write_text(KML.format(WALL))
    link = "<NetworkLink><Link><href>zones.kml</href></Link></NetworkLink>"
    drawn.write_text(KML.format(START + GOAL + link))
    value = str(drawn) if key == "scene.file" else [str(drawn)]
    place = received(made, tmp_path / "place", **{key.replace(".", "__"): value})
    inputs = file_hashes([drawn, zones])
    assert allowed_settings(place, inputs, ()).scene
    with (
        opened_paths() as opened,
        pytest.raises(ConfigError, match=r"zones\.kml, to which a map links") as error,
    ):
        allowed_settings(place, {str(drawn): inputs[str(drawn)]}, ())
    assert str(zones) not in opened  # run.json does not list it
    zones.write_text(KML.format(""))
    with pytest.raises(ConfigError, match=r"zones\.kml, to which a map links"):
        allowed_settings(place, inputs, ())
    word = str(error.value).partition("add ")[2].partition(", or")[0]
    assert word.count("=") == 1
    assert allowed_settings(place, inputs, shlex.split(word)).scene


def test_a_table_goes_into_the_second_folder_and_an_earlier_run_is_not_continued(
    made: Path, elsewhere: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    place = received(made, tmp_path / "place", ingest__out=str(elsewhere / "winds.csv"))
    before = contents(elsewhere)
    assert run_command_line(["rerun", str(place)]) == 0
    assert contents(elsewhere) == before


def test_choose_runs_no_stage_that_uses_files_elsewhere(
    made: Path, elsewhere: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    stages = json.loads((made / "run.json").read_text())["stages"]
    place = received(
        made, tmp_path / "place", pipelines__stages=[*stages, "table"],
        ingest__out=str(elsewhere / "winds.csv"), wind__source="noaa",
    )  # fmt: skip
    before = contents(elsewhere)
    with no_connections(monkeypatch, tmp_path / "notes") as notes:
        assert run_command_line(["choose", str(place), "--point", "0"]) == 2
    assert "read or write files elsewhere (table)" in said(capsys)
    assert (notes.read_text(), contents(elsewhere)) == ("", before)
    assert not (tmp_path / "place_point_0").exists()


def test_a_new_plan_reads_no_law_and_no_paths_that_the_settings_of_a_result_name(
    made: Path, elsewhere: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    place = received(
        made, tmp_path / "place", wind__forecast_error=str(elsewhere / "law.json"), wind__source="csv",
        wind__path=str(elsewhere / "winds.csv"), selection__extra_paths=str(elsewhere),
        evaluation__cluster="tcp://127.0.0.1:9",
    )  # fmt: skip
    mine = tmp_path / "newer.csv"
    mine.write_text("time,lat,lon,u,v\n")
    with no_connections(monkeypatch, tmp_path / "notes"), opened_paths() as opened:
        assert run_command_line(["replan", str(place), *FIX, "--out", str(tmp_path / "rest")]) == 0
        capsys.readouterr()
        words = ["replan", str(place), "--time", "2h", "--wind", str(mine), "--out", str(tmp_path / "other")]
        assert run_command_line(words) == 2
    assert "wind.forecast_error=" in said(capsys)
    assert not [path for path in opened if path.startswith(str(elsewhere))]
    record = json.loads((tmp_path / "rest" / "run.json").read_text())
    assert set(record["inputs"]) == {str(place / "plan.json")}  # nothing is read again for its fingerprint


def test_the_processes_that_a_command_starts_connect_nowhere(
    made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The guard reaches children: one that connects is refused and noted; ``show`` as a process is not."""
    with no_connections(monkeypatch, tmp_path / "notes") as notes:
        program = "import socket; socket.create_connection(('127.0.0.1', 9))"
        done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
        assert done.returncode == 1
        assert "ConnectionRefusedError" in done.stderr or "gaierror" in done.stderr
        assert notes.read_text()
        with pytest.raises(OSError, match="allows no connection"):
            socket.create_connection(("127.0.0.1", 9))
        notes.write_text("")
        place = received(
            made, tmp_path / "place", wind__source="noaa", evaluation__cluster="tcp://127.0.0.1:9"
        )
        for words in (["show", str(place), "--print"], ["choose", str(place), "--point", "0"]):
            done = subprocess.run(
                [sys.executable, "-m", "pareto_ltl", *words], capture_output=True, text=True, check=False
            )
            assert done.returncode == 0, done.stderr
        assert notes.read_text() == ""


# --- links -------------------------------------------------------------------------------------

ENTRIES = (
    "plan.json", "metrics.json", "run.json", "config_resolved.yaml", "scene.json", "wind.nc", "trees.npz",
    "report.html", "run.log", "run.lock", "figures", "exports", "exports/plan.kml", "exports_point_0",
    "beacons", "beacons/beacons.csv", "containment", "containment/containment.json",
    "follow", "follow/follow.jsonl", "parts", "replan.json", "notes.txt",
)  # fmt: skip


def plant(place: Path, name: str, target: Path) -> None:
    """Move ``place/name`` to ``target``, or make it there, and leave a link to it."""
    link = place / name
    link.parent.mkdir(exist_ok=True)
    if link.exists():
        shutil.move(link, target)
    elif "." in name:
        target.write_text("mine")
    else:
        target.mkdir()
    link.symlink_to(target)


@pytest.mark.parametrize("name", ENTRIES)
def test_no_command_reads_or_writes_through_a_link_that_leads_out_of_a_result(
    name: str, made: Path, log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    place = shutil.copytree(made, tmp_path / "sent" / "place")
    (tmp_path / "elsewhere").mkdir()
    plant(place, name, tmp_path / "elsewhere" / Path(name).name)
    before, here = contents(tmp_path / "elsewhere"), contents(place)
    for command in COMMANDS:
        assert run_command_line(words_of(command, place, log)) == 2, command
        line = said(capsys)
        assert f"{place / name} is a link that leads out of {place}" in line
    assert contents(tmp_path / "elsewhere") == before
    assert contents(place) == here
    assert [path.name for path in place.parent.iterdir()] == ["place"]


def test_a_result_that_is_a_link_itself_and_links_inside_it_are_read(
    made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    place = shutil.copytree(made, tmp_path / "place")
    (place / "plan.json").rename(place / "first.json")
    (place / "plan.json").symlink_to("first.json")
    (tmp_path / "latest").symlink_to(place)
    assert run_command_line(["explain", str(tmp_path / "latest")]) == 0


FOLDERS_OUT = {
    "choose": "--out", "replan": "--out", "export": "--to", "beacons": "--out", "contain": "--out",
    "follow": "--out",
}  # fmt: skip


@pytest.mark.parametrize("command", FOLDERS_OUT)
def test_a_folder_of_outputs_with_planted_links_is_written_without_following_them(
    command: str, made: Path, log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    """The names are those that the command writes into an empty folder."""
    monkeypatch.chdir(tmp_path)
    words = words_of(command, made, log)
    if command == "replan":
        words = ["replan", str(made), *FIX]
    assert run_command_line([*words, FOLDERS_OUT[command], "first"]) == 0
    names = [name for name in contents(tmp_path / "first") if "/" not in name]
    assert names
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "second").mkdir()
    for name in [*names, "run.lock"]:
        (tmp_path / "elsewhere" / name).write_text("mine")
        (tmp_path / "second" / name).symlink_to(tmp_path / "elsewhere" / name)
    for lock in (True, False):
        if not lock:
            (tmp_path / "second" / "run.lock").unlink()
        code = run_command_line([*words, FOLDERS_OUT[command], "second"])
        assert code in (0, 2)
        assert set(contents(tmp_path / "elsewhere").values()) == {b"mine"}
    if command != "follow":  # whose journal is never replaced
        assert code == 0
        assert not [name for name in names if (tmp_path / "second" / name).is_symlink()]


@pytest.mark.parametrize("link", [os.symlink, os.link])
def test_locks_and_journals_are_not_opened_through_links_of_either_kind(
    link, made: Path, log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    victim = tmp_path / "victim"
    victim.write_text('{"event": "begin"}\nmine')
    link(victim, tmp_path / "lock")
    with pytest.raises(DataError, match="link"), hold_lock(tmp_path / "lock", note="written"):
        pass
    (tmp_path / "out").mkdir()
    link(victim, tmp_path / "out" / "follow.jsonl")
    words = ["follow", str(made), "--log", str(log), "--out", str(tmp_path / "out")]
    assert run_command_line(words) == 2
    assert run_command_line([*words, "--resume"]) == 2
    assert victim.read_text() == '{"event": "begin"}\nmine'


def test_sweeps_and_scores_refuse_links_too(
    made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "sweep").mkdir()
    shutil.copytree(made, tmp_path / "sweep" / "0123456789abcdef")
    (tmp_path / "victim").mkdir()
    (tmp_path / "sweep" / "figures").symlink_to(tmp_path / "victim")
    assert run_command_line(["sweep", str(tmp_path / "sweep")]) == 2
    assert "figures is a link that leads out of" in said(capsys)
    assert list((tmp_path / "victim").iterdir()) == []
    assert not (tmp_path / "sweep" / "summary.html").exists()


# --- formats that name other files ---------------------------------------------------------------


@pytest.mark.parametrize("way", ["storage", "link", "virtual"])
def test_netcdf_data_in_another_file_are_refused(way: str, made: Path, tmp_path: Path) -> None:
    secret = tmp_path / "secret"
    with h5py.File(secret, "w") as file:
        file["x"] = np.arange(4.0)
    shutil.copy(made / "wind.nc", tmp_path / "wind.nc")
    with h5py.File(tmp_path / "wind.nc", "a") as file:
        del file["u"]
        if way == "storage":
            file.create_dataset("u", (4,), "f8", external=[(str(secret), 0, 32)])
        elif way == "link":
            file["u"] = h5py.ExternalLink(str(secret), "/x")
        else:
            layout = h5py.VirtualLayout((4,), "f8")
            layout[:] = h5py.VirtualSource(str(secret), "x", (4,))
            file.create_virtual_dataset("u", layout)
    with opened_paths() as opened, pytest.raises(DataError, match="'u' lie in another file"):
        read_netcdf(tmp_path / "wind.nc")
    assert str(secret) not in opened
    refuse_other_files(made / "wind.nc")


@pytest.mark.parametrize(
    "crs",
    [
        "+proj=aeqd +lat_0=36 +lon_0=-96 +nadgrids=/tmp/secret", "+init=/tmp/secret:1 +type=crs",
        "+proj=pipeline +step +proj=vgridshift +grids=/tmp/secret", "+proj=tinshift +file=/tmp/secret",
    ],
)  # fmt: skip
def test_a_projection_that_names_a_file_is_refused(crs: str) -> None:
    with pytest.raises(DataError, match="names a file, which is not read"):
        Frame(crs).to_geographic(np.zeros((1, 2)))


def test_verify_opens_no_plan_and_no_law_that_the_run_has_not_read(
    made: Path, elsewhere: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rest, before = tmp_path / "rest", shutil.copytree(made, tmp_path / "before")
    assert run_command_line(["replan", str(before), *FIX, "--out", str(rest)]) == 0
    capsys.readouterr()
    with opened_paths() as opened:
        run_command_line(["verify", str(rest)])
    assert str(before / "plan.json") in opened
    assert "holds  replan: the rest of the old plan" in capsys.readouterr().out
    shutil.move(before, elsewhere / "before")
    document = json.loads((rest / "replan.json").read_text())
    (rest / "replan.json").write_text(json.dumps(document | {"source": str(elsewhere / "before")}))
    with opened_paths() as opened:
        run_command_line(["verify", str(rest)])
    assert not [path for path in opened if path.startswith(str(elsewhere))]
    assert "not where replan.json says, or another one: replan: the rest" in capsys.readouterr().out


def test_the_option_of_hydra_that_unpickles_a_file_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "job.pickle").write_bytes(b"cos\nsystem\n(S'touch executed'\ntR.")
    assert run_command_line(["--experimental-rerun", str(tmp_path / "job.pickle")]) == 2
    assert "runs code from a file; use pareto-ltl rerun DIR" in said(capsys)


def test_show_opens_the_page_that_it_wrote_and_none_of_another_person(
    made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    place, opened = shutil.copytree(made, tmp_path / "place"), list[str]()
    own = (place / "report.html").read_bytes()
    (place / "report.html").write_text("<script>fetch('http://127.0.0.1/')</script>")
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr("webbrowser.open", lambda address: bool(opened.append(address)) or True)
    assert run_command_line(["show", str(place)]) == 0
    assert opened == [(place / "report.html").resolve().as_uri()]
    assert (place / "report.html").read_bytes() == own
    (place / "report.html").write_text("mine")
    assert run_command_line(["show", str(place), "--as-is"]) == 0
    assert (place / "report.html").read_text() == "mine"
    (place / "report.html").unlink()
    assert run_command_line(["show", str(place), "--as-is"]) == 2


# --- the page of claims --------------------------------------------------------------------------

CLAIM = re.compile(r"<!--test:(?P<file>[\w/]+\.py)::(?P<name>\w+)-->")


def test_each_claim_of_the_security_page_names_its_tests() -> None:
    """Each item and each row of a table; a test that is renamed or removed is noticed."""
    text = (ROOT / "docs" / "security.md").read_text(encoding="utf-8")
    items = re.findall(r"^(?:- .*(?:\n {2}.*)*|\| [^-].*)$", text, re.MULTILINE)
    rows = [item for item in items if not item.startswith("| from another person")]
    assert len(rows) > 20
    for item in rows:
        assert CLAIM.search(item), item
    for found in CLAIM.finditer(text):
        source = (ROOT / "tests" / found["file"]).read_text(encoding="utf-8")
        assert re.search(rf"^def {found['name']}\(", source, re.MULTILINE), found[0]
