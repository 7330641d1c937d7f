"""The wind at the levels of a file, as the desk shows it against height."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pareto_ltl import Settings
from pareto_ltl.extend import Frame, WindConfig
from pareto_ltl.support.errors import ConfigError
from pareto_ltl.wind.readings import Readings
from pareto_ltl_apps.desk.folder import DeskFolder
from pareto_ltl_apps.desk.wind_levels import MOST_LEVELS, wind_levels, winds_at
from pareto_ltl_apps.formats.wind_sources import levels_in_files
from wind_files import HOURS, LAT, LEVELS, LON, REGULAR, grib_message, level_file, stronger, wind_at

FRAME = Frame.at(37.0, -92.0)
CLOCK = Frame(FRAME.crs, "2018-10-09T18:00:00Z")
PLACES = np.array([[-92.0, 37.0], [-91.3, 36.4]])


def grib(place: Path) -> Path:
    raw = []
    for hour in HOURS:
        field = wind_at(*np.meshgrid(LON, LAT), hour)[::-1]
        for level in LEVELS[:2]:
            raw += [
                grib_message(
                    field[..., k] * stronger(level), (0, 2, 2 + k, 100, int(100 * level)), hour, **REGULAR
                )
                for k in range(2)
            ]
    place.write_bytes(b"".join(raw))
    return place


def config(source: str, path: Path | str | None) -> WindConfig:
    cfg = Settings.of_section("wind", {"source": source, "path": path and str(path), "level": "925hPa"})
    assert isinstance(cfg, WindConfig)
    return cfg


def shown_at(folder: Path, cfg: WindConfig, level: str = "925hPa") -> dict[str, Any]:
    shown = {"at": PLACES.tolist(), "t": (3600.0 * HOURS).tolist()}
    field: Any = SimpleNamespace(level=level)
    scene: Any = SimpleNamespace(frame=CLOCK)
    return wind_levels(DeskFolder.opened(folder), cfg, scene, field, shown)


def test_the_levels_of_netcdf_and_grib_files_are_found(tmp_path: Path) -> None:
    both = [
        levels_in_files(config("netcdf", level_file(tmp_path / "a.nc"))),
        levels_in_files(config("grib", grib(tmp_path / "a.grib2"))),
    ]
    assert [sorted(level.text for level in found) for found in both] == [
        ["1000hPa", "850hPa", "925hPa"], ["1000hPa", "925hPa"],
    ]  # fmt: skip


@pytest.mark.parametrize("kind", ["netcdf", "grib"])
def test_winds_of_each_level_are_those_of_the_file(kind: str, tmp_path: Path) -> None:
    file = level_file(tmp_path / "a.nc") if kind == "netcdf" else grib(tmp_path / "a.grib2")
    found = shown_at(tmp_path, config(kind, file.name))
    known = LEVELS if kind == "netcdf" else LEVELS[:2]
    assert [row["level"] for row in found["levels"]] == [f"{level:g}hPa" for level in known]
    assert [row["flown"] for row in found["levels"]] == [level == 925.0 for level in known]
    heights = [row["height"] for row in found["levels"]]
    assert heights == sorted(heights)
    assert 700.0 < heights[1] < 800.0  # 925 hPa in the standard atmosphere
    for row, level in zip(found["levels"], known, strict=True):
        wanted = [stronger(level) * wind_at(*PLACES.T, hour) for hour in HOURS]
        np.testing.assert_allclose(row["uv"], wanted, atol=0.03)  # linear in degrees, not in the plane


def test_between_times_and_beside_the_readings() -> None:
    nodes = np.array([[-93.0, 36.0], [-91.0, 36.0], [-91.0, 38.0], [-93.0, 38.0]])
    winds = np.array([np.full((4, 2), 2.0), np.full((4, 2), 6.0)])
    readings = Readings.of_arrays(["2018-10-09T18:00Z", "2018-10-09T22:00Z"], nodes, winds)
    far = np.array([[-92.0, 37.0], [-80.0, 37.0]])
    found = winds_at(readings, CLOCK, far, np.array([0.0, 3600.0, 9e5]))
    np.testing.assert_allclose(found[..., 0], [[2.0, 2.0], [3.0, 3.0], [6.0, 6.0]])
    line = Readings.of_arrays(["2018-10-09T18:00Z"], nodes[:2], winds[:1, :2])  # no triangle
    np.testing.assert_allclose(winds_at(line, CLOCK, far, np.zeros(1)), 2.0)


def test_one_level_is_said(tmp_path: Path) -> None:
    one = shown_at(tmp_path, config("netcdf", level_file(tmp_path / "a.nc", (925.0,)).name))
    assert (one["levels"], one["said"]) == (
        [], "The wind of this plan is known at one level, at 925 hPa: the file has no other.",
    )  # fmt: skip
    (tmp_path / "a.csv").write_text("time,lat,lon,u,v\n")
    table = shown_at(tmp_path, config("csv", "a.csv"))
    assert table["said"].endswith("a table does not state levels; GRIB and NetCDF files do.")
    assert "only that is read" in shown_at(tmp_path, config("sample", None), "10m")["said"]


def test_the_levels_nearest_to_the_flight_are_shown(tmp_path: Path) -> None:
    many = tuple(np.linspace(1000.0, 300.0, 15))
    found = shown_at(tmp_path, config("netcdf", level_file(tmp_path / "a.nc", many).name), "1000hPa")
    assert [row["level"] for row in found["levels"]] == [f"{level:g}hPa" for level in many[:MOST_LEVELS]]
    assert found["said"] == "The wind of the file, at 12 of its 15 levels, those nearest to the flight."


def test_a_file_outside_of_the_folder_is_not_read(tmp_path: Path) -> None:
    file = level_file(tmp_path / "a.nc")
    with pytest.raises(ConfigError, match="outside of the folder"):
        shown_at(tmp_path / "desk", config("netcdf", file))
