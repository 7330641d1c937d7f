"""Make the data of the benchmark again: ``python -m published.make GRIB_FOLDER`` in ``benchmarks``.

GRIB_FOLDER has GFS files of one degree: analyses (f000) and forecasts for 3 h (f003) of the cycles of 9, 10,
14 and 15 October 2018, with the date of the cycle at the end of each name, as ``...2018100906f3``.

Random missions all over the Earth are drawn one after the other, and planned by this planner from what was
known; those are taken whose plan promises between 1 and 20 %, at most ``EACH`` of a situation, until there
are ``COUNT``. A situation is a box of 12 x 24 degrees in a span of two days. The plans of this planner, and
those of three simpler ones, are written to ``plans``.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import shutil
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from careful_io.times import HOUR, iso, seconds
from pareto_ltl import Readings, Scene
from pareto_ltl.extend import Snapshot
from pareto_ltl.settings import WindConfig
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import DataError, InfeasibleError
from pareto_ltl_apps.formats.snapshots import known_at, latest_readings
from pareto_ltl_apps.studies.random_missions import mission, spells
from pareto_ltl_apps.studies.settings import ForecastTestConfig
from pareto_ltl_apps.wind_errors.full_winds import full_winds
from published.dataset import FOLDER, Mission
from published.planners import PLANNERS, Planned, plan

SEED, COUNT, EACH, MAX_DRAWS = 2018, 40, 2, 400
LEAST, MOST = 0.01, 0.20  # promises of the missions that are taken
TEST = ForecastTestConfig(
    area=[[-180.0, -64.0], [180.0, -64.0], [180.0, 64.0], [-180.0, 64.0]], side=[300e3, 300e3],
    obstacles=[2, 3], formulas=["F(a & F b)", "F a & F b", "!c U a & F b"], hours=6.0, max_gap=8.0,
    delay=10.0, points=None, situations="boxes",
)  # fmt: skip
DT, U_MIN, U_MAX, GUST = 600.0, 0.0, 40.0, 0.3
KNOWN_FIELDS = 3  # the newest ones
KNOWN_MARGIN, TRUE_MARGIN = 5.0, 4.0  # [deg of latitude] of winds beyond the middle of a map
NOAA = (
    "GFS of the US National Oceanic and Atmospheric Administration (NOAA), 10 m winds on a grid of 1 degree, "
    "public domain (17 U.S.C. 105); a selection, not an official NOAA product"
)


@dataclass(frozen=True)
class Winds:
    """All fields, and the newest one of each time."""

    snapshots: tuple[Snapshot, ...]
    truth: Readings
    files: tuple[Path, ...]


def main(argv: list[str] | None = None) -> int:
    """Write maps, winds, plans and ``missions.json``."""
    parser = argparse.ArgumentParser(prog="python -m published.make", description=__doc__)
    parser.add_argument("folder", type=Path, help="folder of GRIB2 files")
    parser.add_argument("--out", type=Path, default=FOLDER, help="folder that is written")
    parser.add_argument("--count", type=int, default=COUNT, help="missions")
    asked = parser.parse_args(argv)
    for name in ("maps", "winds", "plans"):
        shutil.rmtree(asked.out / name, ignore_errors=True)
        (asked.out / name).mkdir(parents=True)
    winds = read_winds(asked.folder)
    rows, promises = [], {}
    for row, planned in taken(winds, asked.out, asked.count):
        rows.append(row)
        for planner, made in planned.items():
            promises.setdefault(planner, {})[row.name] = made.write(asked.out / "plans" / planner, row.name)
    for planner, told in promises.items():
        known = {name: promise for name, promise in told.items() if promise is not None}
        if known:
            write(asked.out / "plans" / planner / "promises.json", known)
    write(asked.out / "missions.json", {"seed": SEED, "missions": [asdict(row) for row in rows]})
    digests = {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in winds.files}
    write(asked.out / "winds" / "origin.json", {"source": NOAA, "files": digests})
    return 0


def write(path: Path, content: Any) -> None:
    """A JSON file."""
    path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def read_winds(folder: Path) -> Winds:
    """The GRIB files of ``folder``."""
    files = tuple(sorted(file for file in folder.iterdir() if ".pgrb2." in file.name))
    found = full_winds(files, WindConfig(source="grib", path=str(folder)), None)
    return Winds(found.winds, found.truth(), files)


# --- missions -----------------------------------------------------------------------------------


def taken(winds: Winds, out: Path, count: int) -> Iterator[tuple[Mission, dict[str, Planned]]]:
    """The missions that are taken, with all plans."""
    periods, found = spells(winds.truth, TEST), Counter[str]()
    for number in range(MAX_DRAWS):
        drawn = mission(TEST, SEED, number, periods)
        if found[drawn.situation] >= EACH:
            continue
        row = written(winds, drawn.scene, drawn.formula, drawn.situation, f"m{found.total():02}", out)
        try:
            ours = plan(row, "ours", out)
            wanted = LEAST <= ours.promise <= MOST
            planned = {name: plan(row, name, out) if name != "ours" else ours for name in PLANNERS if wanted}
        except (InfeasibleError, DataError) as error:
            print(f"mission {number}: {error}", file=sys.stderr)
            wanted, planned = False, {}
        print(f"mission {number}: {'taken' if wanted else 'left'} {found.total()}", flush=True)
        if not wanted:
            continue
        found[drawn.situation] += 1
        yield row, planned
        if found.total() == count:
            return
    raise SystemExit(f"{MAX_DRAWS} draws have {found.total()} missions; expected {count}")


def written(winds: Winds, scene: Scene, formula: str, situation: str, name: str, out: Path) -> Mission:
    """A mission whose map and winds are written to ``out``."""
    text = json.dumps(map_document(scene), indent=None)
    (out / "maps" / f"{name}.geojson").write_text(
        text.replace('{"type": "Feature"', '\n{"type": "Feature"') + "\n"
    )
    departure = seconds(str(scene.time_zero))
    (lon,), (lat,) = scene.frame.to_geographic(scene.bounds.mean(axis=0)[None])
    known = latest_readings(known_at(winds.snapshots, departure, HOUR * TEST.delay), winds.files)
    recent = [k for k in range(len(known.times)) if known.times[k] > departure - 24 * HOUR][-KNOWN_FIELDS:]
    times = winds.truth.times
    first = int(np.searchsorted(times, departure, side="right")) - 1
    last = int(np.searchsorted(times, departure + HOUR * TEST.hours))
    centre = float(lon), float(lat)
    table(out / "winds" / f"{name}_known.csv", known, recent, centre, KNOWN_MARGIN)
    table(out / "winds" / f"{name}_true.csv", winds.truth, range(first, last + 1), centre, TRUE_MARGIN)
    return Mission(
        name=name, situation=situation, formula=formula, departure=str(scene.time_zero),
        map=f"maps/{name}.geojson", known=f"winds/{name}_known.csv", truth=f"winds/{name}_true.csv",
        dt=DT, hours=TEST.hours, u_min=U_MIN, u_max=U_MAX, gust_sd=GUST,
    )  # fmt: skip


def table(path: Path, of: Readings, times: Any, centre: tuple[float, float], margin: float) -> None:
    """The winds of some times within ``margin`` degrees of latitude of a place, as a table of a planner."""
    lines = ["time,lat,lon,u,v,lead_hours"]
    for k in times:
        lon, lat = of.points[k].T
        east = (lon - centre[0] + 180.0) % 360.0 - 180.0
        near = (np.abs(lat - centre[1]) <= margin) & (
            np.abs(east) <= margin / np.cos(np.deg2rad(abs(centre[1]) + margin))
        )
        lines += [
            f"{iso(of.times[k])},{y:g},{x:g},{u:.2f},{v:.2f},{of.leads[k] / HOUR:g}"
            for x, y, u, v in zip(
                np.round(centre[0] + east[near], 3), lat[near], *of.winds[k][near].T, strict=True
            )
        ]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def map_document(scene: Scene) -> dict[str, Any]:
    """Start, regions and obstacles as GeoJSON."""
    places = [("region", name, parts[0]) for name, parts in scene.regions.items()]
    places += [
        ("obstacle", f"obstacle {number}", corners) for number, corners in enumerate(scene.obstacles, 1)
    ]
    features = [feature("start", "start", "Point", lonlat(scene, scene.start[None])[0])]
    for role, name, corners in places:
        ring = lonlat(scene, np.concatenate([corners, corners[:1]]))
        features.append(feature(role, name, "Polygon", [ring]))
    return {"type": "FeatureCollection", "features": features}


def feature(role: str, name: str, kind: str, coordinates: Any) -> dict[str, Any]:
    """A feature with the properties that maps have."""
    return {
        "type": "Feature", "properties": {"role": role, "name": name},
        "geometry": {"type": kind, "coordinates": coordinates},
    }  # fmt: skip


def lonlat(scene: Scene, points: FloatArray) -> list[list[float]]:
    """Longitude and latitude [deg] of ``points`` (N, 2) [m], to about a metre."""
    return np.round(np.column_stack(scene.frame.to_geographic(points)), 5).tolist()


if __name__ == "__main__":
    sys.exit(main())
