"""Tables of forecasts: CSV, NetCDF and npz hold the same, and bad ones are refused in one line."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import h5netcdf
import numpy as np
import pytest

from careful_io.times import HOUR, iso
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl_apps.formats.speed_units import KNOT
from pareto_ltl_apps.wind_errors.point_forecasts import PointForecasts, verified
from pareto_ltl_apps.wind_errors.point_tables import read_point_table
from point_forecasts_made import WINDS, made_forecasts, made_law, needs_winds

TABLE = made_forecasts(made_law(), seed=1, runs=6, places=2)


def rows_of(table: PointForecasts, zone: str = "Z", unit: float = 1.0) -> list[str]:
    lines = []
    for r, run in enumerate(table.runs):
        for p in range(table.winds.shape[1]):
            for k, lead in enumerate(table.leads):
                u, v = table.winds[r, p, k] / unit
                lines.append(f"{iso(run)[:-1]}{zone},p{p},{lead / HOUR:g},{u:.6f},{v:.6f}")
    return lines


def write_csv(file: Path, header: str = "run,place,lead,u,v", **options: object) -> Path:
    file.write_text("\n".join([header, *rows_of(TABLE, **options)]) + "\n")  # type: ignore[arg-type]
    return file


def write_netcdf(file: Path, unit: str = "m s-1") -> Path:
    with h5netcdf.File(file, "w") as content:
        content.dimensions = {"run": len(TABLE.runs), "place": 2, "lead": len(TABLE.leads)}
        run = content.create_variable("run", ("run",), float, data=TABLE.runs / HOUR)
        run.attrs["units"] = "hours since 1970-01-01"
        lead = content.create_variable("lead", ("lead",), float, data=TABLE.leads / HOUR)
        lead.attrs["units"] = "hours"
        for c, name in enumerate("uv"):
            data = TABLE.winds[..., c].transpose(1, 0, 2)
            content.create_variable(name, ("place", "run", "lead"), float, data=data).attrs["units"] = unit
    return file


def write_npz(file: Path, **other: object) -> Path:
    arrays = {"init_hours_since_1970": TABLE.runs / HOUR, "lead_hours": TABLE.leads / HOUR}
    packed = np.round(TABLE.winds / 1e-3).astype(np.int32)
    arrays |= {"uv_int16": packed, "scale": np.array(1e-3), "missing": np.array(-32768)}
    np.savez(file, **{k: v for k, v in (arrays | other).items() if v is not None})  # type: ignore[arg-type]
    return file


WRITERS: dict[str, Callable[[Path], Path]] = {"w.csv": write_csv, "w.nc": write_netcdf, "w.npz": write_npz}


@pytest.mark.parametrize("name", WRITERS)
def test_every_form_of_a_table_holds_the_same_winds(name: str, tmp_path: Path) -> None:
    table = read_point_table(WRITERS[name](tmp_path / name))
    np.testing.assert_allclose(table.runs, TABLE.runs)
    np.testing.assert_allclose(table.leads, TABLE.leads)
    np.testing.assert_allclose(table.winds, TABLE.winds, atol=1e-3)
    assert table.truth == "own"
    assert table.notes == ()


def test_units_in_titles_are_converted_and_a_missing_zone_is_said_once(tmp_path: Path) -> None:
    table = read_point_table(write_csv(tmp_path / "w.csv", "run,place,lead_hours,u_kt,v [kt]", unit=KNOT))
    np.testing.assert_allclose(table.winds, TABLE.winds, atol=1e-5)
    table = read_point_table(write_csv(tmp_path / "w.csv", zone=""))
    assert table.notes == ("w.csv: the times state no zone; they are taken as UTC",)


def test_observations_are_columns_of_the_valid_time(tmp_path: Path) -> None:
    lines = ["run,place,lead,u,v,observed_u,observed_v"]
    for line in rows_of(TABLE):
        run, place, lead, *_ = line.split(",")
        hour = int(run[8:10]) * 24 + int(run[11:13]) + float(lead)
        lines.append(f"{line},{hour:g},{place[1:]}")
    (tmp_path / "w.csv").write_text("\n".join(lines))
    table = read_point_table(tmp_path / "w.csv")
    assert table.truth == "observed"
    found = verified(table)
    hour = (table.runs[2] + table.leads[4]) / HOUR + 24
    expected = table.winds[2, 1, 4] - np.array([hour, 1.0])
    np.testing.assert_allclose(found.errors[2, 1, 4], expected, atol=1e-5)


def test_gaps_are_left_out(tmp_path: Path) -> None:
    lines = ["run,place,lead,u,v", *rows_of(TABLE)]
    lines[3] = ",".join([*lines[3].split(",")[:3], "", ""])
    del lines[5]
    (tmp_path / "w.csv").write_text("\n".join(lines))
    table = read_point_table(tmp_path / "w.csv")
    assert np.isnan(table.winds).sum() == 4


CSV = "run,place,lead,u,v\n"
BAD_CSV = {
    "time,lat,lon,u,v\n2020-01-01,1,2,3,4\n": "has no leads: it holds winds by time",
    "run,lead,u,v\n2020-01-01,1,2,3\n": "lacks the columns place",
    CSV: "holds no rows",
    CSV + "yesterday,p,1,2,3\n": "line 2: run is yesterday; expected a time",
    CSV + "2020-01-01T00Z,p,1,2,x\n": "line 2: v is x; expected a number",
    CSV + "2020-01-01T00Z,p,,2,3\n": "line 2: the lead is missing",
    CSV + "2020-01-01T00Z,p,-3,2,3\n": "a lead is not from 0 to 1000 h",
    CSV + "2020-01-01T00Z,p,1,2,300\n": "a wind of 300 m/s is above",
    CSV + "2020-01-01T00Z,p,1,2,3\n2020-01-01T00Z,p,1,2,4\n": "two rows have the run, the place and the lead",
    "run,place,lead,u,v,model\n2020-01-01T00Z,p,1,2,3,gfs\n2020-01-01T06Z,p,1,2,3,icon\n": "of 2 sources",
    "run,place,lead,u_furlongs,v\n2020-01-01T00Z,p,1,2,3\n": "lacks the columns u",
}


@pytest.mark.parametrize("text", BAD_CSV, ids=lambda text: text[-40:].strip())
def test_a_bad_csv_table_is_refused_in_one_line(text: str, tmp_path: Path) -> None:
    (tmp_path / "w.csv").write_text(text)
    with pytest.raises(DataError, match=BAD_CSV[text]) as caught:
        read_point_table(tmp_path / "w.csv")
    assert "\n" not in str(caught.value)
    assert "w.csv" in str(caught.value)


BAD_NPZ = {
    "no leads": ({"lead_hours": None}, "has no leads"),
    "no runs": ({"init_hours_since_1970": None}, "has no times of runs"),
    "no winds": ({"uv_int16": None}, "has no winds"),
    "shape": ({"uv_int16": np.zeros((2, 3))}, "winds have the shape"),
    "text": ({"lead_hours": np.array(["a"])}, "expected numbers"),
    "twice": ({"init_hours_since_1970": np.zeros(6)}, "the same run occurs twice"),
    "latlon": ({"latlon": np.zeros((3, 2))}, "latlon has the shape"),
    "object": ({"uv_int16": np.array([{}, {}], object)}, "not an npz file of plain arrays"),
}


@pytest.mark.parametrize("case", BAD_NPZ)
def test_a_bad_npz_table_is_refused_in_one_line(case: str, tmp_path: Path) -> None:
    change, message = BAD_NPZ[case]
    with pytest.raises(DataError, match=message) as caught:
        read_point_table(write_npz(tmp_path / "w.npz", **change))
    assert "\n" not in str(caught.value)


def test_other_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="there is no such file"):
        read_point_table(tmp_path / "none.csv")
    (tmp_path / "w.xlsx").write_bytes(b"PK")
    with pytest.raises(ConfigError, match="expected a table"):
        read_point_table(tmp_path / "w.xlsx")
    for name in ("w.npz", "w.nc"):
        (tmp_path / name).write_bytes(b"<html>not found</html>")
        with pytest.raises(DataError, match=name):
            read_point_table(tmp_path / name)
    with pytest.raises(DataError, match="the unit furlongs"):
        read_point_table(write_netcdf(tmp_path / "w.nc", unit="furlongs"))


@needs_winds
@pytest.mark.parametrize("file", sorted(WINDS.glob("*.npz")), ids=lambda file: file.stem)
def test_every_shared_table_is_read_or_refused_in_one_line(file: Path) -> None:
    forecasts = {"icon_eu_22_points", "gefcom2012_7_sites", "openmeteo_nyc", "meps_ensemble_obs_2019-02-17"}
    if file.stem in forecasts:
        table = read_point_table(file)
        assert table.truth == ("observed" if file.stem.startswith("meps") else "own")
        assert 1.5 < table.spread < 6.0
        return
    with pytest.raises(DataError, match="has no leads"):
        read_point_table(file)
