"""Live winds of NOAA, from a local server: cycles, parts, the cache, and every fault of the way."""

from __future__ import annotations

import json
import os
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from careful_io.times import iso, seconds
from flight_quantities.levels import parse_level
from noaa import NOAA, needs_noaa
from noaa_server import NoaaServer, downloads_at, fake_message, inventory, serving
from pareto_ltl.settings import WindConfig
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl.wind.area import ALL_WIND, GeoBox, Wanted
from pareto_ltl.wind.sources import read_readings
from pareto_ltl_apps.formats import download_cache, live
from pareto_ltl_apps.formats.inventories import parse_inventory, wind_parts
from pareto_ltl_apps.formats.live_models import MODELS

CYCLE = seconds("2018-10-09T06:00:00Z")
START = Wanted(start="2018-10-09T06:30:00Z")
GROUND = "10 m above ground"


@pytest.fixture(autouse=True)
def fresh(monkeypatch, tmp_path):
    downloads_at("2018-10-09T08:00:00Z", monkeypatch, tmp_path)


def path_of(cycle, step, model="gfs", member=0):
    level = parse_level("10m")
    return MODELS[model].downloads("x", cycle, step, level, member + 1, "")[member].url.removeprefix("x/")


def archive(cycles=(CYCLE,), steps=range(4), model="gfs"):
    """Files of three messages, of which the last two are the wind 10 m above ground."""
    files = {}
    for cycle in cycles:
        for step in steps:
            told = f"{model} {iso(cycle)} {step} ".encode()
            fields = [
                ("TMP", "2 m above ground", f"{step} hour fcst", fake_message(told + b"T" * 99)),
                ("UGRD", GROUND, f"{step} hour fcst", fake_message(told + b"U" * 50)),
                ("VGRD", GROUND, f"{step} hour fcst", fake_message(told + b"V" * 70)),
            ]
            path = path_of(cycle, step, model)
            files[path], files[f"{path}.idx"] = inventory(fields)
    return files


def cfg(server, **more):
    return WindConfig(source="noaa", base_url=server.address, **{"hours": 2.0, "retries": 1} | more)


def test_only_the_messages_of_the_wind_are_fetched():
    with serving(NoaaServer(archive())) as server:
        files = live.live_files(cfg(server), START)
        asked = [told for path, told in server.ranges if not path.endswith(".idx")]
    assert [file.name.split(".")[4] for file in files] == ["f000", "f001", "f002", "f003"]
    for step, file in enumerate(files):
        data = file.read_bytes()
        assert data.count(b"GRIB") == 2
        assert f"gfs 2018-10-09T06:00:00Z {step} UUU".encode() in data
        assert b"TTT" not in data
    assert all(told.startswith("bytes=") for told in asked)
    assert len(asked) == 4  # the messages of u and v are neighbours


def test_a_second_run_fetches_nothing_and_works_without_a_network(monkeypatch):
    with serving(NoaaServer(archive())) as server:
        first = live.live_files(cfg(server), START)
        count = sum(server.asked.values())
        monkeypatch.setattr(live, "_FETCHED", {})
        assert live.live_files(cfg(server), START) == first
        assert sum(server.asked.values()) == count
    monkeypatch.setattr(live, "_FETCHED", {})
    assert live.live_files(cfg(server, offline=True), START) == first
    monkeypatch.setattr(live, "_FETCHED", {})
    with pytest.raises(DataError, match=r"wind.offline=true, and no cycle of gfs that covers .* was fetched"):
        live.live_files(cfg(server, offline=True, hours=9.0), START)


def test_the_newest_cycle_that_is_there_and_covers_the_flight_counts():
    old, new = CYCLE - 6 * 3600, CYCLE
    with serving(NoaaServer(archive((old,), range(12)) | archive((new,), range(2)))) as server:
        files = live.live_files(cfg(server), START)  # the new cycle has not come to its step 3 yet
    assert [file.name.split(".")[1] + file.name.split(".")[4] for file in files] == [
        "t00zf006", "t00zf007", "t00zf008", "t00zf009"
    ]  # fmt: skip


def test_a_departure_to_come_needs_a_cycle_that_has_begun():
    with serving(NoaaServer(archive(steps=range(40)))) as server:
        files = live.live_files(cfg(server), Wanted(start="2018-10-10T06:00:00Z"))
    assert [file.name.split(".")[4] for file in files] == ["f024", "f025", "f026"]


def test_a_cycle_may_be_named_and_one_that_is_none_is_refused():
    with serving(NoaaServer(archive((CYCLE - 6 * 3600, CYCLE), range(12)))) as server:
        files = live.live_files(cfg(server, cycle="2018-10-09T00:00:00Z"), START)
        assert files[0].name.startswith("gfs.t00z.pgrb2.0p25.f006")
        with pytest.raises(
            ConfigError, match=r"wind.cycle=2018-10-09T05:00:00Z is not a start of a gfs forecast"
        ):
            live.live_files(cfg(server, cycle="2018-10-09T05:00:00Z"), START)
        with pytest.raises(
            DataError, match=r"the cycle 2018-10-09T12:00:00Z of gfs does not cover 2018-10-09T06:30"
        ):
            live.live_files(cfg(server, cycle="2018-10-09T12:00:00Z"), START)


def test_hrrr_serves_its_area_and_its_long_cycles():
    there = Wanted(GeoBox(-100.0, 30.0, 10.0, 45.0), START.start)
    with serving(NoaaServer(archive(steps=range(49), model="hrrr"))) as server:
        files = live.live_files(cfg(server, model="hrrr", hours=30.0), there)
        assert len(files) == 32
        assert server.asked[path_of(CYCLE, 31, "hrrr")] == 1
        elsewhere = Wanted(GeoBox(5.0, 55.0, 5.0, 60.0), START.start)
        with pytest.raises(
            ConfigError, match=r"hrrr covers latitude 21.1..52.7, .*; the scene needs .*wind.model=gfs"
        ):
            live.live_files(cfg(server, model="hrrr"), elsewhere)


def test_members_of_gefs_are_fetched_each():
    files = {}
    for member in range(3):
        for step in (0, 3):
            name = path_of(CYCLE, step, "gefs", member)
            fields = [
                (v, GROUND, "anl", fake_message(f"{v} {member} {step}".encode())) for v in ("UGRD", "VGRD")
            ]
            files[name], files[f"{name}.idx"] = inventory(fields)
    with serving(NoaaServer(files)) as server:
        found = live.live_files(cfg(server, model="gefs", gefs_members=3), START)
    assert sorted({file.name[:5] for file in found}) == ["gec00", "gep01", "gep02"]
    assert len(found) == 6


# --- faults of the way


@pytest.mark.parametrize("fault", ["slow", "cut", "drop", 503])
def test_a_fault_that_passes_changes_nothing(fault):
    with serving(NoaaServer(archive(), lambda path, count: fault if count == 1 else None)) as server:
        files = live.live_files(cfg(server), START)
    assert [file.read_bytes().count(b"7777") for file in files] == [2] * 4


@pytest.mark.parametrize(
    ("name", "fault", "words"),
    [
        (".idx", 404, r"no cycle of gfs that covers .* is available \(.*\.idx is not there \(status 404"),
        (".idx", 403, r"no cycle of gfs that covers .* is available \(.*\.idx is not there \(status 403"),
        (".idx", "html", r"\.idx is a web page, not an inventory"),
        (".idx", "drop", r"cannot be fetched"),
        ("", "html", r"the server sends other bytes|are no whole GRIB message|cannot be fetched"),
        ("", "whole", r"the server ignores byte ranges .*expected 206.*wind.base_url"),
        ("", "cut", None),
        ("", "drop", r"cannot be fetched \(.*\); try again later"),
    ],
)
def test_a_fault_that_stays_is_one_line_and_leaves_nothing_half_written(name, fault, words, tmp_path):
    def fails(path, count):
        return fault if path.endswith(".idx") == (name == ".idx") else None

    with serving(NoaaServer(archive(), fails)) as server:
        if words is None:  # each answer brings half of what is missing: that is progress
            assert len(live.live_files(cfg(server), START)) == 4
            return
        with pytest.raises(DataError, match=words) as caught:
            live.live_files(cfg(server), START)
    assert "\n" not in str(caught.value)
    assert [file.name for file in (tmp_path / "cache" / "noaa").glob("*")] == []


def test_an_inventory_of_another_file_is_noticed():
    files = archive()
    files[path_of(CYCLE, 2)] = b"x" * 10 + files[path_of(CYCLE, 2)]
    words = "are no whole GRIB message; the inventory is of another file"
    with serving(NoaaServer(files)) as server, pytest.raises(DataError, match=words):
        live.live_files(cfg(server), START)


def test_a_damaged_file_of_the_cache_is_fetched_again(monkeypatch, caplog):
    with serving(NoaaServer(archive())) as server:
        files = live.live_files(cfg(server), START)
        whole = files[1].read_bytes()
        files[1].write_bytes(whole[:-5] + b"x7777")
        monkeypatch.setattr(live, "_FETCHED", {})
        assert live.live_files(cfg(server), START)[1].read_bytes() == whole
    assert "is damaged and is fetched again" in caplog.text


@pytest.mark.skipif(os.name == "nt", reason="modes of folders")
def test_a_cache_that_others_may_write_is_not_used(tmp_path, caplog):
    shared = tmp_path / "cache" / "noaa"
    shared.mkdir(parents=True)
    shared.chmod(0o777)
    with serving(NoaaServer(archive())) as server:
        files = live.live_files(cfg(server), START)
    assert len(files) == 4
    assert all(file.read_bytes() and shared not in file.parents for file in files)
    assert list(shared.iterdir()) == []
    assert "downloads are not stored in" in caplog.text


def test_a_full_cache_is_left_for_a_folder_of_the_run(monkeypatch, tmp_path, caplog):
    plain = download_cache.write_bytes

    def full(path: Path, data: bytes) -> None:
        if tmp_path in path.parents:
            raise OSError(28, "No space left on device", str(path))
        plain(path, data)

    monkeypatch.setattr(download_cache, "write_bytes", full)
    with serving(NoaaServer(archive())) as server:
        assert all(file.read_bytes() for file in live.live_files(cfg(server), START))
    assert "No space left on device" in caplog.text


def test_the_cache_keeps_within_its_limit(monkeypatch, tmp_path):
    with serving(NoaaServer(archive((CYCLE, CYCLE - 6 * 3600), range(12)))) as server:
        live.live_files(cfg(server, cycle="2018-10-09T00:00:00Z"), START)
        monkeypatch.setenv("PARETO_LTL_CACHE_MIB", "0")
        files = live.live_files(cfg(server, cycle="2018-10-09T06:00:00Z"), START)
    assert all(file.is_file() for file in files)
    assert sorted((tmp_path / "cache" / "noaa").glob("*.grib2")) == sorted(files)


# --- inventories


@needs_noaa
@pytest.mark.parametrize(
    ("name", "level", "first", "last"),  # of u and v, which are neighbours
    [
        ("gfs.t00z.pgrb2.0p25.f021.idx", "10m", 428_651_621, 430_565_443),
        ("gfs.t00z.pgrb2.0p25.f021.idx", "80m", 501_626_189, 503_574_512),
        ("hrrr.t01z.wrfsfcf05.grib2.idx", "10m", 52_586_717, 57_111_803),
        ("hrrr.t01z.wrfsubhf09.grib2.idx", "10m", 15_132_671, 19_895_900),
    ],
)
def test_real_inventories_tell_where_the_wind_is(name, level, first, last):
    entries = parse_inventory((NOAA / "idx" / name).read_text(), name)
    (part,) = wind_parts(entries, parse_level(level), name)
    assert (part.first, part.last) == (first, last)


@needs_noaa
def test_a_level_that_an_inventory_lacks_is_refused_with_those_it_has():
    name = "hrrr.t01z.wrfsfcf05.grib2.idx"
    entries = parse_inventory((NOAA / "idx" / name).read_text(), name)
    with pytest.raises(
        DataError, match=r"lists no wind 100 m above ground; it has 10m, 80m, .*: set wind.level"
    ):
        wind_parts(entries, parse_level("100m"), name)
    gfs = parse_inventory((NOAA / "idx" / "gfs.t00z.pgrb2.0p25.f021.idx").read_text(), "gfs")
    assert len(wind_parts(gfs, parse_level("925hPa"), "gfs")) == 2  # with the surface pressure


def test_components_in_one_message_are_fetched_once_and_averages_are_passed_over():
    text = (
        "1:0:d=2023110401:UGRD:10 m above ground:0-5 min ave fcst:\n"
        "2.1:500:d=2023110401:UGRD:10 m above ground:5 hour fcst:\n"
        "2.2:500:d=2023110401:VGRD:10 m above ground:5 hour fcst:\n"
        "3:900:d=2023110401:TMP:surface:5 hour fcst:ENS=+1\n"
    )
    (part,) = wind_parts(parse_inventory(text, "idx"), parse_level("10m"), "idx")
    assert (part.first, part.last) == (500, 899)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "idx is empty; the file is not whole yet"),
        ("<!DOCTYPE html>", "is a web page, not an inventory"),
        ("1:0:nonsense", "idx, line 1: '1:0:nonsense' is not a line of an inventory"),
        ("1:0:d=2018100900:UGRD:10 m above ground:anl:\n2:x", "line 2"),
        ("1:9:d=2018100900:A:b:anl:\n2:3:d=2018100900:A:b:anl:", "offsets do not increase"),
        ("1:" + "9" * 4000 + ":d=2018100900:A:b:anl:", "line 1"),
    ],
)
def test_what_is_no_inventory_is_refused(text, words):
    with pytest.raises(DataError, match=words) as caught:
        parse_inventory(text, "idx")
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 300


NOMADS = "https://nomads.ncep.noaa.gov/pub/data/nccf/com"
ECMWF = "https://data.ecmwf.int/forecasts/20231104/06z"


@pytest.mark.parametrize(
    ("model", "step", "members", "level", "addresses"),
    [
        ("gfs", 21, 1, "10m", [
            "https://noaa-gfs-bdp-pds.s3.amazonaws.com/gfs.20231104/06/atmos/gfs.t06z.pgrb2.0p25.f021"]),
        ("hrrr", 5, 1, "10m", [
            "https://noaa-hrrr-bdp-pds.s3.amazonaws.com/hrrr.20231104/conus/hrrr.t06z.wrfsfcf05.grib2"]),
        ("gefs", 3, 2, "10m", [
            f"https://noaa-gefs-pds.s3.amazonaws.com/gefs.20231104/06/atmos/pgrb2sp25/{run}.t06z.pgrb2s.0p25.f003"
            for run in ("gec00", "gep01")]),
        ("nbm", 7, 1, "80m", [
            "https://noaa-nbm-grib2-pds.s3.amazonaws.com/blend.20231104/06/core/blend.t06z.core.f007.co.grib2"]),
        ("aigfs", 6, 1, "10m", [
            f"{NOMADS}/aigfs/prod/aigfs.20231104/06/model/atmos/grib2/aigfs.t06z.sfc.f006.grib2"]),
        ("aigfs", 6, 1, "925hPa", [
            f"{NOMADS}/aigfs/prod/aigfs.20231104/06/model/atmos/grib2/aigfs.t06z.pres.f006.grib2"]),
        ("aigefs", 12, 31, "10m", [
            f"{NOMADS}/aigefs/prod/aigefs.20231104/06/mem{member:03d}/model/atmos/grib2/aigefs.t06z.sfc.f012.grib2"
            for member in range(31)]),
        ("rtofs", 25, 1, "0m", [f"{NOMADS}/rtofs/prod/rtofs.20231104/rtofs_glo.t00z.f048_west_atl_std.grb2"]),
        ("rtofs", 75, 1, "0m", [f"{NOMADS}/rtofs/prod/rtofs.20231104/rtofs_glo.t00z.f144_west_atl_std.grb2"]),
        ("ifs", 24, 1, "10m", [f"{ECMWF}/ifs/0p25/oper/20231104060000-24h-oper-fc.grib2"]),
        ("ifs", 24, 51, "10m", [
            f"{ECMWF}/ifs/0p25/oper/20231104060000-24h-oper-fc.grib2",
            f"{ECMWF}/ifs/0p25/enfo/20231104060000-24h-enfo-ef.grib2"]),
        ("aifs", 6, 1, "10m", [f"{ECMWF}/aifs-single/0p25/oper/20231104060000-6h-oper-fc.grib2"]),
        ("aifs", 6, 2, "10m", [
            f"{ECMWF}/aifs-ens/0p25/enfo/20231104060000-6h-enfo-cf.grib2",
            f"{ECMWF}/aifs-ens/0p25/enfo/20231104060000-6h-enfo-pf.grib2"]),
    ],
)  # fmt: skip
def test_addresses_are_those_of_the_archives(model, step, members, level, addresses):
    cycle = datetime(2023, 11, 4, 6, tzinfo=UTC).timestamp()
    found = MODELS[model].downloads(None, cycle, step, parse_level(level), members, "west_atl")
    assert [download.url for download in found] == addresses
    mirrored = MODELS[model].downloads("http://x/", cycle, step, parse_level(level), members, "west_atl")
    assert [d.url.removeprefix("http://x") for d in mirrored] == [
        url.removeprefix(MODELS[model].base) for url in addresses
    ]


def test_steps_reach_around_the_flight():
    gfs, hrrr = MODELS["gfs"], MODELS["hrrr"]
    hour = 3600.0
    assert gfs.steps_between(CYCLE, CYCLE + 1.5 * hour, CYCLE + 3.2 * hour) == (1, 2, 3, 4)
    assert gfs.steps_between(CYCLE, CYCLE + 119 * hour, CYCLE + 124 * hour) == (119, 120, 123, 126)
    assert gfs.steps_between(CYCLE, CYCLE - 1, CYCLE + hour) == ()
    assert hrrr.steps_between(CYCLE, CYCLE, CYCLE + 48 * hour)[-1] == 48
    assert hrrr.steps_between(CYCLE + hour, CYCLE + hour, CYCLE + 20 * hour) == ()


@pytest.mark.parametrize(
    ("model", "cycle", "first", "last", "steps"),
    [
        ("nbm", 1, 0.5, 3.0, ()),  # the blend has no hour 0
        ("nbm", 1, 34.5, 41.0, (34, 35, 36, 39, 42)),
        ("nbm", 1, 190.0, 200.0, (189, 192, 198, 204)),
        ("aigfs", 6, 1.0, 13.0, (0, 6, 12, 18)),
        ("ifs", 0, 143.0, 151.0, (141, 144, 150, 156)),
        ("ifs", 6, 143.0, 151.0, ()),
        ("aifs", 18, 355.0, 360.0, (354, 360)),
        ("rtofs", 0, 23.5, 25.0, (23, 24, 25)),
        ("rtofs", 0, 70.0, 76.0, (70, 71, 72, 75, 78)),
    ],
)
def test_steps_are_those_of_each_model(model, cycle, first, last, steps):
    began = seconds(f"2026-06-01T{cycle:02d}:00:00Z")
    found = MODELS[model].steps_between(began, began + 3600 * first, began + 3600 * last)
    assert found == steps


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"base_url": "file:///data"}, "wind.base_url must begin with https"),
        ({"cycle": "latest"}, "wind.cycle"),
        ({"model": "ecmwf"}, "wind.model"),
    ],
)
def test_a_wrong_setting_is_refused(settings, words):
    with pytest.raises(ConfigError, match=words):
        WindConfig(source="noaa", **settings)


# --- the whole way, with real fields


def real_fields(eccodes, shift=0.0, **settings):
    """The 10 m wind of a GFS analysis, with other settings and ``shift`` m/s more."""
    found = []
    with (NOAA / "gfs_1p00_10m" / "gfs.t00z.pgrb2.1p00.f000.2018100906").open("rb") as stream:
        while (handle := eccodes.codes_grib_new_from_file(stream)) is not None:
            name = {"10u": "UGRD", "10v": "VGRD"}[eccodes.codes_get(handle, "shortName")]
            for key, value in settings.items():
                eccodes.codes_set(handle, key, value)
            if shift:
                eccodes.codes_set_values(handle, eccodes.codes_get_values(handle) + shift)
            found.append((name, GROUND, "anl", eccodes.codes_get_message(handle)))
            eccodes.codes_release(handle)
    return found


@needs_noaa
def test_several_members_of_gefs_are_an_ensemble():
    eccodes = pytest.importorskip("eccodes")
    files = {}
    for member in range(3):
        for step in (0, 3):
            told = {"productDefinitionTemplateNumber": 1, "perturbationNumber": member, "forecastTime": step}
            path = path_of(CYCLE, step, "gefs", member)
            files[path], files[f"{path}.idx"] = inventory(real_fields(eccodes, float(member), **told))
    place = Wanted(GeoBox(-100.0, 30.0, 10.0, 40.0), START.start)
    with serving(NoaaServer(files)) as server:
        control = read_readings(cfg(server, model="gefs"), place)
        every = read_readings(cfg(server, model="gefs", gefs_members=3), place)
    np.testing.assert_array_equal(every.points[0], control.points[0])
    np.testing.assert_allclose(every.winds[0], control.winds[0] + 1.0, atol=0.02)


@needs_noaa
def test_readings_of_a_real_field_come_with_their_leads(tmp_path):
    eccodes = pytest.importorskip("eccodes")
    files = {}
    for step in range(4):
        path = path_of(CYCLE, step)
        files[path], files[f"{path}.idx"] = inventory(real_fields(eccodes, forecastTime=step))
    with serving(NoaaServer(files)) as server:
        found = read_readings(cfg(server), START)
        cropped = read_readings(cfg(server), Wanted(GeoBox(-100.0, 30.0, 10.0, 40.0), START.start))
    np.testing.assert_array_equal(found.leads / 3600, range(4))
    assert found.first_time == "2018-10-09T06:00:00Z"
    assert len(found.points[0]) == 360 * 181
    assert len(cropped.points[0]) == 11 * 11
    assert found.notes[0] == (
        "gfs forecast of 2018-10-09T06:00:00Z; wind.cycle=2018-10-09T06:00:00Z reads the same one again"
    )
    told = json.loads(next((tmp_path / "cache" / "noaa").glob("*.json")).read_text())
    assert told["url"].startswith(server.address)
    assert live.live_files(cfg(server), START) == found.files
    assert ALL_WIND.start is None
