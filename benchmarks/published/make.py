"""Make the missions of the benchmark again: ``python -m published.make GRIB_FOLDER`` in ``benchmarks``.

GRIB_FOLDER has GFS files of one degree, of the whole Earth: analyses (f000) and forecasts for 3 h (f003) of
the cycles of 9, 10, 14 and 15 October 2018. Random missions all over the Earth are planned from what was
known 4 h before departure; those that this planner promises to fail in 1 to 20 % of the flights are kept, at
most two in one situation, until there are ``COUNT``.
"""

from __future__ import annotations

import argparse
import csv
import hashlib
import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from pareto_ltl import Readings
from pareto_ltl.settings.building import build_settings
from pareto_ltl.studies import forecast_test
from pareto_ltl.studies.known_winds import DepartureWinds
from pareto_ltl.studies.random_missions import Mission as Drawn
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import DataError, InfeasibleError
from pareto_ltl.wind.readings import HOUR, farthest_points, iso, on_sphere, seconds
from pareto_ltl.world.projection import to_geographic
from pareto_ltl.world.scene import Scene
from published.dataset import FOLDER, Mission
from published.entries import QUICK, ours

SEED, COUNT, MOST_TRIED = 2018, 40, 400
EACH = 2  # most missions of a situation
WANTED = (0.01, 0.20)  # promises
KNOWN_POINTS, KNOWN_REACH, TRUE_REACH = 120, 7.0, 6.0  # places of a time; reach in latitude [deg]
KNOWN_TIMES = 2  # the last ones
DT, HOURS, FASTEST, GUSTS = 900.0, 6.0, 50.0, 0.3
SOURCE = (
    "US National Oceanic and Atmospheric Administration (NOAA), public domain (17 U.S.C. 105); GFS, a "
    "selection, not an official NOAA product"
)


def main(argv: list[str] | None = None) -> int:
    """Write maps, winds and ``missions.json``."""
    parser = argparse.ArgumentParser(prog="python -m published.make", description=__doc__)
    parser.add_argument("folder", type=Path, help="folder of GRIB2 files")
    parser.add_argument("--out", type=Path, default=FOLDER, help="folder that is written")
    asked = parser.parse_args(argv)
    for name in ("maps", "winds"):
        (asked.out / name).mkdir(parents=True, exist_ok=True)
    known = known_winds(asked.folder)
    rows: list[Mission] = []
    for number in range(MOST_TRIED):
        task = known.task(number)
        if sum(row.situation == task.situation for row in rows) < EACH:
            row = written(known, task, f"m{len(rows):02d}", asked.out)
            rate = promise_of(row, asked.out)
            print(number, task.situation, rate, flush=True)
            if rate is not None and WANTED[0] <= rate <= WANTED[1]:
                rows.append(row)
        if len(rows) == COUNT:
            break
    for path in asked.out.glob(f"*/m{len(rows):02d}*"):  # of the last one, if it was not kept
        path.unlink()
    content = {"seed": SEED, "missions": [asdict(row) for row in rows]}
    (asked.out / "missions.json").write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    digests = {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in known.truth.files}
    origin = {"source": SOURCE, "files": digests}
    (asked.out / "winds" / "origin.json").write_text(json.dumps(origin, indent=1) + "\n", encoding="utf-8")
    return 0


def known_winds(folder: Path) -> DepartureWinds:
    """All winds of the Earth, and what is known 4 h before a departure."""
    area = [[-180.0, -66.0], [180.0, -66.0], [180.0, 66.0], [-180.0, 66.0]]
    test = {
        "truth": str(folder), "area": area, "side": [250e3, 400e3], "obstacles": [2, 5], "hours": HOURS,
        "points": None, "situations": "boxes", "delay": 4.0,
    }  # fmt: skip
    settings = build_settings({**QUICK, "seed": SEED, "forecast_test": test})
    found = forecast_test.known_of_files(settings, settings.forecast_test, Path())
    assert isinstance(found, DepartureWinds)
    return found


def promise_of(row: Mission, folder: Path) -> float | None:
    """The rate that this planner promises; None without a plan."""
    try:
        return ours(row, folder).promised
    except (InfeasibleError, DataError):
        return None


def written(known: DepartureWinds, task: Drawn, name: str, out: Path) -> Mission:
    """Write the map and the winds of a mission."""
    departure = seconds(str(task.scene.time_zero))
    text = json.dumps(map_document(task.scene), indent=None)
    (out / "maps" / f"{name}.geojson").write_text(
        text.replace('{"type": "Feature"', '\n{"type": "Feature"') + "\n"
    )
    before = known.readings(task)
    times = range(max(0, len(before.times) - KNOWN_TIMES), len(before.times))
    write_winds(out / "winds" / f"{name}_known.csv", before, times, task, KNOWN_REACH, KNOWN_POINTS)
    later = known.truth
    first = int(np.searchsorted(later.times, departure, side="right")) - 1
    last = int(np.searchsorted(later.times, departure + HOUR * HOURS))
    write_winds(out / "winds" / f"{name}_true.csv", later, range(first, last + 1), task, TRUE_REACH, None)
    return Mission(
        name=name, situation=task.situation, formula=task.formula, departure=str(task.scene.time_zero),
        map=f"maps/{name}.geojson", known=f"winds/{name}_known.csv", truth=f"winds/{name}_true.csv",
        dt=DT, hours=HOURS, u_min=0.0, u_max=FASTEST, gust_sd=GUSTS,
    )  # fmt: skip


def write_winds(
    path: Path, readings: Readings, times: range, task: Drawn, reach: float, most: int | None
) -> None:
    """The winds of some times within ``reach`` [deg] of latitude, at most at ``most`` places."""
    rows = []
    for k in times:
        points = readings.points[k]
        east = (points[:, 0] - task.longitude + 180.0) % 360.0 - 180.0
        wide = reach / np.cos(np.deg2rad(task.latitude))
        near = np.flatnonzero((np.abs(points[:, 1] - task.latitude) <= reach) & (np.abs(east) <= wide))
        if most is not None:
            near = near[np.sort(farthest_points(on_sphere(points[near]), most, len(near) // 2))]
        for (lon, lat), (u, v) in zip(points[near], readings.winds[k][near], strict=True):
            lead = f"{readings.leads[k] / HOUR:g}"
            rows.append([iso(float(readings.times[k])), f"{lat:g}", f"{lon:g}", f"{u:.2f}", f"{v:.2f}", lead])
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["time", "lat", "lon", "u", "v", "lead_hours"])
        table.writerows(rows)


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
    places: list[list[float]] = np.round(np.column_stack(to_geographic(str(scene.crs), points)), 5).tolist()
    return places


if __name__ == "__main__":
    sys.exit(main())
