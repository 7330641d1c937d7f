"""``pareto-ltl wind-error``: the law, its figure and its refusals."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import forecast_history as history
from careful_io.fingerprints import file_fingerprint
from noaa import NOAA, needs_noaa
from pareto_ltl.support.errors import ConfigError
from pareto_ltl.wind.named_laws import read_law
from pareto_ltl_apps.cli import wind_error_command as command
from pareto_ltl_apps.cli.commands import run_command_line
from pareto_ltl_apps.formats import grib_files
from pareto_ltl_apps.wind_errors import full_winds
from wind_laws.documents import LAWS_FOLDER


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def past(here: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder whose winds are a history of known errors."""
    folder = here / "past"
    folder.mkdir()
    (folder / "made.grib2").write_bytes(b"winds")
    (folder / "notes.txt").write_text("not a wind file")
    made = grib_files.Snapshots(history.direct_history(4, cycles=20), {}, ())
    monkeypatch.setattr(full_winds, "grib_snapshots_apart", lambda *_: made)
    return folder


def test_the_command_writes_the_law_its_figure_and_a_table(
    past: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_command_line(["wind-error", "past", "--area", "all", "--out", "law.json"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    told = json.loads(Path("law.json").read_text())
    law = read_law(Path("law.json"))
    assert law.name == "past"
    assert told["files"] == {"made.grib2": file_fingerprint(past / "made.grib2")}
    assert told["analysis_error"].startswith("not estimated")
    assert {path.name for path in Path.cwd().iterdir()} == {"past", "law.json", "law.png", "law.svg"}
    for at, sd, low, high in zip(
        told["forecast"]["lead_hours"][1:],
        *(told["forecast"][name][1:] for name in ("sd", "sd_low", "sd_high")),
        strict=True,
    ):
        assert low < sd < high
        assert f"{at:g} h" in out
        assert f"{sd:.2f}  {low:.2f} to {high:.2f}" in out
    assert "taken from" not in out  # the data determine everything here


def test_the_same_seed_gives_the_same_files(past: Path) -> None:
    made = []
    for seed, out in (("1", "a.json"), ("1", "b.json"), ("2", "c.json")):
        assert run_command_line(["wind-error", "past", "--area", "all", "--seed", seed, "--out", out]) == 0
        made.append(Path(out))
    assert made[0].read_bytes() == made[1].read_bytes()
    assert made[0].with_suffix(".svg").read_bytes() == made[1].with_suffix(".svg").read_bytes()
    one, other = (json.loads(path.read_text()) for path in (made[0], made[2]))
    assert one["forecast"]["sd"] == other["forecast"]["sd"]
    assert one["forecast"]["sd_low"] != other["forecast"]["sd_low"]


BAD = {
    ("nowhere",): "nowhere: there is no such folder",
    ("empty",): "empty: the folder holds no GRIB file",
    ("past", "--area", "here"): "--area 'here': expected at least three corners",
    ("past", "--area", "1,2 3,4 5,nan"): "--area must be a list of [longitude, latitude]",
    ("past", "--out", "law.txt"): "--out law.txt: the law is written as JSON",
    ("past", "--out", "none/law.json"): "there is no folder none",
    ("past", "--out", "past/law.json"): "this is the folder that is read",
    ("past", "--stations", "none.csv"): "--stations none.csv: there is no such file",
    ("past", "--max-lag", "0"): "0 is not a number of hours above 0",
    ("past", "--max-lag", "inf"): "inf is not a number of hours above 0",
    ("past", "--block", "0"): "0 is not a number of cycles",
    ("past", "--seed", "-1"): "-1 is not a seed",
    ("past", "--name", "n" * 300): "a name has 1 to 200 characters",
    ("past", "--max-lag", "1"): "no lag up to 1 h has 5 pairs of analyses",
    ("past", "--area", "0,0 1,0 0,1"): "0 of 130 nodes",
    (): "the following arguments are required: DIR; see pareto-ltl wind-error --help",
}


@pytest.mark.parametrize("argv", BAD, ids=lambda argv: " ".join(argv)[:40])
def test_a_wrong_command_line_is_one_line_and_writes_nothing(
    argv: tuple[str, ...], past: Path, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (here / "empty").mkdir()
    assert run_command_line(["wind-error", *argv]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert BAD[argv] in err
    assert {path.name for path in here.iterdir()} == {"past", "empty"}


def test_a_file_that_is_no_grib_is_named(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (here / "past").mkdir()
    (here / "past" / "gfs.grib2").write_text("<html>not found</html>")
    assert run_command_line(["wind-error", "past"]) == 2
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    assert "gfs.grib2" in err


def test_an_area_is_read_as_it_is_typed() -> None:
    assert command.outline_of("-100,30 -90,30 -95,40") == [[-100, 30], [-90, 30], [-95, 40]]
    assert command.outline_of("all") is None
    with pytest.raises(ConfigError):
        command.outline_of("")


@needs_noaa
def test_the_shared_cycles_are_estimated_by_asymmetry_and_say_what_they_cannot_tell(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stations = [str(file) for file in sorted((NOAA / "metar").glob("*.csv.gz"))]
    assert len(stations) == 5
    command_line = ["wind-error", str(NOAA / "gfs_1p00_10m"), "--stations", *stations]
    assert run_command_line(command_line) == 0
    told = json.loads(Path("wind_error.json").read_text())
    assert told["forecast"]["lead_hours"] == [0, 3]
    assert told["forecast"]["ways"][1] == "asymmetry"
    assert len(told["files"]) == 22 + 5
    assert told["analysis_error"].startswith("the data do not suffice: station reports (1993-03-12")
    assert told["analysis_error"].endswith("have no time in common")
    assert "persistence taken from gfs" in told["origin"]
    usual = json.loads((LAWS_FOLDER / "gfs.json").read_text())
    columns = (told["change"][name] for name in ("lag_hours", "sd_low", "sd_high"))
    change = {lag: (low, high) for lag, low, high in zip(*columns, strict=True)}
    for lag, sd in zip(usual["change"]["lag_hours"], usual["change"]["sd"], strict=True):
        if lag in change and lag <= 12:  # of the same winds and others
            assert change[lag][0] < sd < change[lag][1]
    assert np.isclose(told["spread"], usual["spread"], rtol=0.05)
    assert "note: persistence" in capsys.readouterr().out
