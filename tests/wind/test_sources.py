"""Reading wind: frames, clocks, thinning, and every way in which a file can be wrong."""

from __future__ import annotations

import gzip
import json
import re
import sys
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest
import yaml

from flight_quantities import frames
from noaa import NOAA, ROOT, needs_noaa
from pareto_ltl import Readings
from pareto_ltl.extend import Frame
from pareto_ltl.settings import WindConfig
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl.support.resources import SAMPLE_WINDS
from pareto_ltl.wind import sources
from pareto_ltl.wind.area import GeoBox
from pareto_ltl.wind.observations import place_readings
from pareto_ltl.world.scene import Scene
from pareto_ltl_apps.formats import tables
from pareto_ltl_apps.formats.grib_files import grib_snapshots, grib_snapshots_apart
from pareto_ltl_apps.formats.settings import IngestConfig
from pareto_ltl_apps.formats.snapshots import latest_readings
from pareto_ltl_apps.formats.wind_table import write_wind_table

HOURS = ("2018-10-09T00:00:00Z", "2018-10-09T03:00:00Z", "2018-10-09T06:00:00Z")


def scene(lat=37.0, lon=-92.0, side=1e6, time_zero=None):
    half = side / 2
    bounds = np.array([[-half, -half], [half, half]])
    return Scene(bounds, np.zeros(2), {}, (), frames.local_plane(lat, lon), time_zero)


def lab(side=100.0, time_zero=None):
    return Scene(np.array([[0.0, 0.0], [side, side]]), np.zeros(2), {}, (), None, time_zero)


def rows(times=HOURS, lats=(34, 36, 38, 40), lons=(-96, -92, -88)):
    return [f"{t},{lat},{lon},{0.1 * lat},{-0.5}" for t in times for lat in lats for lon in lons]


def write(path, lines, header="time,lat,lon,u,v"):
    path.write_text("\n".join([header, *lines]) + "\n", encoding="utf-8")
    return WindConfig(source="csv", path=str(path))


def read(cfg, where=None):
    return place_readings(cfg, sources.read_readings(cfg), where or scene())


def read_apart(*args, **settings):
    return latest_readings(*grib_snapshots_apart(*args, **settings))


def ingested(cfg, ingest, out):
    return write_wind_table(cfg, sources.read_readings(cfg), ingest, out)


# --- frames and clocks


def test_winds_are_turned_into_the_plane_and_keep_their_speed(tmp_path):
    cfg = write(tmp_path / "w.csv", rows())
    seen = read(cfg)
    crs = str(scene().crs)
    lon, lat = Frame(crs).to_geographic(seen.points[0])
    step = 1e-5
    up = Frame(crs).to_plane(lon, lat + step) - Frame(crs).to_plane(lon, lat - step)
    right = Frame(crs).to_plane(lon + step, lat) - Frame(crs).to_plane(lon - step, lat)
    up, right = (a / np.linalg.norm(a, axis=1, keepdims=True) for a in (up, right))
    expected = 0.1 * lat[:, None] * right - 0.5 * up
    np.testing.assert_allclose(seen.winds[0], expected, atol=1e-5)
    assert np.abs(seen.winds[0][:, 1] + 0.5).max() > 0.05  # the turn is visible


def test_a_table_for_a_robot_in_the_water_is_that_of_its_current(tmp_path):
    cfg = write(tmp_path / "w.csv", rows())
    assert read(cfg).level == "10m"
    current = read(replace(cfg, level="100 m depth", forecast_error="none"))
    assert current.level == "100m depth"


@pytest.mark.parametrize(("stated", "level"), [("100m", "100m"), ("0.08 km", "80m"), ("92500Pa", "925hPa")])
def test_a_table_has_the_level_that_its_user_states(tmp_path, stated, level):
    cfg = replace(write(tmp_path / "w.csv", rows()), level=stated)
    assert read(cfg).level == level
    assert "as wind.level states" in sources.read_readings(cfg).notes[-1]
    law = read(cfg).error
    assert law.level == level
    day = np.array(86_400.0)
    assert law.forecast_variance(day) != read(replace(cfg, level="10m")).error.forecast_variance(day)


@pytest.mark.parametrize(
    ("source", "level", "words"),
    [
        ("csv", "0m", r"wind.level=0m is 0 m above ground; a table of winds or currents: .*'50m depth'"),
        ("stations", "925hPa", r"wind.level=925hPa is at 925 hPa; stations report winds near the ground"),
        ("stations", "5m depth", "is 5 m below the surface; stations report winds near the ground"),
    ],
)
def test_a_level_that_a_source_cannot_have_is_refused_in_one_line(tmp_path, source, level, words):
    cfg = replace(write(tmp_path / "w.csv", rows()), source=source, level=level)
    with pytest.raises(ConfigError, match=words) as caught:
        sources.read_readings(cfg)
    assert "\n" not in str(caught.value)


def test_longitudes_may_count_eastwards_to_360(tmp_path):
    west = read(write(tmp_path / "west.csv", rows()))
    east = read(write(tmp_path / "east.csv", rows(lons=(264, 268, 272))))
    np.testing.assert_allclose(east.points[0], west.points[0], atol=1e-6)


def test_rows_and_columns_may_come_in_any_order(tmp_path):
    straight = read(write(tmp_path / "a.csv", rows()))
    shuffled = [",".join([v, u, lon, lat, t]) for t, lat, lon, u, v in (r.split(",") for r in rows()[::-1])]
    turned = read(write(tmp_path / "b.csv", shuffled, "V, U ,lon,LAT,time"))
    np.testing.assert_array_equal(turned.times, straight.times)
    for k in range(3):
        order, other = (np.lexsort(o.points[k].T) for o in (straight, turned))
        np.testing.assert_array_equal(turned.winds[k][other], straight.winds[k][order])


def test_a_folder_and_a_pattern_read_all_their_tables(tmp_path):
    for hour in HOURS:
        write(tmp_path / f"{hour[11:13]}.csv", rows(times=(hour,)))
    (tmp_path / "notes.md").write_text("not wind")
    for path in (tmp_path, tmp_path / "*.csv"):
        seen = read(WindConfig(source="csv", path=str(path)))
        np.testing.assert_array_equal(seen.times, [0.0, 10800.0, 21600.0])


@pytest.mark.parametrize("header", ["u_kt,v_kt", "u [kn],v (knots)", "U_KTS, v_kn"])
def test_speeds_in_knots_become_metres_a_second(tmp_path, header):
    plain = read(write(tmp_path / "a.csv", rows()))
    knots = read(write(tmp_path / "b.csv", rows(), f"time,lat,lon,{header}"))
    np.testing.assert_allclose(knots.winds[0], plain.winds[0] * 1852.0 / 3600.0)


def test_a_speed_column_may_name_metres_a_second_and_each_has_its_own_unit(tmp_path):
    plain = read(write(tmp_path / "a.csv", rows()), scene(lon=-92.0))
    mixed = read(write(tmp_path / "b.csv", rows(), "time,lat,lon,u [m/s],v_kmh"))
    middle = np.abs(plain.points[0][:, 0]) < 1.0  # on the meridian of the plane, east is x
    np.testing.assert_allclose(mixed.winds[0][middle, 0], plain.winds[0][middle, 0], atol=1e-5)
    np.testing.assert_allclose(mixed.winds[0][middle, 1], plain.winds[0][middle, 1] / 3.6, atol=1e-5)


@pytest.mark.parametrize(
    ("header", "words"),
    [
        (
            "u_furlongs,v",
            "column 'u_furlongs' has the unit 'furlongs'; expected u in m/s, or one of the units m/s",
        ),
        ("u [ft/y],v", "has the unit 'ft/y'"),
        ("u,v,u_kt", "column u occurs as u and as u_kt; keep one"),
        ("speed,weather", "missing column u, v"),
    ],
)
def test_a_unit_that_is_not_known_is_refused_with_those_that_are(tmp_path, header, words):
    with pytest.raises(DataError) as caught:
        read(write(tmp_path / "w.csv", [f"{row},1" for row in rows()], f"time,lat,lon,{header}"))
    assert words in str(caught.value)


def test_a_packed_table_is_read_as_the_table_it_holds(tmp_path):
    plain = read(write(tmp_path / "w.csv", rows()))
    (tmp_path / "packed").mkdir()
    packed = tmp_path / "packed" / "w.csv.gz"
    packed.write_bytes(gzip.compress(b"\xef\xbb\xbf" + (tmp_path / "w.csv").read_bytes()))
    for path in (packed, packed.parent):
        np.testing.assert_array_equal(read(WindConfig(source="csv", path=str(path))).winds[0], plain.winds[0])


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda data: b"time,lat,lon,u,v", "cannot be read: Not a gzipped file"),
        (lambda data: data[:-20], "damaged or cut off"),
        (lambda data: data[:30] + b"\x00\xff" * 20 + data[70:], "damaged or cut off|cannot be read"),
        (lambda data: gzip.compress(b"\xff\xfe\x00"), "is not CSV text"),
    ],
)
def test_a_packed_table_that_is_damaged_is_refused(tmp_path, spoil, words):
    whole = gzip.compress("\n".join(["time,lat,lon,u,v", *rows()]).encode())
    (tmp_path / "w.csv.gz").write_bytes(spoil(whole))
    with pytest.raises(DataError, match=words) as caught:
        read(WindConfig(source="csv", path=str(tmp_path / "w.csv.gz")))
    assert "\n" not in str(caught.value)


def test_a_packed_table_that_fills_the_memory_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(tables, "MAX_UNPACKED", 1000)
    (tmp_path / "w.csv.gz").write_bytes(gzip.compress(b"time,lat,lon,u,v\n" * 100))
    with pytest.raises(DataError, match="unpacks to more than"):
        read(WindConfig(source="csv", path=str(tmp_path / "w.csv.gz")))


def test_leads_in_hours_are_read_per_time_and_the_largest_counts(tmp_path):
    leads = {HOURS[0]: "0", HOURS[1]: "3", HOURS[2]: ""}
    lines = [f"{row},{leads[row.split(',')[0]]}" for row in rows()]
    plain = sources.read_readings(write(tmp_path / "a.csv", lines, "time,lat,lon,u,v,lead_hours"))
    np.testing.assert_array_equal(plain.leads, [0.0, 3 * 3600.0, np.nan])
    assert plain.remarks == ("analysis", "3 h forecast", "")
    assert plain.notes == ()
    lines[0] = lines[0][:-1] + "6"
    mixed = sources.read_readings(write(tmp_path / "b.csv", lines, "time,lat,lon,u,v,lead_hours"))
    assert mixed.leads[0] == 6 * 3600.0
    assert mixed.notes == (
        f"rows of {HOURS[0]} differ in lead_hours: the largest is used for the whole time",
    )


@pytest.mark.parametrize("lead", ["-3", "nan", "inf", "soon", "1e9"])
def test_a_lead_that_cannot_be_is_refused(tmp_path, lead):
    with pytest.raises(DataError, match=r"row 2: lead_hours is .*expected hours since the forecast began"):
        read(write(tmp_path / "a.csv", [f"{row},{lead}" for row in rows()], "time,lat,lon,u,v,lead_hours"))


def test_a_table_without_a_column_of_leads_has_none_and_ingest_writes_none(tmp_path):
    cfg = write(tmp_path / "a.csv", rows())
    assert np.isnan(sources.read_readings(cfg).leads).all()
    out = ingested(cfg, IngestConfig(points=9), tmp_path / "out.csv")
    assert out.read_text().splitlines()[0] == "time,lat,lon,u,v"


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"GRIB" + bytes(50), "w.csv is GRIB, not a CSV table; read it with wind.source=grib"),
        (b"CDF\x01" + bytes(50), "w.csv is NetCDF, not a CSV table; read it with wind.source=netcdf"),
        (gzip.compress(b"time,lat,lon,u,v", mtime=0), "w.csv is packed with gzip, not a CSV table"),
        (b"\n <!DOCTYPE html>", "w.csv is a web page, not a CSV table; a failed download? fetch it again"),
    ],
)
def test_another_format_given_as_csv_is_named_with_the_cure(content, words, tmp_path):
    (tmp_path / "w.csv").write_bytes(content)
    with pytest.raises(DataError, match=re.escape(words)):
        read(WindConfig(source="csv", path=str(tmp_path / "w.csv")))


def test_a_path_with_spaces_and_other_letters_is_read(tmp_path):
    place = tmp_path / "Größe und Höhe 風"
    place.mkdir()
    read(write(place / "Wind 1.csv", rows()))
    read(WindConfig(source="csv", path=str(place)))


def test_times_are_seconds_since_departure_and_start_with_the_last_before_it(tmp_path):
    cfg = write(tmp_path / "w.csv", rows())
    seen = read(cfg, scene(time_zero="2018-10-09T04:00:00Z"))
    np.testing.assert_array_equal(seen.times, [-3600.0, 7200.0])
    exact = read(cfg, scene(time_zero="2018-10-09T03:00:00+00:00"))
    np.testing.assert_array_equal(exact.times, [0.0, 10800.0])
    east = read(cfg, scene(time_zero="2018-10-09T06:00:00+02:00"))
    np.testing.assert_array_equal(east.times, [-3600.0, 7200.0])


def test_without_a_departure_the_clock_starts_with_the_wind(tmp_path):
    cfg = write(tmp_path / "w.csv", rows())
    assert sources.read_readings(cfg).first_time == HOURS[0]
    assert read(cfg).times[0] == 0.0


def test_a_plane_that_lies_nowhere_reads_metres(tmp_path):
    lines = [f"{t},{x},{y},{x / 10},{y}" for t in HOURS for x in (0, 50, 100) for y in (1, 2)]
    seen = read(write(tmp_path / "lab.csv", lines, "time,x,y,u,v"), lab())
    np.testing.assert_allclose(seen.winds[0][:, 0], seen.points[0][:, 0] / 10)
    np.testing.assert_allclose(seen.winds[0][:, 1], seen.points[0][:, 1])


def test_calm_air_needs_no_file_and_has_no_first_time():
    cfg = WindConfig(source="calm")
    seen = read(cfg)
    assert (seen.source, len(seen.times), len(seen.points[0])) == ("calm", 1, 0)
    assert sources.read_readings(cfg).first_time is None


# --- thinning


def dense(path, most):
    cfg = write(path, rows(HOURS[:2], lats=np.arange(25, 49.5, 0.5), lons=np.arange(-105, -79.5, 0.5)))
    cfg.max_points, cfg.forecast_error = most, "none"
    return cfg


def off_map(points, half):
    return np.linalg.norm(np.maximum(0, np.abs(points) - half), axis=1)


def test_every_reading_on_and_beside_the_map_is_used_and_the_log_counts_them(tmp_path, caplog):
    cfg, small = dense(tmp_path / "w.csv", 10_000), scene(side=3e5)
    cfg.padding = 2e5  # there are more than 150 within it
    every = read(cfg, small).points[0]
    assert not caplog.records  # nothing is left out
    beside = every[off_map(every, 1.5e5) <= cfg.padding]
    cfg.max_points = 300
    with caplog.at_level("INFO"):
        used = read(cfg, small).points[0]
    assert len(used) == 300 < len(every)
    assert set(map(tuple, beside)) <= set(map(tuple, used))
    told = f"all {len(beside)} of the readings on and beside the map and {300 - len(beside)} of "
    assert told + f"{len(every) - len(beside)} of those farther away, at each of 2 times" in caplog.text


def test_of_a_grid_that_is_too_dense_nodes_beside_the_map_are_spread_evenly(tmp_path, caplog):
    with caplog.at_level("INFO"):
        used = read(dense(tmp_path / "w.csv", 60)).points[0]
    own = used[off_map(used, 5e5) <= 1.5e5]
    assert (len(own), len(used)) == (45, 60)
    assert "uses 45 of 669 of" in caplog.text
    even = 1.3e6 / np.sqrt(45)  # spacing of a square grid of as many points
    gaps = np.linalg.norm(own[:, None] - own[None], axis=2) + np.diag([np.inf] * 45)
    assert gaps.min() > 0.6 * even
    nodes = np.stack(np.meshgrid(*[np.linspace(-5e5, 5e5, 21)] * 2), -1).reshape(-1, 2)
    assert np.linalg.norm(nodes[:, None] - own[None], axis=2).min(axis=1).max() < 1.2 * even


def test_half_of_the_readings_are_the_nearest_to_a_map_smaller_than_the_grid(tmp_path):
    cfg, place = dense(tmp_path / "w.csv", 10_000), scene(side=1e4)
    nearest = np.sort(off_map(read(cfg, place).points[0], 5e3))[:50]
    cfg.max_points = 100
    np.testing.assert_allclose(np.sort(off_map(read(cfg, place).points[0], 5e3))[:50], nearest)


def test_a_source_with_few_readings_near_takes_the_nearest(tmp_path):
    lines = rows(times=HOURS[:2], lats=np.arange(26, 48), lons=np.arange(-120, -70, 2))
    cfg = write(tmp_path / "w.csv", lines)
    cfg.max_points = 200
    seen = read(cfg, scene(side=2e5))
    kept = np.linalg.norm(np.maximum(0, np.abs(seen.points[0]) - 1e5), axis=1)
    cfg.max_points = 10_000
    every = read(cfg, scene(side=2e5)).points[0]
    gaps = np.sort(np.linalg.norm(np.maximum(0, np.abs(every) - 1e5), axis=1))
    np.testing.assert_allclose(np.sort(kept), gaps[:200])


# --- what users get wrong

GOOD = rows()
BAD_TABLES = {
    "nan": ([*GOOD[:4], "2018-10-09T00:00:00Z,35,-90,nan,1", *GOOD[4:]], r"row 6: expected finite.*NaN"),
    "infinite": ([*GOOD, "2018-10-09T00:00:00Z,35,-90,inf,1"], r"row 38: expected finite"),
    "word": ([*GOOD, "2018-10-09T00:00:00Z,35,-90,strong,1"], r"row 38: u is 'strong'; expected a number"),
    "long word": ([*GOOD, f"{'9' * 5000},35,-90,1,1"], r"row 38: time is '9{20,80}\.\.\.9{20,80}'; expected"),
    "open quote": ([*GOOD[:4], '"' + "x" * 200_000, *GOOD[4:]], r"not CSV text \(field larger than"),
    "NUL": ([*GOOD, "2018-10-09T00:00:00Z,35,-90,1\0,1"], r"row 38: u is '1.x00'; expected a number"),
    "short row": ([*GOOD, "2018-10-09T00:00:00Z,35,-90"], r"row 38: u is ''"),
    "time": (["yesterday,35,-90,1,1", *GOOD], r"row 2: time is 'yesterday'; expected an ISO 8601 time"),
    "latitude": (["2018-10-09T00:00:00Z,135,-90,1,1", *GOOD], r"row 2: latitude 135, longitude -90"),
    "longitude": (["2018-10-09T00:00:00Z,35,-190,1,1", *GOOD], r"row 2: latitude 35, longitude -190"),
    "speed": (["2018-10-09T00:00:00Z,35,-90,60,80", *GOOD], r"row 2: wind speed 100.0 m/s.*wind.max_speed"),
    "duplicate": ([*GOOD, GOOD[4]], r"w.csv, row 6 and w.csv, row 38 are at the same time and place"),
    "no rows": ([], "no rows"),
    "one time": (rows(times=HOURS[:1]), r"one wind time only \(2018-10-09T00:00:00Z\).*wind.hold_last=true"),
    "elsewhere": (rows(lats=(-30, -32), lons=(20, 22, 24)), r"0 wind readings within 500 km .* at least 5"),
    "too few": (rows(lats=(37,), lons=(-92, -91)), r"2 wind readings within 500 km .*; add readings near"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD_TABLES)
def test_a_wrong_table_is_refused_in_one_line_that_says_where(case, tmp_path):
    lines, words = BAD_TABLES[case]
    with pytest.raises(DataError, match=words) as caught:
        read(write(tmp_path / "w.csv", lines))
    assert "\n" not in str(caught.value)
    assert "w.csv" in str(caught.value)


def test_all_faults_of_a_table_stand_in_one_message(tmp_path):
    lines = [
        "yesterday,35,-90,x,1",
        *GOOD,
        "2018-10-09T00:00:00Z,135,-90,1,1",
        "2018-10-09T00:00:00Z,35,-90,60,80",
    ]
    with pytest.raises(DataError) as caught:
        read(write(tmp_path / "w.csv", lines))
    assert re.fullmatch(
        r"wind file \S*w.csv has 4 faults: \(1\) row 2: time is 'yesterday'; expected an ISO 8601 time.*; "
        r"\(2\) row 2: u is 'x'; expected a number; \(3\) row 39: latitude 135, longitude -90 is not on .*; "
        r"\(4\) row 40: wind speed 100.0 m/s is not plausible; .*",
        str(caught.value),
    )


def test_of_many_faults_of_a_table_the_first_are_named_and_the_rest_is_counted(tmp_path):
    lines = [f"2018-10-09T00:00:00Z,35,-{n},strong,1" for n in range(100)]
    with pytest.raises(DataError, match=r"has 100 faults: \(1\) row 2: .*; and \d+ more$") as caught:
        read(write(tmp_path / "w.csv", lines))
    assert len(str(caught.value)) <= 2000


def test_duplicates_of_several_tables_are_named_together(tmp_path):
    for name in "ab":
        write(tmp_path / f"{name}.csv", GOOD[:2])
    with pytest.raises(DataError, match=r"2 faults: .*a.csv, row 2 and b.csv, row 2 .*; \(2\) .*row 3 and"):
        table_of(WindConfig(source="csv", path=str(tmp_path)))


def test_rows_are_counted_as_an_editor_counts_them(tmp_path):
    with pytest.raises(DataError, match="row 5:"):
        read(write(tmp_path / "w.csv", [GOOD[0], "", "", "2018-10-09T00:00:00Z,35,-90,x,1"]))


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "is empty"),
        (b"time,lat,u,v\n", "missing column lon"),
        (b"\x00\xff\xfe\x80GRIB", "not CSV text"),
    ],
)
def test_a_file_that_is_no_table_is_refused(content, words, tmp_path):
    file = tmp_path / "w.csv"
    file.write_bytes(content)
    with pytest.raises(DataError, match=words) as caught:
        read(WindConfig(source="csv", path=str(file)))
    assert "w.csv" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("source", ["csv", "grib", "netcdf", "currents", "stations"])
def test_a_missing_file_is_named(source, tmp_path):
    with pytest.raises(DataError, match=rf"nowhere: no {source} file, folder or pattern"):
        read(WindConfig(source=source, path=str(tmp_path / "nowhere")))


def test_a_folder_without_files_of_the_source_and_a_missing_path_are_refused(tmp_path):
    (tmp_path / "buoys.json").write_text("[]")
    with pytest.raises(DataError, match="no csv file in this folder"):
        sources.data_files(WindConfig(source="csv", path=str(tmp_path)))
    with pytest.raises(ConfigError, match=r"wind\.path is missing: wind\.source=sample needs a file"):
        sources.data_files(WindConfig())


def test_tables_of_both_kinds_do_not_mix(tmp_path):
    write(tmp_path / "a.csv", GOOD)
    write(tmp_path / "b.csv", [f"{HOURS[0]},1,2,3,4"], "time,x,y,u,v")
    with pytest.raises(DataError, match=r"some tables have lat,lon and some x,y"):
        read(WindConfig(source="csv", path=str(tmp_path)))


@pytest.mark.parametrize("when", ["2018-10-08T23:59:59Z", "2018-10-09T06:00:00Z", "2019-01-01T00:00:00Z"])
def test_a_departure_outside_the_wind_is_refused(when, tmp_path):
    cfg = write(tmp_path / "w.csv", GOOD)
    with pytest.raises(
        DataError, match=rf"departure {when} .*2018-10-09T00.* \.\. 2018-10-09T06.*start_time"
    ):
        read(cfg, scene(time_zero=when))


def test_the_last_field_is_held_only_when_asked_to(tmp_path):
    cfg = write(tmp_path / "w.csv", GOOD)
    cfg.hold_last = True
    late = read(cfg, scene(time_zero="2018-10-09T11:00:00Z"))
    np.testing.assert_array_equal(late.times, [-5 * 3600.0])
    assert late.until == 3600.0
    with pytest.raises(DataError, match=r"holds it for 6 h; .*wind.max_gap \(now 6 h\) of 18 h and the time"):
        read(cfg, scene(time_zero="2018-10-10T00:00:00Z"))
    with pytest.raises(DataError, match=r"add wind files$"):  # too old to be held
        read(cfg, scene(time_zero="2018-12-10T00:00:00Z"))
    cfg.max_gap = 24.0
    assert read(cfg, scene(time_zero="2018-10-10T00:00:00Z")).until == 6 * 3600.0
    with pytest.raises(DataError, match="departure"):
        read(cfg, scene(time_zero="2018-10-08T00:00:00Z"))
    single = write(tmp_path / "one.csv", rows(times=HOURS[:1]))
    single.hold_last = True
    np.testing.assert_array_equal(read(single).times, [0.0])


def test_a_departure_that_is_no_time_is_refused(tmp_path):
    with pytest.raises(ConfigError, match=r"mission.start_time 'noon'"):
        read(write(tmp_path / "w.csv", GOOD), scene(time_zero="noon"))


def test_degrees_cannot_be_flown_in_a_plane_that_lies_nowhere():
    with pytest.raises(DataError, match=r"scene.centre"):
        read(WindConfig(), lab())


# --- GRIB, written here with ecCodes' own samples


def message(eccodes, short, values, hour=0, step=0, level=10, count=17 * 15, **extra):
    """A GRIB2 message on a grid of 1 degree over 30..44 N, 100..84 W."""
    handle = eccodes.codes_grib_new_from_samples("regular_ll_sfc_grib2")
    settings = {
        "dataDate": 20181009,
        "dataTime": 100 * hour,
        "Ni": 17,
        "Nj": 15,
        "latitudeOfFirstGridPointInDegrees": 44.0,
        "latitudeOfLastGridPointInDegrees": 30.0,
        "longitudeOfFirstGridPointInDegrees": 260.0,
        "longitudeOfLastGridPointInDegrees": 276.0,
        "iDirectionIncrementInDegrees": 1.0,
        "jDirectionIncrementInDegrees": 1.0,
        "typeOfLevel": "heightAboveGround",
        "level": level,
        "shortName": short,
        "step": step,
        **extra,
    }
    for key, value in settings.items():
        eccodes.codes_set(handle, key, value)
    eccodes.codes_set(handle, "bitsPerValue", 24)
    eccodes.codes_set_values(handle, np.broadcast_to(values, count).astype(float))
    raw = eccodes.codes_get_message(handle)
    eccodes.codes_release(handle)
    return raw


@pytest.fixture
def eccodes():
    pytest.importorskip("pyproj")  # first: see wind/grib.py
    return pytest.importorskip("eccodes", reason="the extra `grib` is not installed")


@pytest.fixture
def gribs(eccodes, tmp_path):
    """Two times, one file each, u a plane in latitude and v constant; and levels that must not be read."""
    lat = np.repeat(np.arange(44, 29, -1), 17)
    for hour in (0, 6):
        raw = [
            message(eccodes, "u", 99.0, hour, level=80),
            message(eccodes, "10u", lat / 10 + hour, hour),
            message(eccodes, "2t", 280.0, hour, level=2),
            message(eccodes, "10v", -2.0, hour),
        ]
        (tmp_path / f"gfs.{hour:02d}").write_bytes(b"".join(raw))
    return tmp_path


def grib(path, **settings):
    return WindConfig(source="grib", path=str(path), **settings)


def table_of(cfg):
    return sources.read_readings(cfg)


def test_grib_winds_are_found_among_other_messages(gribs):
    readings = table_of(grib(gribs))
    assert len(readings.times) == 2
    assert readings.times[1] - readings.times[0] == 6 * 3600
    assert readings.points[0][:, 0].min() == -100
    for k, hour in enumerate((0, 6)):
        np.testing.assert_allclose(readings.winds[k][:, 0], readings.points[k][:, 1] / 10 + hour, atol=1e-5)
        np.testing.assert_allclose(readings.winds[k][:, 1], -2.0, atol=1e-5)
    assert sources.read_readings(grib(gribs)).first_time == "2018-10-09T00:00:00Z"
    assert len(read(grib(gribs)).points[0]) == 255  # 15 x 17 nodes within 500 km of the map


def test_where_two_forecasts_reach_one_time_the_later_one_counts(gribs, eccodes):
    old = [message(eccodes, short, 50.0, 0, step=6) for short in ("10u", "10v")]
    (gribs / "gfs.00f6").write_bytes(b"".join(old))
    readings = table_of(grib(gribs))
    assert len(readings.times) == 2
    assert readings.winds[1].max() < 20
    assert readings.remarks == ("analysis", "analysis")


def test_a_forecast_is_valid_after_its_start(gribs, eccodes):
    later = [message(eccodes, short, 5.0, 6, step=3) for short in ("10u", "10v")]
    (gribs / "gfs.06f3").write_bytes(b"".join(later))
    readings = table_of(grib(gribs))
    assert readings.times[2] == datetime(2018, 10, 9, 9, tzinfo=UTC).timestamp()
    assert readings.remarks[2] == "3 h forecast"


def test_two_members_of_one_time_are_refused(gribs, eccodes):
    (gribs / "again").write_bytes(message(eccodes, "10u", 1.0) + message(eccodes, "10v", -2.0))
    with pytest.raises(DataError, match=r"again and gfs.00 both hold u at 2018-10-09T00"):
        read(grib(gribs))


def test_messages_that_are_there_twice_are_read_once(gribs):
    plain = table_of(grib(gribs))
    (gribs / "again").write_bytes((gribs / "gfs.00").read_bytes())
    twice = table_of(grib(gribs))
    np.testing.assert_array_equal(np.stack(twice.winds), np.stack(plain.winds))
    assert twice.notes == (*plain.notes, "2 GRIB messages occur twice with the same values: read once")


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda raw: raw[: len(raw) - 40], r"damaged or truncated"),
        (lambda raw: b"<!DOCTYPE html><html>no such file</html>", r"web page"),
        (lambda raw: b"", r"is empty"),
        (lambda raw: b"time,lat,lon,u,v\n1,2,3,4,5\n" * 9, r"no wind 10 m above ground"),
    ],
)
def test_a_file_that_is_no_whole_grib_is_named(spoil, words, gribs):
    file = gribs / "gfs.06"
    file.write_bytes(spoil(file.read_bytes()))
    for call in (read, sources.read_readings):
        with pytest.raises(DataError, match=words) as caught:
            call(grib(gribs))
        assert "gfs.06" in str(caught.value)
        assert "\n" not in str(caught.value)


def test_faults_of_several_messages_stand_in_one_line(gribs, eccodes):
    lat = np.repeat(np.arange(44, 29, -1), 17)
    raw = [message(eccodes, "10u", lat, hour) for hour in (0, 6, 12)]
    (gribs / "gfs.00").write_bytes(b"".join(raw))
    (gribs / "gfs.06").write_bytes(message(eccodes, "2t", 280.0, level=2))
    with pytest.raises(DataError, match="holds no wind 10 m above ground"):
        table_of(grib(gribs))
    (gribs / "gfs.06").unlink()
    with pytest.raises(DataError, match=r"3 faults: \(1\) .*00:00:00Z has no v component.*\(3\) .*12:00:00Z"):
        table_of(grib(gribs))


def test_components_on_grids_of_different_sizes_are_refused(gribs, eccodes):
    (gribs / "gfs.06").unlink()
    short = message(eccodes, "10v", 1.0, Nj=14, latitudeOfLastGridPointInDegrees=31.0, count=17 * 14)
    (gribs / "gfs.00").write_bytes(message(eccodes, "10u", 1.0) + short)
    with pytest.raises(DataError, match="u and v at 2018-10-09T00:00:00Z are on different grids"):
        table_of(grib(gribs))


def test_a_message_with_a_date_that_there_cannot_be_is_named(gribs):
    file = gribs / "gfs.06"
    raw = file.read_bytes()
    day = bytes([2018 // 256, 2018 % 256, 10, 9])
    assert raw.count(day) == 4
    file.write_bytes(raw.replace(day, bytes([255, 255, 60, 77])))
    with pytest.raises(
        DataError, match=r"gfs.06 is damaged or cannot be read \(.*\); fetch it again"
    ) as caught:
        read(grib(gribs))
    assert "\n" not in str(caught.value)


def test_a_file_cut_between_its_messages_lacks_a_component(gribs, eccodes):
    (gribs / "gfs.06").write_bytes(message(eccodes, "10u", 1.0, 6))
    with pytest.raises(DataError, match=r"gfs.06: 2018-10-09T06:00:00Z has no v component"):
        read(grib(gribs))


def test_an_implausible_grib_wind_is_refused(gribs):
    with pytest.raises(DataError, match=r"gfs.06, 2018-10-09T06.*m/s is not plausible"):
        read(grib(gribs, max_speed=10.0))


def test_nodes_outside_the_models_domain_are_left_out(eccodes, tmp_path):
    values = np.full(17 * 15, 3.0)
    values[:50] = 9999.0
    raw = [
        message(eccodes, short, values, hour, missingValue=9999, bitmapPresent=1)
        for hour in (0, 6)
        for short in ("10u", "10v")
    ]
    (tmp_path / "rap").write_bytes(b"".join(raw))
    readings = table_of(grib(tmp_path / "rap"))
    assert len(readings.winds[0]) == 17 * 15 - 50
    np.testing.assert_allclose(readings.winds[0], 3.0, atol=1e-5)


def test_without_eccodes_the_message_names_the_extra(gribs, monkeypatch):
    monkeypatch.setitem(sys.modules, "eccodes", None)
    with pytest.raises(DataError, match=r'pip install "pareto-ltl\[grib\]"'):
        grib_snapshots((gribs / "gfs.00",), 75.0)


def test_winds_decoded_apart_are_those_decoded_here(gribs):
    files = tuple(sorted(gribs.iterdir()))
    here, apart = latest_readings(*grib_snapshots(files, 75.0)), read_apart(files, 75.0)
    np.testing.assert_array_equal(here.times, apart.times)
    for ours, theirs in ((here.points, apart.points), (here.winds, apart.winds)):
        for one, other in zip(ours, theirs, strict=True):
            np.testing.assert_array_equal(one, other)
    assert (here.files, here.remarks, here.origins) == (apart.files, apart.remarks, apart.origins)


def test_a_decoder_that_dies_is_one_line_about_the_file_that_it_had_open(gribs, tmp_path, monkeypatch):
    """ecCodes aborts on some damaged messages, which no code of ours can catch."""
    died = tmp_path / "died"
    died.write_text("#!/bin/sh\necho first.grib\necho second.grib\nkill -ABRT $$\n")
    died.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(died))
    with pytest.raises(DataError, match=r"^wind file second\.grib is damaged: ecCodes.*code -6; download it"):
        read_apart((gribs / "gfs.00",), 75.0)


def test_every_cycle_and_time_is_a_snapshot_of_its_own(gribs, eccodes):
    old = [message(eccodes, short, 50.0, 0, step=6) for short in ("10u", "10v")]
    (gribs / "gfs.00f6").write_bytes(b"".join(old))
    found = grib_snapshots_apart(tuple(sorted(gribs.iterdir())), 75.0).winds
    hours = [((snap.time - found[0].time) / 3600, snap.lead / 3600) for snap in found]
    assert hours == [(0, 0), (6, 0), (6, 6)]
    assert found[2].files == (gribs / "gfs.00f6",)
    np.testing.assert_allclose(found[2].winds, 50.0, atol=1e-4)


def test_another_level_is_read_when_asked_for(eccodes, tmp_path):
    levels = [message(eccodes, short, value, level=height) for height, value in ((10, 3.0), (80, 7.0))
              for short in ("u", "v")]  # fmt: skip
    (tmp_path / "hrrr").write_bytes(b"".join(levels))
    found = read_apart((tmp_path / "hrrr",), 75.0, "80 m")
    assert found.level == "80m"
    np.testing.assert_allclose(found.winds[0], 7.0, atol=1e-5)
    with pytest.raises(DataError, match=r"hrrr holds no wind at 925 hPa; it has 10m, 80m: set wind.level"):
        read_apart((tmp_path / "hrrr",), 75.0, "925hPa")


@needs_noaa
def test_nodes_below_ground_are_left_out_at_a_level_of_pressure(eccodes):
    """The Rocky Mountains rise above 850 hPa; the surface pressure of the same file says where."""
    file = NOAA / "nam_awip21" / "nam.t00z.awp21100.tm00.grib2"
    low, high = (read_apart((file,), 75.0, level) for level in ("850hPa", "500hPa"))
    gone = set(map(tuple, high.points[0].tolist())) - set(map(tuple, low.points[0].tolist()))
    assert len(high.points[0]) == 93 * 65
    assert 300 < len(gone) < 1500
    assert np.mean([-120 < lon < -100 for lon, _ in gone]) > 0.8
    assert low.notes[0].startswith(f"{len(gone)} of 6045 values at 850hPa lie below ground")
    assert high.notes[0].startswith("0 of 6045")
    with pytest.raises(DataError, match=r"it has 10m, 100hPa, 150hPa, .* and \d+ more: set wind.level"):
        read_apart((file,), 75.0, "20m")


def test_nodes_that_cannot_be_checked_against_the_ground_are_named(eccodes, tmp_path):
    raw = [message(eccodes, short, 3.0, typeOfLevel="isobaricInhPa", level=925) for short in ("u", "v")]
    (tmp_path / "gfs").write_bytes(b"".join(raw))
    (note,) = read_apart((tmp_path / "gfs",), 75.0, "925hPa").notes
    assert note.startswith("1 fields at 925hPa come without surface pressure")


def test_averages_and_maxima_beside_instants_are_left_out_and_counted(eccodes, tmp_path):
    means = [
        message(eccodes, short, 9.0, productDefinitionTemplateNumber=8, stepType="avg", stepRange="0-3")
        for short in ("10u", "10v")
    ]
    (tmp_path / "means").write_bytes(b"".join(means))
    with pytest.raises(DataError, match=r"holds the wind 10 m above ground as average only; expected values"):
        read_apart((tmp_path / "means",), 75.0)
    plain = [message(eccodes, short, 3.0) for short in ("10u", "10v")]
    (tmp_path / "means").write_bytes(b"".join(means + plain))
    found = read_apart((tmp_path / "means",), 75.0)
    np.testing.assert_allclose(found.winds[0], 3.0, atol=1e-5)
    assert found.notes == (
        "2 GRIB messages hold the average of the wind, not its value at an instant: left out",
    )


def test_members_of_an_ensemble_are_snapshots_with_their_numbers(eccodes, tmp_path):
    raw = [
        message(eccodes, short, float(member), productDefinitionTemplateNumber=1, perturbationNumber=member)
        for member in (1, 2)
        for short in ("10u", "10v")
    ]
    (tmp_path / "gefs").write_bytes(b"".join(raw))
    found = grib_snapshots_apart((tmp_path / "gefs",), 75.0).winds
    assert [snap.member for snap in found] == ["01", "02"]
    assert [float(snap.winds[0, 0]) for snap in found] == [1.0, 2.0]
    with pytest.raises(DataError, match=r"gefs both? hold.* with the same lead; .*wind.source=ensemble"):
        read_apart((tmp_path / "gefs",), 75.0)


def test_only_the_nodes_of_an_area_are_kept_and_an_empty_one_says_what_the_file_covers(gribs):
    area = GeoBox(-95.0, 33.0, 4.0, 40.0)
    whole, part = (read_apart((gribs / "gfs.00",), 75.0, area=box) for box in (None, area))
    inside = area.contains(whole.points[0])
    assert 0 < inside.sum() < len(inside)
    np.testing.assert_array_equal(part.points[0], whole.points[0][inside])
    np.testing.assert_array_equal(part.winds[0], whole.winds[0][inside])
    words = (
        r"gfs.00 covers latitude 30..44, longitude -100..-84; the scene needs latitude 55..60, longitude 5..9"
    )
    with pytest.raises(DataError, match=words):
        read_apart((gribs / "gfs.00",), 75.0, area=GeoBox(5.0, 55.0, 4.0, 60.0))


@pytest.mark.parametrize(
    ("head", "words"),
    [
        (b"\x89HDF\r\n\x1a\n", "is NetCDF, not GRIB; read it with wind.source=netcdf"),
        (b"CDF\x01", "is NetCDF, not GRIB"),
        (b"\x1f\x8b\x08", "is packed with gzip, not GRIB; unpack it"),
    ],
)
def test_another_format_given_as_grib_is_named_with_the_cure(head, words, eccodes, tmp_path):
    (tmp_path / "file").write_bytes(head + bytes(500))
    with pytest.raises(DataError, match=words):
        read_apart((tmp_path / "file",), 75.0)


@needs_noaa
def test_grid_relative_winds_are_turned_to_east_and_north(eccodes):
    """NAM's Lambert grid: its own rows and columns show where its axes point on Earth."""
    file = NOAA / "nam_awip21" / "nam.t00z.awp21100.tm00.grib2"
    readings = table_of(grib(file))
    raw = {}
    with file.open("rb") as stream:
        eccodes.codes_grib_multi_support_on()
        while (handle := eccodes.codes_grib_new_from_file(stream)) is not None:
            level = [eccodes.codes_get(handle, key) for key in ("typeOfLevel", "level")]
            if level == ["heightAboveGround", 10]:
                raw[eccodes.codes_get(handle, "shortName")] = eccodes.codes_get_values(handle)
            eccodes.codes_release(handle)
        eccodes.codes_grib_multi_support_off()
    lon, lat = np.deg2rad(readings.points[0].T.reshape(2, 65, 93))
    place = np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], axis=-1)
    east = np.stack([-np.sin(lon), np.cos(lon), 0 * lon], axis=-1)
    north = np.cross(place, east)
    along = (place[:, 2:] - place[:, :-2])[1:-1]  # one column eastwards on the grid
    across = (place[2:] - place[:-2])[:, 1:-1]  # one row northwards
    inner = (slice(1, -1), slice(1, -1))
    expected = np.zeros((63, 91, 2))
    for direction, name in ((along, "10u"), (across, "10v")):
        axis = direction / np.linalg.norm(direction, axis=-1, keepdims=True)
        part = raw[name].reshape(65, 93)[inner]
        expected[..., 0] += part * (axis * east[inner]).sum(-1)
        expected[..., 1] += part * (axis * north[inner]).sum(-1)
    ours = readings.winds[0].reshape(65, 93, 2)
    np.testing.assert_allclose(ours[inner], expected, atol=0.02)
    plain = np.stack([raw["10u"], raw["10v"]], axis=-1).reshape(65, 93, 2)
    assert np.abs(plain - ours).max() > 2.0  # unturned winds would be far off


# --- the table of figures


def test_ingest_writes_the_same_nodes_at_all_times_and_says_from_where(gribs, tmp_path):
    out = tmp_path / "deep" / "table.csv"
    out.parent.mkdir()
    area = [[-98.5, 31.5], [-86.5, 31.5], [-86.5, 42.5], [-98.5, 42.5]]
    assert ingested(grib(gribs), IngestConfig(points=30, area=area), out) == out
    seen = table_of(WindConfig(source="csv", path=str(out)))
    lon, lat = seen.points[0].T
    assert len(lon) == 30
    assert lon.min() >= -98.5
    assert lat.max() <= 42.5
    for k, hour in enumerate((0, 6)):
        np.testing.assert_array_equal(seen.points[k], seen.points[0])
        np.testing.assert_allclose(seen.winds[k][:, 0], lat / 10 + hour, atol=0.0051)
    told = json.loads(out.with_suffix(".json").read_text())
    assert set(told["files"]) == {"gfs.00", "gfs.06"}
    assert all(len(digest) == 64 for digest in told["files"].values())
    assert told["times"] == {"2018-10-09T00:00:00Z": "analysis", "2018-10-09T06:00:00Z": "analysis"}
    assert sorted(file.name for file in out.parent.iterdir()) == ["table.csv", "table.json"]


def test_ingest_makes_no_folders_and_overwrites_nothing_that_it_reads(gribs, tmp_path):
    with pytest.raises(ConfigError, match=r"there is no folder .*deep; make it"):
        ingested(grib(gribs), IngestConfig(points=9), tmp_path / "deep" / "table.csv")
    assert not (tmp_path / "deep").exists()
    first = tmp_path / "table.csv"
    ingested(grib(gribs), IngestConfig(points=9), first)
    kept = first.read_bytes()
    around = first.parent / "." / first.name
    for out in (first, around):
        with pytest.raises(ConfigError, match=r"name another"):
            ingested(WindConfig(source="csv", path=str(first)), IngestConfig(points=5), out)
    assert first.read_bytes() == kept


def test_ingest_keeps_the_times_asked_for_and_names_only_their_files(gribs, tmp_path):
    out = tmp_path / "table.csv"
    ingested(grib(gribs), IngestConfig(points=9, first="2018-10-09T01:00Z"), out)
    assert sources.read_readings(WindConfig(source="csv", path=str(out))).first_time == "2018-10-09T06:00:00Z"
    assert list(json.loads(out.with_suffix(".json").read_text())["files"]) == ["gfs.06"]


def test_ingest_that_finds_nothing_says_so(gribs, tmp_path):
    out = tmp_path / "table.csv"
    with pytest.raises(DataError, match=r"no wind time between .* 2018-10-09T00.* \.\. 2018-10-09T06"):
        ingested(grib(gribs), IngestConfig(first="2020-01-01"), out)
    with pytest.raises(ConfigError, match=r"ingest.last 'later'"):
        ingested(grib(gribs), IngestConfig(last="later"), out)
    with pytest.raises(DataError, match=r"0 wind nodes lie in ingest.area"):
        ingested(grib(gribs), IngestConfig(area=[[0, 0], [1, 0], [0, 1]]), out)
    assert not out.exists()


def test_the_sample_names_other_winds_for_a_map_elsewhere():
    with pytest.raises(
        DataError, match=r"covers the contiguous United States; .* docs/wind.md, or wind=calm"
    ):
        read(WindConfig(), scene(62.2, 25.7, 1e5))


def test_the_packaged_sample_covers_the_contiguous_us_at_fourteen_times():
    readings = table_of(WindConfig())
    assert len(readings.times) == 14
    np.testing.assert_array_equal(np.diff(readings.times), 3 * 3600.0)
    assert sources.read_readings(WindConfig()).first_time == "2018-10-09T00:00:00Z"
    lon, lat = readings.points[0].T
    assert {len(points) for points in readings.points} == {120}
    assert (lon >= -125).all()
    assert (lon <= -66).all()
    assert (lat >= 24).all()
    assert (lat <= 50).all()


def test_no_reading_of_the_sample_on_the_ready_maps_is_stronger_than_the_documents_say():
    seen = place_readings(WindConfig(), sources.read_readings(WindConfig()), scene())
    inside = [np.abs(points).max(axis=1) <= 5e5 for points in seen.points]
    speeds = [np.hypot(*winds[here].T) for winds, here in zip(seen.winds, inside, strict=True)]
    assert 10.0 < np.concatenate(speeds).max() < 10.5  # "at most 10 m/s on the map"


@needs_noaa
def test_the_packaged_sample_is_what_ingest_writes(eccodes, tmp_path):
    chosen = yaml.safe_load((ROOT / "conf" / "ingest" / "conus.yaml").read_text())
    when = {"first": "2018-10-09T00:00:00Z", "last": "2018-10-10T15:00:00Z"}
    out = ingested(grib(NOAA / "gfs_1p00_10m"), IngestConfig(**chosen, **when), tmp_path / "sample.csv")
    lines = [line.rsplit(",", 1) for line in out.read_text().splitlines()]
    assert "\n".join(line[0] for line in lines) + "\n" == SAMPLE_WINDS.read_text()
    assert lines[0][1] == "lead_hours"
    assert {line[0][11:13]: line[1] for line in lines[1:]} == {
        f"{hour:02d}": "0" if hour % 6 == 0 else "3" for hour in range(0, 24, 3)
    }
    assert out.with_suffix(".json").read_bytes() == SAMPLE_WINDS.with_suffix(".json").read_bytes()


@needs_noaa
def test_the_packaged_sample_agrees_with_another_extraction_of_the_same_fields():
    ours, theirs = (
        table_of(WindConfig()),
        table_of(WindConfig(source="csv", path=str(NOAA / "conus_wind_sample.csv"))),
    )
    common = 0
    for k, time in enumerate(theirs.times):
        j = int(np.flatnonzero(ours.times == time)[0])
        mine = {tuple(p): w for p, w in zip(ours.points[j].tolist(), ours.winds[j], strict=True)}
        for place, wind in zip(theirs.points[k].tolist(), theirs.winds[k], strict=True):
            if tuple(place) in mine:
                np.testing.assert_allclose(
                    mine[tuple(place)], wind, atol=0.0551
                )  # rounded to 0.1 and to 0.01
                common += 1
    assert common > 50


def test_a_header_with_a_column_many_times_is_refused_in_a_short_line(tmp_path):
    (tmp_path / "a.csv").write_text("time,lat,lon,v" + 1000 * ",u" + "\n")
    with pytest.raises(DataError, match="column u occurs as u and as u") as caught:
        sources.read_readings(WindConfig(source="csv", path=str(tmp_path / "a.csv")))
    assert len(str(caught.value)) < 300


@pytest.mark.parametrize(("limit", "value"), [("MAX_ROWS", 2), ("MAX_UNPACKED", 60)])
@pytest.mark.parametrize("name", ["w.csv", "w.csv.gz"])
def test_a_table_beyond_the_limits_is_refused_before_it_is_parsed(tmp_path, monkeypatch, name, limit, value):
    monkeypatch.setattr(tables, limit, value)
    monkeypatch.setattr(tables.csv, "reader", None)
    content = b"time,lat,lon,u,v\n" + b"2018-10-09,30,-90,1,1\n" * 3
    (tmp_path / name).write_bytes(gzip.compress(content) if name.endswith("gz") else content)
    with pytest.raises(DataError, match=r"more than .*; keep the rows near the map and the hours"):
        read(WindConfig(source="csv", path=str(tmp_path / name)))


def test_readings_are_shown_by_their_facts() -> None:
    points, winds = np.array([[0.0, 0.0], [1.0, 1.0], [2.0, 0.0]]), np.ones((2, 3, 2))
    readings = Readings.of_arrays(["2026-01-01T00:00Z", "2026-01-01T06:00Z"], points, winds, geographic=False)
    shown = repr(readings)
    assert "times 2, readings 6, from 2026-01-01T00:00:00Z, to 2026-01-01T06:00:00Z" in shown
    assert len(shown) < 200
