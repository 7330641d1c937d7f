"""``pareto-ltl wind-error`` for tables of forecasts: the law, its page, and ``--check``."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from careful_io.fingerprints import file_fingerprint
from careful_io.times import HOUR
from pareto_ltl.wind.named_laws import law_of_parts_named
from pareto_ltl_apps.cli.commands import run_command_line
from pareto_ltl_apps.wind_errors.point_forecasts import PointForecasts
from point_forecasts_made import WINDS, made_forecasts, made_law, needs_winds
from wind_laws.documents import LAWS_FOLDER

FIRST_LAW = str(LAWS_FOLDER / "gfs.json")
KEYS = {"hours", "kind", "cover50", "cover90", "cover99", "cover999", "rms_z", "n"}


def write_table(file: Path, table: PointForecasts, unit: float = 1.0) -> None:
    np.savez(
        file, init_hours_since_1970=table.runs / HOUR, lead_hours=table.leads / HOUR, uv=table.winds / unit,
        obs=table.observed / unit, obs_first_hour=0.0,
    )  # fmt: skip


def hourly(table: PointForecasts) -> PointForecasts:
    """Observations at every hour, NaN between those of the table: an npz file has no times of them."""
    hours = np.arange(0.0, table.observed_times[-1] / HOUR + 1)
    seen = np.full((len(hours), *table.observed.shape[1:]), np.nan)
    seen[np.round(table.observed_times / HOUR).astype(int)] = table.observed
    return replace(table, observed_times=HOUR * hours, observed=seen)


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    write_table(Path("past.npz"), hourly(made_forecasts(made_law(0.4), seed=1, runs=60)))
    return tmp_path


def test_a_table_gives_a_law_its_figure_and_its_page(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command_line(["wind-error", "past.npz", "--out", "law.json"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    document = json.loads(Path("law.json").read_text())
    assert document["schema"] == "pareto_ltl.forecast_error/2"
    assert document["files"] == {"past.npz": file_fingerprint(here / "past.npz")}
    law = law_of_parts_named("law.json")
    assert law.truth == "observed"
    assert f"floor 1/{law.situations + 1}" in out
    assert {path.name for path in here.iterdir()} == {
        *("past.npz", "law.json", "law.png", "law.svg", "law.html")
    }
    page = Path("law.html").read_text()
    assert "Coverage of situations left out" in page
    assert f"1/{law.situations + 1}" in page
    assert "<svg" in page
    assert "http" not in page.split("</style>")[1].replace("http://www.w3.org", "").replace(
        "http://purl.org", ""
    ).replace("https://matplotlib.org", "").replace("http://creativecommons.org", "")


def test_the_same_seed_gives_the_same_law(here: Path) -> None:
    for seed, out in (("1", "a.json"), ("1", "b.json"), ("2", "c.json")):
        assert run_command_line(["wind-error", "past.npz", "--name", "x", "--seed", seed, "--out", out]) == 0
    assert Path("a.json").read_bytes() == Path("b.json").read_bytes()
    one, other = (json.loads(Path(name).read_text()) for name in ("a.json", "c.json"))
    assert one["parts"] == other["parts"]
    assert one["intervals"] != other["intervals"]


def test_a_check_answers_with_shares_of_each_lead_and_displacement(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (here / "law.json").write_text(json.dumps(made_law(0.4).document()))
    assert run_command_line(["wind-error", "--check", "past.npz", "--law", "law.json", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["truth"] == "observed"
    assert answer["floor"] == pytest.approx(1 / (answer["n"] + 1))
    assert all(row.keys() >= KEYS for row in answer["rows"])
    rows = {(row["kind"], row["hours"]): row for row in answer["rows"]}
    assert {("error", 24), ("displacement", 6), ("displacement", 48)} <= rows.keys()
    assert rows["error", 24]["cover50"] == pytest.approx(0.5, abs=0.15)
    assert rows["displacement", 24]["rms_z"] == pytest.approx(1.0, abs=0.25)
    assert run_command_line(["wind-error", "--check", "past.npz", "--law", "law.json"]) == 0
    assert "displacement 48 h" in capsys.readouterr().out


def test_winds_in_knots_are_remarked_on(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = made_forecasts(made_law(), seed=1, runs=30)
    write_table(Path("knots.npz"), hourly(table), unit=0.514)
    assert run_command_line(["wind-error", "--check", "knots.npz", "--law", "icon_eu"]) == 0
    assert "are they in knots" in capsys.readouterr().out


def test_a_law_is_scaled_to_the_height_of_a_table(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = hourly(made_forecasts(made_law(), seed=1, runs=30))
    write_table(Path("aloft.npz"), table, unit=1 / 1.5)
    answers = []
    for file, level in (("past.npz", "10m"), ("aloft.npz", "100m"), ("aloft.npz", "10m")):
        words = ["wind-error", "--check", file, "--law", "icon_eu", "--level", level, "--json"]
        assert run_command_line(words) == 0
        answers.append(json.loads(capsys.readouterr().out))
    assert any("for 100m it is scaled by" in note for note in answers[1]["notes"])
    z = [next(row["rms_z"] for row in each["rows"] if row["kind"] == "displacement") for each in answers]
    assert z[2] / z[1] == pytest.approx(1.5 * table.spread / law_of_parts_named("icon_eu").spread, rel=1e-6)


BAD = {
    ("--check", "past.npz"): "--law is missing",
    ("--law", "gfs"): "--check TABLE is missing",
    ("past.npz", "--check", "past.npz", "--law", "gfs"): "--check estimates nothing",
    ("--check", "none.npz", "--law", "gfs"): "none.npz: there is no such file",
    ("--check", "past.npz", "--law", "none"): "--law none: no packaged law of parts and no file",
    ("--check", "past.npz", "--law", FIRST_LAW): "is a law of version 1",
    ("--check", "series.npz", "--law", "gfs"): "has no leads",
    ("series.npz",): "has no leads",
    ("past.npz", "--out", "law.txt"): "the law is written as JSON",
    ("past.npz", "--area", "all"): "--area is for folders of GRIB files",
    ("past.npz", "--level", "high"): "high",
    ("--check", "past.npz", "--law", "gfs", "--level", "high"): "high",
    ("one.npz",): "holds one run only",
    ("--check", "one.npz", "--law", "gfs"): "a newer run or an observation",
}  # fmt: skip


@pytest.mark.parametrize("argv", BAD, ids=lambda argv: " ".join(argv)[:50])
def test_a_wrong_command_line_is_one_line_and_writes_nothing(
    argv: tuple[str, ...], here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    np.savez(here / "series.npz", hours_since_1970=np.arange(5.0), uv=np.zeros((5, 2)))
    np.savez(here / "one.npz", init_hours_since_1970=[0.0], lead_hours=[0.0, 6.0], uv=np.zeros((1, 1, 2, 2)))
    before = {path.name for path in here.iterdir()}
    assert run_command_line(["wind-error", *argv]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert BAD[argv] in err
    assert {path.name for path in here.iterdir()} == before


@needs_winds
@pytest.mark.parametrize("name", ["icon_eu", "ecmwf_class", "hourly_fine", "gfs"])
def test_observations_are_checked_with_the_lasting_part(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    table = WINDS / "meps_ensemble_obs_2019-02-17.npz"
    assert run_command_line(["wind-error", "--check", str(table), "--law", name, "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["truth"] == "observed"
    assert answer["n"] <= 2
    assert any("situations only" in note for note in answer["notes"])
