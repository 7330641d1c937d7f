"""The plan of a run, or any path of its front, exported by the pipeline, from Python and by the command."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pareto_ltl
from careful_io.files import write_json
from exported_plans import SMALL
from pareto_ltl.support.errors import ConfigError, DataError, InfeasibleError
from pareto_ltl_apps.cli.arguments import read_formats, read_metres
from pareto_ltl_apps.cli.commands import run_command_line
from pareto_ltl_apps.exports.kinds import FORMATS, ExportFormat, format_names
from pareto_ltl_apps.exports.settings import ON_REQUEST, ExportsConfig
from quick_plan import QUICK_SEARCH

DEFAULT = [name for name in FORMATS if name not in ON_REQUEST]
QUICK: dict[str, Any] = {
    "planner": {"trees": 1, "n_max": 300}, "deployment": {"runs": 5}, "wind": "calm", "report": "none",
    **QUICK_SEARCH,
}  # fmt: skip
PLANAR = {
    "bounds": [[0, 0], [1e6, 1e6]],
    "start": [1e5, 1e5],
    "regions": {"a": [[4e5, 4e5], [7e5, 4e5], [5e5, 7e5]]},
}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("made") / "run"
    sections = SMALL | {"deployment": {"runs": 40}, "report": "none", "exports": {"flights": 300}}
    pareto_ltl.plan("phi1", "F(a & F b & F c)", out=place, **sections)
    return place


def names_in(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir() if path.is_file()}


def _maker(kind: ExportFormat) -> tuple[ModuleType, str]:
    module, _, name = str(kind.maker).partition(":")
    return import_module(module), name


def test_there_is_a_maker_for_each_format() -> None:
    assert format_names() == tuple(FORMATS)
    assert all(callable(getattr(*_maker(one))) for one in FORMATS.values())


def test_a_run_writes_all_formats_that_need_no_more_settings(made: Path) -> None:
    assert {FORMATS[name].file for name in DEFAULT} <= names_in(made)
    assert FORMATS["f3548"].file not in names_in(made)


def test_the_command_and_python_write_the_bytes_of_the_run(
    made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_command_line(["export", str(made)]) == 0
    shown = capsys.readouterr().out.splitlines()
    assert shown == [str(made / "exports" / FORMATS[name].file) for name in DEFAULT]
    paths = pareto_ltl.export(made, tmp_path / "python", ["kml", "corridor"])
    assert [path.name for path in paths] == ["plan.kml", "corridor.geojson"]
    for path in (*map(Path, shown), *paths):
        assert path.read_bytes() == (made / path.name).read_bytes()


def test_any_point_of_the_front_is_exported(made: Path, tmp_path: Path) -> None:
    front = pareto_ltl.load_results(made).front
    last = len(front.paths) - 1
    words = ["export", str(made), "--point", str(last), "--formats", "geojson,qgc", "--to", str(tmp_path)]
    assert run_command_line(words) == 0
    assert names_in(tmp_path) == {"plan.geojson", "mission.plan"}
    route = json.loads((tmp_path / "plan.geojson").read_text())["features"][0]
    assert route["properties"]["length_m"] == front.paths[last].objectives.length
    told = json.loads((tmp_path / "mission.plan").read_text())["pareto_ltl"]["failure_by_heading"]
    assert told["failure"] == pareto_ltl.choose(made, point=last).plan.promise.rate.failure


def test_a_point_goes_into_a_folder_of_its_own_which_a_new_run_clears(made: Path, tmp_path: Path) -> None:
    place = tmp_path / "copy"
    shutil.copytree(made, place)
    assert run_command_line(["export", str(place), "--point", "0", "--formats", "gpx"]) == 0
    assert names_in(place / "exports_point_0") == {"plan.gpx"}
    (place / "exports_point_0" / "notes.txt").write_text("mine")
    pareto_ltl.plan(PLANAR, "F a", out=place, **QUICK)
    assert names_in(place / "exports_point_0") == {"notes.txt"}


def test_heights_and_other_settings_are_given_with_the_command(made: Path, tmp_path: Path) -> None:
    words = [
        "--formats",
        "f3548,qgc",
        "--between",
        "-20",
        "400.5",
        "--altitude",
        "120",
        "--to",
        str(tmp_path),
    ]
    assert run_command_line(["export", str(made), *words]) == 0
    volume = json.loads((tmp_path / "operational_intent.json").read_text())["volumes"][0]["volume"]
    assert (volume["altitude_lower"]["value"], volume["altitude_upper"]["value"]) == (-20.0, 400.5)
    mission = json.loads((tmp_path / "mission.plan").read_text())["mission"]
    assert {item["params"][6] for item in mission["items"] if item["command"] == 16} == {120.0}
    assert {item["frame"] for item in mission["items"] if item["command"] == 16} == {3}  # above the start


def test_a_plan_in_memory_is_exported(tmp_path: Path) -> None:
    result = pareto_ltl.plan("phi1", "F a", wind="calm", planner={"trees": 2, "n_max": 800}, **QUICK_SEARCH)
    (path,) = pareto_ltl.export(result, tmp_path, ["gpx"], point=0)
    assert "<rtept" in path.read_text()


# --- what cannot be exported ------------------------------------------------------------------


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["--point", "999"], "there is no point 999; the front has points 0 to "),
        (["--point", "-1"], "--point must be the number of a path"),
        (["--formats", "kml,shp"], "there is no format 'shp'; there are dead_reckoning, card, geojson"),
        (["--formats", ""], "--formats: there is no format ''"),
        (
            ["--formats", "f3548"],
            "f3548 needs heights above the WGS 84 ellipsoid; set exports.altitude_lower",
        ),
        (["--between", "400", "300"], "exports.altitude_lower = 400 m must be below"),
        (["--between", "400"], "--between: expected 2 arguments"),
        (["--altitude", "high"], "--altitude must be a height in metres, e.g. 120, got 'high'"),
        (["--altitude", "nan"], "exports.altitude must lie between"),
    ],
)
def test_a_wish_that_cannot_be_met_is_one_line(
    words: list[str], line: str, made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_command_line(["export", str(made), "--to", str(tmp_path / "to"), *words]) == 2
    err = capsys.readouterr().err
    assert line in err
    assert err.count("\n") == 1
    assert not (tmp_path / "to").exists()


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (shutil.rmtree, "no such folder; give a results directory"),
        (lambda place: (place / "run.json").unlink(), "there is no run.json; name a results directory"),
        (lambda place: (place / "plan.json").unlink(), "plan.json"),
        (lambda place: (place / "plan.json").write_text("{}"), "plan.json: expected schema"),
        (
            lambda place: write_json(place / "run.json", {"status": "infeasible"}),
            "there is no plan: its run found no plan",
        ),
    ],
)
def test_results_without_a_plan_are_refused(
    damage: Callable[[Path], Any],
    words: str,
    made: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    place = tmp_path / "place"
    shutil.copytree(made, place)
    damage(place)
    assert run_command_line(["export", str(place)]) == 2
    err = capsys.readouterr().err
    assert words in err
    assert err.count("\n") == 1


def test_a_run_of_the_wind_alone_has_nothing_to_export(tmp_path: Path) -> None:
    words = ["wind", "scene=phi1", "wind=calm", "report=none", f"hydra.run.dir={tmp_path}"]
    assert run_command_line(words) == 0
    with pytest.raises(DataError, match="its run made no plan"):
        pareto_ltl.export(tmp_path, tmp_path / "to")


def test_a_map_without_a_place_on_earth_says_what_is_not_written(tmp_path: Path) -> None:
    result = pareto_ltl.plan(PLANAR, "F a", out=tmp_path / "run", **QUICK)
    assert not names_in(tmp_path / "run") & {one.file for one in FORMATS.values()}
    assert (
        "not written, since the map has no place on Earth; give scene.centre"
        in (tmp_path / "run" / "run.log").read_text()
    )
    for formats in (None, ["kml", "gpx"]):
        with pytest.raises(DataError, match=r"gpx.*: not written, since the map has no place on Earth"):
            pareto_ltl.export(result, tmp_path / "to", formats)


def test_a_plan_without_times_leaves_out_what_needs_them(tmp_path: Path) -> None:
    result = pareto_ltl.plan(PLANAR | {"centre": [37.0, -92.0]}, "F a", **QUICK)
    assert result.plan.navigation.time_utc is None
    written = {path.name for path in pareto_ltl.export(result, tmp_path)}
    assert written == {FORMATS[name].file for name in DEFAULT if name != "netcdf"}
    assert json.loads((tmp_path / "mavlink_script.json").read_text())["start_utc"] is None
    with pytest.raises(DataError, match=r"netcdf: not written, since the plan has no times in UTC"):
        pareto_ltl.export(result, tmp_path, ["netcdf"])


def test_an_export_of_a_point_beyond_the_front_is_refused_in_memory(tmp_path: Path) -> None:
    result = pareto_ltl.plan(PLANAR | {"centre": [37.0, -92.0]}, "F a", **QUICK)
    with pytest.raises(InfeasibleError, match="there is no point 99"):
        pareto_ltl.export(result, tmp_path, point=99)


# --- settings ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"formats": ["f3548"]}, "f3548 needs heights"),
        ({"formats": []}, "exports.formats"),
        ({"formats": ["kml", "kml"]}, "exports.formats"),
        ({"altitude_lower": 3.0}, "give both exports.altitude_lower and exports.altitude_upper"),
        ({"altitude_lower": 3.0, "altitude_upper": 3.0}, "must be below"),
        ({"flights": 10}, "exports.flights must"),
    ],
)
def test_settings_that_do_not_fit_are_refused(settings: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        ExportsConfig(**settings)


@given(st.lists(st.sampled_from(list(FORMATS)), min_size=1))
def test_formats_are_read_in_their_order_each_once(names: list[str]) -> None:
    assert read_formats(" , ".join(names)) == list(dict.fromkeys(names))


@given(st.floats(allow_nan=False))
def test_metres_are_read(value: float) -> None:
    assert read_metres("--altitude", repr(value)) == value
    assert np.isnan(read_metres("--altitude", "nan"))
