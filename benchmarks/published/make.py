"""Make the data of the benchmark again: ``python -m published.make GRIB_FOLDER`` in ``benchmarks``.

GRIB_FOLDER has GFS files of one degree: analyses (f000) and forecasts for 3 h (f003) of the cycles of 9, 10,
14 and 15 October 2018, with the date of the cycle at the end of each name, as ``...2018100906f3``.
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import tempfile
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pareto_ltl.settings import ForecastTestConfig
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.times import HOUR, seconds
from pareto_ltl.world.scene import Scene
from pareto_ltl_apps.cli.commands import run_command_line
from pareto_ltl_apps.studies.random_missions import Spell, mission
from published.dataset import FOLDER, Mission

SEED = 2018
EACH = 6  # missions of a situation
KNOWN_POINTS = 120  # readings at each time that a planner gets; of the true fields all nodes
EVERY_NODE = 100_000
CENTRES = [[-100.0, 35.5], [-92.0, 35.5], [-92.0, 40.5], [-100.0, 40.5]]  # of the maps [longitude, latitude]
WINDS = [[-107.5, 28.5], [-84.5, 28.5], [-84.5, 47.5], [-107.5, 47.5]]  # of the tables


@dataclass(frozen=True)
class Situation:
    """A departure, and the last cycle that is at least 4 h old then."""

    name: str
    departure: str
    last_cycle: str
    first_cycle: str
    last_time: str
    hours: float


SITUATIONS = (
    Situation("october_9", "2018-10-09T18:00:00Z", "2018100912", "2018100900", "2018-10-10T15:00:00Z", 15.0),
    Situation("october_14", "2018-10-14T18:00:00Z", "2018101412", "2018101412", "2018-10-15T09:00:00Z", 15.0),
)


def main(argv: list[str] | None = None) -> int:
    """Write maps, winds and ``missions.json``."""
    parser = argparse.ArgumentParser(prog="python -m published.make", description=__doc__)
    parser.add_argument("folder", type=Path, help="folder of GRIB2 files")
    parser.add_argument("--out", type=Path, default=FOLDER, help="folder that is written")
    asked = parser.parse_args(argv)
    for name in ("maps", "winds"):
        (asked.out / name).mkdir(parents=True, exist_ok=True)
    rows = []
    for number, situation in enumerate(SITUATIONS):
        write_winds(situation, asked.folder, asked.out / "winds")
        rows += [one_mission(situation, number * EACH + k, asked.out) for k in range(EACH)]
    content = {"seed": SEED, "missions": [asdict(row) for row in rows]}
    (asked.out / "missions.json").write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    return 0


def write_winds(situation: Situation, folder: Path, out: Path) -> None:
    """The tables of a situation: what is known 4 h before departure, and the newest winds of each time."""
    s = situation
    ingest(
        folder,
        lambda cycle: s.first_cycle <= cycle <= s.last_cycle,
        out / f"{s.name}_known.csv",
        KNOWN_POINTS,
    )
    ingest(
        folder, lambda cycle: s.first_cycle <= cycle, out / f"{s.name}_true.csv", EVERY_NODE,
        f"ingest.first={s.departure}", f"ingest.last={s.last_time}",
    )  # fmt: skip


def ingest(folder: Path, wanted: Callable[[str], bool], out: Path, points: int, *words: str) -> None:
    """``pareto-ltl ingest`` of the files of some cycles."""
    with tempfile.TemporaryDirectory() as place:
        for file in folder.iterdir():
            cycle = file.name.rpartition(".")[2].removesuffix("f3")
            if file.is_file() and cycle.isdigit() and wanted(cycle):
                shutil.copy(file, place)
        area = json.dumps(WINDS, separators=(",", ":"))
        code = run_command_line([
            "ingest", "wind=grib", f"wind.path={place}", f"ingest.out={out.resolve()}",
            f"ingest.points={points}",
            f"ingest.area={area}", *words, f"hydra.run.dir={place}/run", "--quiet",
        ])  # fmt: skip
    if code:
        raise SystemExit(code)


def one_mission(situation: Situation, number: int, out: Path) -> Mission:
    """Draw a random mission of the situation and write its map."""
    cfg = ForecastTestConfig(area=CENTRES, hours=situation.hours)
    departure = seconds(situation.departure)
    spell = Spell(0, 0, departure - HOUR * cfg.wait, departure + HOUR * cfg.hours)  # of one departure
    drawn = mission(cfg, SEED, number, [spell])
    name = f"{situation.name}_{number % EACH}"
    text = json.dumps(map_document(drawn.scene), indent=None)
    (out / "maps" / f"{name}.geojson").write_text(
        text.replace('{"type": "Feature"', '\n{"type": "Feature"') + "\n"
    )
    return Mission(
        name=name, situation=situation.name, formula=drawn.formula, departure=situation.departure,
        map=f"maps/{name}.geojson", known=f"winds/{situation.name}_known.csv",
        truth=f"winds/{situation.name}_true.csv", dt=1800.0, hours=situation.hours, u_min=0.0, u_max=30.0,
        gust_sd=0.3,
    )  # fmt: skip


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
