"""What arrives in flight and at the desk: telemetry, logs of autopilots, journals, maps below, requests."""

from __future__ import annotations

import gzip
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np

from fuzz import corpora
from fuzz.kinds import from_file
from fuzz.mutations import json_bytes, mutants, tree_mutants
from fuzz.records import Fuzz, Target

DEPARTURE = "2018-10-09T00:00:00Z"
TELEMETRY = (
    b"time,heading_true,airspeed_tas_m_s,lat,lon,fix_sd_m\n0,59.7,21.0,,,\n1,60.2,21.3,37.1,-94.5,25\n",
    b"time,heading_true,airspeed_cas_m_s\n2018-10-09T00:00:01Z,59.7,20.1\n2018-10-09T00:00:02Z,60,20\n",
)
JOURNAL = (
    {"event": "flown", "time": 12.0, "seconds": 1.0, "east": 20.0, "north": 3.0},
    {"event": "alarm", "time": 13.0, "kind": "fix", "text": "5 sd off", "advice": "look"},
)
REQUESTS = (
    {"command": "plan", "formula": "F a", "settings": {"robot.u_max": 25, "planner": "quick"},
     "map": corpora.GEOJSON},
    {"overrides": ["seed=3", "wind=calm"], "formula": "F(a & F b)", "settings": {"scene.file": "maps/a.kml"}},
)  # fmt: skip


def telemetry(place: Path) -> Fuzz:
    from pareto_ltl_apps.flight.telemetry import Sieve, read_log

    def read(path: Path) -> object:
        return list(Sieve(30.0).usable(read_log(path, DEPARTURE, on_earth=True)))

    return Fuzz(mutants(TELEMETRY), from_file(place / "telemetry.csv", read))


def autopilot_logs(place: Path) -> Fuzz:
    from pymavlink.dialects.v20 import common as mavlink

    from pareto_ltl_apps.flight.link import logged_readings

    mav, data = mavlink.MAVLink(None, srcSystem=1, srcComponent=1), b""
    for second in range(4):
        for message in (
            mavlink.MAVLink_heartbeat_message(1, 3, 128, 15, 4, 3),
            mavlink.MAVLink_attitude_message(1000 * second, 0.0, 0.0, 0.5, 0.0, 0.0, 0.0),
            mavlink.MAVLink_vfr_hud_message(21.0, 25.0, 30, 50, 100.0, 0.0),
        ):
            data += struct.pack(">Q", (1_539_000_000 + second) * 10**6) + message.pack(mav)
    return Fuzz(
        mutants([data]),
        from_file(place / "flight.tlog", lambda path: list(logged_readings(path, None, "now"))),
    )


def journals(place: Path) -> Fuzz:
    from pareto_ltl_apps.flight.journal import damaged_end, read_journal

    seed = b"".join(json.dumps(event).encode() + b"\n" for event in JOURNAL)
    return Fuzz(
        mutants([seed]),
        from_file(place / "follow.jsonl", lambda path: (damaged_end(path), list(read_journal(path)))),
    )


def _below(place: Path, name: str, seeds: list[bytes]) -> Fuzz:
    """A file of maps below a drawing, as the desk keeps and shows it."""
    from pareto_ltl_apps.desk.backdrop import backdrop
    from pareto_ltl_apps.desk.folder import MAPS, DeskFolder

    folder = DeskFolder.opened(place)
    (place / MAPS).mkdir(exist_ok=True)
    return Fuzz(mutants(seeds), from_file(place / MAPS / name, lambda _: backdrop(folder, name)))


def backdrops(place: Path) -> Fuzz:
    return _below(place, "below.geojson", [json_bytes(corpora.GEOJSON)])


def geotiffs(place: Path) -> Fuzz:
    from geotiffs import UTM, WGS84, geotiff

    values = np.arange(300, dtype=np.uint8).reshape(10, 10, 3)
    return _below(
        place,
        "below.tif",
        [geotiff(values, UTM, (2e5, 4.6e6), 500.0), geotiff(values[..., 0], WGS84, (-95.0, 38.0), 0.01, 0.0)],
    )


def pmtiles(place: Path) -> Fuzz:
    from mapbox_vector_tile import encode
    from pmtiles.tile import Compression, TileType, zxy_to_tileid
    from pmtiles.writer import Writer

    area = {"geometry": "POLYGON ((100 100, 900 100, 900 900, 100 100))", "properties": {"name": "lake"}}
    tile = gzip.compress(encode({"name": "land", "features": [area]}), mtime=0)
    seed = place / "seed.pmtiles"
    with seed.open("wb") as file:
        writer = Writer(file)
        writer.write_tile(zxy_to_tileid(1, 0, 0), tile)
        header = {"tile_type": TileType.MVT, "tile_compression": Compression.GZIP, "min_lon_e7": -(10**9),
                  "min_lat_e7": 0, "max_lon_e7": -(10**8), "max_lat_e7": 8 * 10**8}  # fmt: skip
        writer.finalize(header, {})
    return _below(place, "below.pmtiles", [seed.read_bytes()])


def requests(place: Path) -> Fuzz:
    """Bodies of ``POST /api/plans``."""
    from careful_io.reading import parse_json
    from pareto_ltl_apps.desk.folder import DeskFolder
    from pareto_ltl_apps.desk.missions import command_words

    folder = DeskFolder.opened(place)

    def read(case: bytes) -> object:
        body: Any = parse_json(case, "the body of the request")
        return command_words(folder, body) if isinstance(body, dict) else None

    return Fuzz(tree_mutants(list(REQUESTS), json_bytes), read)


ARRIVING = (
    Target("telemetry", telemetry),
    Target("autopilot_logs", autopilot_logs, share=0.3),  # pymavlink takes 5 ms to open a log
    Target("journals", journals),
    Target("backdrops", backdrops),
    Target("geotiffs", geotiffs, share=0.3),
    Target("pmtiles", pmtiles, share=0.3),
    Target("requests", requests, share=0.3),  # each map is kept in a file
)
