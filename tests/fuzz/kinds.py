"""Each kind of wind file and of map as a target of its own, with seeds that the suites write.

``python -m fuzz.harness --cases 300 "wind hycom"`` reads 300 mutants of one kind; the suite reads some of all
kinds together.
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

from hypothesis import strategies as st

import map_samples
import wind_files
from fuzz import corpora
from fuzz.mutations import json_bytes, mutants, tree_mutants
from fuzz.records import Case, Fuzz, Read, Target

CASES_OF_ALL = 0.15  # share of the cases of a block that the suite reads of all winds, or all maps, together


def from_file(path: Path, read: Callable[[Path], object]) -> Read:
    """Write a case to ``path``, then read that."""

    def write_and_read(case: bytes) -> object:
        path.write_bytes(case)
        return read(path)

    return write_and_read


# --- winds -------------------------------------------------------------------------------------


def wind_kind(kind: str, place: Path) -> Fuzz:
    """Mutants of one kind of wind file; of two files that belong together, the first."""
    seed = wind_files.KINDS[kind](place / kind)
    file = sorted(seed.iterdir())[0] if seed.is_dir() else seed
    return Fuzz(mutants([file.read_bytes()]), from_file(file, partial(_read_wind, kind)))


def wind_seeds(place: Path) -> dict[str, bytes]:
    """The content of a file of each kind."""
    found = {}
    for kind, write in wind_files.KINDS.items():
        path = write(place / f"seed {kind}")
        found[kind] = (sorted(path.iterdir())[0] if path.is_dir() else path).read_bytes()
    return found


def _read_wind(kind: str, path: Path) -> object:
    """As the source of the wind reads it, but GRIB in this process: a new one takes a second."""
    from pareto_ltl_apps.formats.csv_files import read_csv_files
    from pareto_ltl_apps.formats.grib_files import grib_snapshots
    from pareto_ltl_apps.formats.netcdf_files import netcdf_snapshots
    from pareto_ltl_apps.formats.quantities import CURRENTS, WINDS
    from pareto_ltl_apps.formats.snapshots import latest_readings
    from pareto_ltl_apps.formats.station_files import read_station_files

    quantity, level = (CURRENTS, "0m") if kind in ("hycom", "grib currents") else (WINDS, "10m")
    if kind in wind_files.TABLES:
        return read_csv_files((path,), 150.0)
    if kind in wind_files.REPORTS:
        return read_station_files((path,), 150.0)
    if kind in wind_files.NETCDF:
        together = tuple(sorted(path.parent.iterdir()))
        return latest_readings(*netcdf_snapshots(together, quantity, level, 150.0))
    return latest_readings(*grib_snapshots((path,), 150.0, level, quantity=quantity))


# --- maps --------------------------------------------------------------------------------------


def read_map(path: Path) -> object:
    from pareto_ltl.settings import SceneConfig
    from pareto_ltl.world.scene_settings import scene_from_settings

    return scene_from_settings(SceneConfig(file=str(path)))


def with_zones(path: Path) -> object:
    """The map of the corpus with the zones of ``path``."""
    from pareto_ltl.settings import SceneConfig
    from pareto_ltl.world.scene_settings import scene_from_settings

    whole = path.with_name("whole.geojson")
    if not whole.exists():
        whole.write_bytes(json_bytes(corpora.GEOJSON))
    return scene_from_settings(SceneConfig(file=str(whole), zones=[str(path)], altitude=100.0))


def _collection(*features: object) -> dict[str, object]:
    return {"type": "FeatureCollection", "features": list(features)}


_AREA = map_samples.AREA
_OPENAIP = {
    "name": "CTR", **map_samples.OPENAIP_LIMITS, "geometry": {"type": "Polygon", "coordinates": _AREA},
}  # fmt: skip
_LAYER = {"upper": 120, "upperReference": "AGL", "lower": 0, "lowerReference": "AGL", "uom": "m"}
_ROUND = corpora.feature("", "Point", [10.3, 60.1], name="x")
_ROUND["geometry"] |= {"extent": {"subType": "Circle", "radius": 3000}, "layer": _LAYER}
_FAA = corpora.feature("", "Polygon", _AREA, UPPER_VAL=4000, UPPER_UOM="FT", UPPER_CODE="MSL")
_CELL = corpora.feature("", "Polygon", _AREA, CEILING=100, UNIT="Feet", APT1_ICAO="KXYZ")
TREES = {  # kinds of JSON: trees whose values are changed
    "ed-269": [map_samples.ED269],
    "ed-318": [_collection(_ROUND)],
    "openaip": [[_OPENAIP], {"items": [_OPENAIP]},
                _collection({"type": "Feature", "properties": _OPENAIP, "geometry": _OPENAIP["geometry"]})],
    "faa map": [_collection(_CELL)],
    "faa airspace": [_collection(_FAA)],
    "plan fence": [map_samples.PLAN],
}  # fmt: skip
_LINES = b"\n".join(json_bytes(one).replace(b"\n", b"") for one in corpora.GEOJSON["features"])
TEXTS = {  # kinds whose bytes are changed
    "openair": [map_samples.OPENAIR.encode()],
    "waypoints fence": [map_samples.WAYPOINTS.encode()],
    "lines of geojson": [_LINES, b"\x1e" + _LINES.replace(b"\n", b"\n\x1e")],
}


def json_kind(kind: str, place: Path) -> Fuzz:
    return Fuzz(tree_mutants(TREES[kind], json_bytes), from_file(place / f"{kind}.json", with_zones))


def text_kind(kind: str, place: Path) -> Fuzz:
    return Fuzz(mutants(TEXTS[kind]), from_file(place / f"{kind}.txt", with_zones))


def linked_archives(place: Path) -> Fuzz:
    """KMZ archives with links, and KML files with links to a file beside them."""
    link = "<NetworkLink><name>no fly</name><Link><href>{}</href></Link></NetworkLink></Document></kml>"
    linked = corpora.KML.strip().removesuffix("</Document></kml>") + link
    (place / "beside.kml").write_text(corpora.KML)
    seeds = [linked.format("beside.kml").encode()]
    for form in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        buffer = io.BytesIO()
        with zipfile.ZipFile(buffer, "w", form) as file:
            file.writestr("files/zones.kml", corpora.KML)
            file.writestr("doc.kml", linked.format("files/zones.kml"))
        seeds.append(buffer.getvalue())
    return Fuzz(mutants(seeds), from_file(place / "map.kmz", _read_any_kml))


def _read_any_kml(path: Path) -> object:
    """The map of an archive, or of the same content as a KML file."""
    content = path.read_bytes()
    if content.startswith(b"PK"):
        return read_map(path)
    plain = path.with_suffix(".kml")
    plain.write_bytes(content)
    return read_map(plain)


# --- the tables --------------------------------------------------------------------------------

Prepare = Callable[[Path], Fuzz]
WINDS: dict[str, Prepare] = {f"wind {kind}": partial(wind_kind, kind) for kind in wind_files.KINDS}
MAPS: dict[str, Prepare] = {
    **{f"map {kind}": partial(json_kind, kind) for kind in TREES},
    **{f"map {kind}": partial(text_kind, kind) for kind in TEXTS},
    "map kmz with links": linked_archives,
}
KIND_TARGETS = tuple(Target(name, prepare) for name, prepare in (WINDS | MAPS).items())


def all_together(prepares: dict[str, Prepare], place: Path) -> Fuzz:
    """Cases of all of ``prepares``, each with the name of its kind."""
    found: dict[str, Fuzz] = {}
    for name, prepare in prepares.items():
        (folder := place / name).mkdir()
        found[name] = prepare(folder)
    cases = [st.tuples(st.just(name), one.cases) for name, one in found.items()]

    def read(case: Case) -> object:
        return found[case[0]].read(case[1])

    return Fuzz(st.one_of(cases), read)


TOGETHER = (
    Target("kinds_of_winds", partial(all_together, WINDS), share=CASES_OF_ALL),
    Target("kinds_of_maps", partial(all_together, MAPS), share=CASES_OF_ALL),
)
