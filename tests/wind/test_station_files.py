"""Winds of weather stations: knots and directions FROM become components, reports become hours."""

from __future__ import annotations

import csv
import gzip
from collections import defaultdict

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from careful_io.times import iso, seconds
from noaa import NOAA, needs_noaa
from pareto_ltl.support.errors import DataError
from pareto_ltl.wind.area import GeoBox
from pareto_ltl_apps.formats.station_files import read_station_files

METAR = "raw_text,station_id,observation_time,latitude,longitude,wind_dir_degrees,wind_speed_kt,wind_gust_kt"
KNOT = 1852.0 / 3600.0


def report(station="KAAA", time="2022-10-22T03:00:00Z", lat=40, lon=-90, direction=270, speed=10, gust=""):
    return f"raw,{station},{time},{lat},{lon},{direction},{speed},{gust}"


def read(tmp_path, lines, header=METAR, **more):
    (tmp_path / "m.csv").write_text("\n".join([header, *lines]) + "\n")
    return read_station_files((tmp_path / "m.csv",), 75.0, **more)


@pytest.mark.parametrize(
    ("direction", "east", "north"),
    [(360, 0, -1), (90, -1, 0), (180, 0, 1), (270, 1, 0), (225, 0.5**0.5, 0.5**0.5)],
)
def test_a_wind_blows_away_from_its_direction(tmp_path, direction, east, north):
    (wind,) = read(tmp_path, [report(direction=direction)]).winds[0]
    np.testing.assert_allclose(wind, 10 * KNOT * np.array([east, north]), atol=1e-9)


@given(st.integers(0, 23), st.integers(0, 59))
def test_a_report_belongs_to_the_nearest_full_hour(tmp_path_factory, hour, minute):
    place = tmp_path_factory.mktemp("m")
    found = read(place, [report(time=f"2022-10-22T{hour:02d}:{minute:02d}:00Z")])
    told = seconds(f"2022-10-22T{hour:02d}:{minute:02d}:00Z")
    assert found.times[0] % 3600 == 0
    assert abs(found.times[0] - told) <= 1800
    assert found.leads[0] == 0.0


def test_of_each_station_and_hour_the_report_nearest_to_the_hour_counts(tmp_path):
    lines = [
        report(time="2022-10-22T02:40:00Z", speed=1),
        report(time="2022-10-22T02:53:00Z", speed=2),
        report(time="2022-10-22T03:20:00Z", speed=3),
        report("KBBB", "2022-10-22T03:10:00Z", lat=41, speed=4),
        report(time="2022-10-22T03:53:00Z", speed=5),
    ]
    found = read(tmp_path, lines)
    assert [iso(time) for time in found.times] == ["2022-10-22T03:00:00Z", "2022-10-22T04:00:00Z"]
    np.testing.assert_allclose(found.winds[0][:, 0] / KNOT, [2, 4])
    np.testing.assert_allclose(found.winds[1][:, 0] / KNOT, [5])
    assert found.notes == ("2 reports are not the nearest of their station to the hour: left out",)


def test_what_quality_control_drops_is_counted(tmp_path):
    lines = [
        report("KOK1"),
        report("KOK2", lat=41, speed=0, direction=0),
        report("KOK3", lat=42, gust=25),
        report("KVR1", direction=0, speed=3),
        report("KVR2", direction="VRB", speed=3),
        report("KNO1", direction=""),
        report("KNO2", speed="M"),
        report("KNO3", lat=""),
        report("KIM1", direction=400),
        report("KIM2", speed=-4),
        report("KIM3", lat=95),
        report("KFST", speed=300),
    ]
    found = read(tmp_path, lines)
    assert len(found.points[0]) == 3
    assert sorted(np.hypot(*found.winds[0].T) / KNOT) == pytest.approx([0, 10, 10])
    assert found.notes == (
        "of 12 reports, 3 have no direction, speed or place, 2 have a variable direction, 3 have an "
        "impossible direction, speed or place, 1 are faster than wind.max_speed: left out",
        "1 reports have gusts, which are not used: only the mean wind is",
    )


def test_all_times_that_cannot_be_read_are_named(tmp_path):
    lines = [report(time="noon"), report("KBBB", lat=41), report("KCCC", time="midnight", lat=42)]
    with pytest.raises(DataError, match=r"has 2 faults: \(1\) row 2: .*'noon'.*\(2\) row 4: .*'midnight'"):
        read(tmp_path, lines)


def test_lines_before_the_table_are_passed_over(tmp_path):
    told = "No errors\nNo warnings\n12 ms\ndata source=metars\n1 results\n" + METAR
    assert len(read(tmp_path, [report()], told).points[0]) == 1


def test_stations_outside_of_the_area_are_left_out(tmp_path):
    lines = [report(), report("KBBB", lat=60)]
    found = read(tmp_path, lines, area=GeoBox(-95.0, 35.0, 10.0, 45.0))
    assert found.points[0].tolist() == [[-90.0, 40.0]]
    with pytest.raises(
        DataError, match=r"m.csv covers latitude 40..60, longitude -90..-90; the scene needs lat"
    ):
        read(tmp_path, lines, area=GeoBox(5.0, 35.0, 10.0, 45.0))


@pytest.mark.parametrize(
    ("header", "lines", "words"),
    [
        (
            "station_id,latitude",
            [],
            "no header with observation_time, longitude, wind_dir_degrees, wind_speed_kt",
        ),
        (METAR, [], "holds no usable report; of 0 reports, none"),
        (
            METAR,
            [report(direction="")],
            "no usable report; of 1 reports, 1 have no direction, speed or place",
        ),
        (METAR, [report(time="noon")], "row 2: the time is 'noon'; expected an ISO 8601 time"),
        ("<html>", [], "is a web page, not a CSV table"),
    ],
)
def test_a_wrong_table_is_refused_in_one_line(tmp_path, header, lines, words):
    with pytest.raises(DataError, match=words) as caught:
        read(tmp_path, lines, header)
    assert "m.csv" in str(caught.value)
    assert "\n" not in str(caught.value)


@needs_noaa
def test_the_components_that_an_archive_tells_are_those_of_its_directions():
    path = NOAA / "metar" / "SFC_obs.csv.gz"
    found = read_station_files((path,), 75.0)
    with gzip.open(path, "rt") as stream:
        told = defaultdict(list)
        for row in csv.DictReader(stream):
            if row["uwind"] and row["drct"]:
                place = (float(row["lon"]), float(row["lat"]))
                told[row["valid"][:14], *place].append((float(row["uwind"]), float(row["vwind"])))
    assert len(found.times) == 11
    checked = agreed = 0
    for time, points, winds in zip(found.times, found.points, found.winds, strict=True):
        stamp = iso(time)[:14].replace("T", " ")
        for point, wind in zip(points.tolist(), winds, strict=True):
            if (stamp, *point) in told:
                checked += 1
                agreed += min(np.hypot(*(wind / KNOT - other)) for other in told[stamp, *point]) < 1e-6
    assert checked > 7000
    assert agreed > 0.99 * checked  # reports of the half hour before belong to the hour, too


@needs_noaa
def test_a_real_cache_gives_thousands_of_stations_and_says_what_it_left_out():
    found = read_station_files((NOAA / "metar" / "metars.cache.csv.gz",), 75.0)
    assert max(len(points) for points in found.points) > 2000
    assert found.notes[0].startswith("of 4911 reports, ")
    assert "have a variable direction" in found.notes[0]
