"""Live forecasts of every product from a local archive with inventories as the providers write them."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest

pytest.importorskip("pyproj")  # before ecCodes
pytest.importorskip("eccodes", reason="the extra `grib` is not installed")

from careful_io.times import seconds
from flight_quantities.levels import parse_level
from live_archives import GRID, aigfs, current, ecmwf, nbm, rtofs, wind
from noaa_server import NoaaServer, downloads_at, serving
from pareto_ltl.settings import Settings, WindConfig
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl.wind.area import GeoBox, Wanted
from pareto_ltl.wind.sources import read_readings
from pareto_ltl_apps.formats import live
from pareto_ltl_apps.formats.grib_frames import parameters
from pareto_ltl_apps.formats.inventories import parse_inventory, wind_parts

CYCLE = "2026060106"
BEGAN = seconds("2026-06-01T06:00:00Z")
OZARKS = Wanted(GeoBox(-96.0, 33.0, 8.0, 41.0), "2026-06-01T07:30:00Z")
COAST = Wanted(GeoBox(-74.0, 38.0, 5.0, 42.5), "2026-06-01T07:30:00Z")


@pytest.fixture(autouse=True)
def fresh(monkeypatch, tmp_path):
    downloads_at("2026-06-01T08:00:00Z", monkeypatch, tmp_path)


def cfg(server, source, **more):
    return Settings.of_section(
        "wind",
        {"source": source, "base_url": server.address, "level": "10m", "hours": 2.0, "retries": 1} | more,
    )


def check(found, hours, expected):
    """The winds are those of ``expected(points, hour)``, with their leads."""
    np.testing.assert_allclose(found.leads / 3600.0, hours)
    np.testing.assert_allclose(found.times, BEGAN + 3600.0 * np.array(hours))
    for points, winds, hour in zip(found.points, found.winds, hours, strict=True):
        assert len(points)
        np.testing.assert_allclose(winds, expected(points, hour), atol=2e-3)


# --- values ----------------------------------------------------------------------------------


@pytest.mark.parametrize("height", [10, 80])
def test_speed_and_direction_of_the_blend_are_winds_on_its_lambert_grid(height):
    with serving(NoaaServer(nbm(CYCLE, range(1, 5)))) as server:
        found = read_readings(cfg(server, "nbm", level=f"{height}m"), OZARKS)
    check(found, [1, 2, 3, 4], lambda points, hour: wind(points, hour, height=height))
    assert found.notes[0].startswith("nbm forecast of 2026-06-01T06:00:00Z")


def test_of_the_blend_only_speed_and_direction_are_fetched():
    archive = nbm(CYCLE, [1, 2, 3, 4])
    with serving(NoaaServer(archive)) as server:
        files = live.live_files(cfg(server, "nbm"), OZARKS)
        ranges = [told for path, told in server.ranges if path.endswith(".grib2")]
    assert len(files) == len(ranges) == 4
    for file in files:
        with file.open("rb") as stream:
            assert [field.number for field in parameters(stream)] == [(0, 2, 0), (0, 2, 1)]


@pytest.mark.parametrize(("level", "product"), [("10m", "sfc"), ("925hPa", "pres")])
def test_aigfs_has_its_heights_and_pressures_in_two_files(level, product):
    with serving(NoaaServer(aigfs(CYCLE, [0, 6]))) as server:
        found = read_readings(cfg(server, "aigfs", level=level), OZARKS)
        assert all(f".{product}." in path for path in server.asked)
    check(found, [0, 6], wind)
    assert found.level == level


def test_members_of_aigefs_are_an_ensemble():
    with serving(NoaaServer(aigfs(CYCLE, [0, 6], range(4)))) as server:
        found = read_readings(cfg(server, "aigefs", members=4), OZARKS)
        control = read_readings(cfg(server, "aigefs", members=1), OZARKS)
    check(found, [0, 6], lambda points, hour: wind(points, hour) + np.array([1.5, 0.0]))  # members 0, 1, 2, 3
    check(control, [0, 6], wind)
    share = 3 / (3 + 10.0)  # of four members against ten of the law
    deviations = np.arange(4) - 1.5
    spread = np.sum(found.members[0] ** 2, axis=-1)
    np.testing.assert_allclose(spread[:, 0], share * (1 + 1 / 4) * np.sum(deviations**2) / 3, rtol=1e-3)
    np.testing.assert_allclose(spread[:, 1], 0.0, atol=1e-4)


@pytest.mark.parametrize(("level", "height"), [("10m", 10.0), ("100m", 100.0), ("925hPa", 500.0)])
@pytest.mark.parametrize(
    ("source", "model", "hours"), [("ifs", "ifs", [0, 3, 6]), ("aifs", "aifs-single", [0, 6])]
)
def test_forecasts_of_ecmwf_are_read_by_their_index(source, model, hours, level, height):
    archive = ecmwf(CYCLE, hours, model, "oper", "fc")
    with serving(NoaaServer(archive)) as server:
        found = read_readings(cfg(server, source, level=level, hours=3.0), OZARKS)
    check(found, hours, lambda points, hour: wind(points, hour, height=height))
    ground = level == "925hPa"  # north of 40 degrees the surface pressure is 900 hPa
    inside = GRID[OZARKS.area.contains(GRID)]
    assert len(found.points[0]) == np.sum((inside[:, 1] <= 40.0) | (not ground))


@pytest.mark.parametrize(
    ("source", "hours", "control", "others"),
    [
        ("ifs", [0, 3, 6], ("ifs", "oper", "fc"), ("ifs", "enfo", "ef")),
        ("aifs", [0, 6], ("aifs-ens", "enfo", "cf"), ("aifs-ens", "enfo", "pf")),
    ],
)
def test_ensembles_of_ecmwf_are_the_control_and_members_of_one_file(source, hours, control, others):
    archive = ecmwf(CYCLE, hours, *control) | ecmwf(CYCLE, hours, *others, members=range(1, 6))
    with serving(NoaaServer(archive)) as server:
        found = read_readings(cfg(server, source, members=3, hours=3.0), OZARKS)
    check(
        found, hours, lambda points, hour: wind(points, hour) + np.array([1.0, 0.0])
    )  # members 0, 1, 2 of six
    assert found.members[0].shape[-1] == 3
    assert any("3 members" in note for note in found.notes)


def test_currents_of_rtofs_are_those_of_the_hours_around_the_flight():
    archive = rtofs("2026060100")
    with serving(NoaaServer(archive)) as server:
        found = read_readings(cfg(server, "rtofs", level="0m", hours=20.0), COAST)
        assert set(server.asked) == set(archive)
    hours = np.arange(7, 29)  # from 07:30 on, 20 hours
    np.testing.assert_allclose(found.leads / 3600.0, hours)
    for points, flow, hour in zip(found.points, found.winds, hours, strict=True):
        assert points[:, 1].max() <= 42.0  # no current on land
        np.testing.assert_allclose(flow, current(points, hour), atol=1e-4)
    assert found.level == "0m depth"
    messages = sum(file.read_bytes().count(b"GRIB") for file in found.files)
    assert messages == 2 * 48  # temperature and mean flow are not cached


def test_a_region_of_rtofs_is_chosen_by_the_map():
    for west, south, region in (
        (-74.0, 38.0, "west_atl"),
        (-125.0, 36.0, "west_conus"),
        (145.0, 13.0, "guam"),
    ):
        here = Wanted(GeoBox(west, south, 4.0, south + 3.0), COAST.start)
        with serving(NoaaServer({})) as server, pytest.raises(DataError, match=f"f024_{region}_std.grb2"):
            live.live_files(cfg(server, "rtofs", level="0m", cycle="2026-06-01T00:00:00Z"), here)


# --- faults -----------------------------------------------------------------------------------


def refusal(function, kind=DataError):
    with pytest.raises(kind) as caught:
        function()
    text = str(caught.value)
    assert "\n" not in text
    assert len(text) < 600
    return text


def test_a_forecast_that_is_not_there_names_the_newest_file_that_was_asked_for():
    with serving(NoaaServer({})) as server:
        text = refusal(lambda: live.live_files(cfg(server, "ifs"), OZARKS))
    assert "no cycle of ifs that covers 2026-06-01T07:30:00Z .. 2026-06-01T09:30:00Z is available" in text
    assert "(9 were asked for; of 2026-06-01T06:00:00Z, " in text
    assert "/20260601/06z/ifs/0p25/oper/20260601060000-6h-oper-fc.index is not there (status 404" in text
    assert "wind.base_url=https://ecmwf-forecasts.s3.eu-central-1.amazonaws.com" in text


@pytest.mark.parametrize(
    ("source", "archive", "level", "words"),
    [
        ("nbm", lambda: nbm(CYCLE, range(1, 5)), "100m",
         "lists no wind 100 m above ground; it has 10m, 80m: set"),
        ("aigfs", lambda: aigfs(CYCLE, [0, 6]), "80m",
         "sfc.f006.grib2.idx lists no wind 80 m .* it has 10m: set"),
        ("aigfs", lambda: aigfs(CYCLE, [0, 6]), "700hPa", "no wind at 700 hPa; it has 850hPa, 925hPa"),
        ("ifs", lambda: ecmwf(CYCLE, [0, 3, 6], "ifs", "oper", "fc"), "80m",
         "oper-fc.index lists no wind 80 m above ground; it has 10m, 100m, 925hPa: set wind.level to one"),
    ],
)  # fmt: skip
def test_an_inventory_without_the_level_says_what_it_has(source, archive, level, words):
    with serving(NoaaServer(archive())) as server:
        text = refusal(lambda: live.live_files(cfg(server, source, level=level), OZARKS))
    assert re.search(words, text), text


def test_a_member_that_the_index_lacks_is_named():
    archive = ecmwf(CYCLE, [0, 3, 6], "ifs", "oper", "fc")
    archive |= ecmwf(CYCLE, [0, 3, 6], "ifs", "enfo", "ef", members=(1, 3))
    with serving(NoaaServer(archive)) as server:
        text = refusal(lambda: live.live_files(cfg(server, "ifs", members=3), OZARKS))
    assert "enfo-ef.index lists no wind 10 m above ground of member 2" in text


GOOD = b'{"type": "fc", "levtype": "sfc", "param": "10u", "_offset": 0, "_length": 9}\n'


@pytest.mark.parametrize(
    "line",
    [
        b"1:0:d=2026060106:UGRD:10 m above ground:6 hour fcst:", b'{"param": "10v"', b"[1, 2]", b"null", b"7",
        b'{"levtype": "sfc", "_offset": 0, "_length": 9}', b'{"param": "10v", "_offset": 0, "_length": 9}',
        b'{"param": "10v", "levtype": "sfc", "_offset": "0", "_length": 9}',
        b'{"param": "10v", "levtype": "sfc", "_offset": 0.5, "_length": 9}',
        b'{"param": "10v", "levtype": "sfc", "_offset": -1, "_length": 9}',
        b'{"param": "10v", "levtype": "sfc", "_offset": true, "_length": 9}',
        b'{"param": "10v", "levtype": "sfc", "_offset": 9, "_length": 0}',
        b'{"param": "10v", "levtype": "sfc", "_offset": 9, "_length": 99999999999999}',
        b'{"param": "10v", "levtype": "sfc", "number": "one", "_offset": 9, "_length": 9}',
        b'{"param": "u", "levtype": "pl", "_offset": 9, "_length": 9}',
        b"[" * 99_999,
    ],
)  # fmt: skip
def test_a_line_that_is_none_of_an_index_is_refused_with_its_number(line):
    text = refusal(lambda: parse_inventory((GOOD + line).decode(), "a.index"))
    assert text.startswith("a.index, line 2: ")
    assert 'expected {"param": "10u", "levtype": "sfc", ..., "_offset": 0, "_length": 9}' in text


def test_spread_and_mean_of_an_ensemble_are_no_wind():
    lines = [
        {"type": kind, "levtype": "sfc", "param": param, "_offset": offset, "_length": 9}
        for offset, (kind, param) in enumerate(
            (kind, param) for kind in ("em", "es") for param in ("10u", "10v")
        )
    ]
    entries = parse_inventory("\n".join(map(json.dumps, lines)), "a.index")
    assert "lists no wind 10 m above ground; it has no wind" in refusal(
        lambda: wind_parts(entries, parse_level("10m"), "a.index")
    )


@pytest.mark.parametrize(
    ("source", "fault", "words"),
    [
        ("nbm", "whole", "the server ignores byte ranges"),
        ("ifs", "whole", "the server ignores byte ranges"),
        ("ifs", "drop", "cannot be fetched"),
        ("rtofs", "drop", "cannot be fetched"),
        ("rtofs", "html", "holds no current; try again later"),
    ],
)
def test_faults_of_a_server_are_one_line_and_leave_nothing(source, fault, words, tmp_path):
    archive = {
        "nbm": lambda: nbm(CYCLE, range(1, 5), [10]),
        "ifs": lambda: ecmwf(CYCLE, [0, 3, 6], "ifs", "oper", "fc"),
        "rtofs": lambda: rtofs("2026060100", [24]),
    }[source]()
    server = NoaaServer(archive, lambda path, count: fault if path[-4:] in ("rib2", "grb2") else None)
    with serving(server):
        level = "0m" if source == "rtofs" else "10m"
        text = refusal(lambda: live.live_files(cfg(server, source, level=level), COAST))
    assert words in text
    assert list((tmp_path / "cache" / "noaa").glob("*")) == []


def test_a_download_that_breaks_off_goes_on_where_it_ended():
    archive = rtofs("2026060100", [24])
    with serving(NoaaServer(archive, lambda path, count: "cut" if count == 1 else None)) as server:
        found = read_readings(cfg(server, "rtofs", level="0m"), COAST)
        first, second = (told for _, told in server.ranges)
    assert first == "bytes=0-"
    assert second.endswith("-")
    assert int(second.removeprefix("bytes=")[:-1]) > 0
    np.testing.assert_allclose(found.winds[0], current(found.points[0], 7), atol=1e-4)


def test_a_file_of_rtofs_that_is_damaged_is_refused():
    ((path, data),) = rtofs("2026060100", [24]).items()
    with serving(NoaaServer({path: data[:-100]})) as server:
        text = refusal(lambda: live.live_files(cfg(server, "rtofs", level="0m"), COAST))
    assert "is damaged or truncated" in text


@pytest.mark.parametrize(
    ("settings", "wanted", "words"),
    [
        ({"source": "rtofs", "level": "100m depth"}, COAST,
         "has the current at the surface only.*set wind.level=0m"),
        ({"source": "rtofs", "level": "925hPa"}, COAST, "is a pressure; currents are at depths"),
        ({"source": "rtofs", "level": "0m"}, Wanted(GeoBox(5.0, 40.0, 3.0, 43.0), COAST.start),
         "has the regions west_atl, .*; none contains the map: for other seas, set wind=currents"),
        ({"source": "rtofs", "level": "0m"}, Wanted(None, COAST.start), "a map with places on Earth chooses"),
        ({"source": "nbm"}, Wanted(GeoBox(5.0, 40.0, 3.0, 43.0), COAST.start),
         "nbm covers latitude 19.2..57.1, .*; the scene needs .*: use wind=noaa"),
        ({"source": "nbm", "members": 2}, OZARKS, "wind.members=2: nbm has no ensemble: set wind.members=1"),
        ({"source": "aigefs", "members": 40}, OZARKS, "wind.members=40: aigefs has 31 members"),
        ({"source": "ifs", "members": 52}, OZARKS, "wind.members"),
        ({"source": "nbm", "model": "hrrr"}, OZARKS, "wind.model=hrrr is of wind=noaa"),
        ({"source": "nbm", "cycle": "2026-06-01T06:30:00Z"}, OZARKS, "is not a start of a nbm forecast"),
    ],
)  # fmt: skip
def test_what_a_model_does_not_have_is_refused_before_a_download(settings, wanted, words):
    with serving(NoaaServer({})) as server, pytest.raises((ConfigError, DataError), match=words) as caught:
        live.live_files(cfg(server, **settings), wanted)
    assert "\n" not in str(caught.value)
    assert not server.asked


def test_the_former_name_of_members_still_counts(caplog):
    archive = {
        f"gefs.20260601/06/atmos/pgrb2sp25/ge{run}.t06z.pgrb2s.0p25.f{hour:03d}{end}": b""
        for run in ("c00", "p01") for hour in (0, 3) for end in ("", ".idx")
    }  # fmt: skip
    with serving(NoaaServer(archive)) as server:
        config = WindConfig(source="noaa", model="gefs", gefs_members=2, base_url=server.address, hours=1.0)
        refusal(lambda: live.live_files(config, OZARKS))  # the inventories are empty
    assert "wind.gefs_members is now wind.members" in caplog.text


def test_requests_to_nomads_are_spread_and_those_to_a_mirror_are_not(monkeypatch):
    slept, asked = [], []
    monkeypatch.setattr(live.time, "sleep", slept.append)
    monkeypatch.setattr(live, "fetch_bytes", lambda url, *_: asked.append(url) or b"")
    for base in (None, "http://127.0.0.1:9"):
        config = WindConfig(source="aigfs", base_url=base, hours=2.0)
        refusal(lambda config=config: live.live_files(config, OZARKS))
    assert [url.split("/")[2] for url in asked] == ["nomads.ncep.noaa.gov", "127.0.0.1:9"]
    assert len(slept) == 1


def test_a_current_is_water_and_has_a_depth():
    settings = Settings.of({"wind": "rtofs"})
    assert settings.wind.level == "0m"
    assert settings.medium.flow == "current"
    assert (settings.wind.max_speed, settings.wind.noise_min) == (5.0, 0.05)
