"""A map of the user under the drawing: areas, lines and points, or an image."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pareto_ltl.serve import geotiff, pmtiles
from pareto_ltl.serve.folder import MAPS, DeskFolder
from pareto_ltl.support.errors import DataError
from pareto_ltl.support.messages import shown_value
from pareto_ltl.support.reading import parse_json
from pareto_ltl.world.scene_files import SCENE_FILES, SUFFIXES, kml_features
from pareto_ltl.world.scene_sketch import MapFaults

MOST_CORNERS = 200_000  # that a page draws within a frame or two
DIGITS = 5  # of a degree: 1 m
KEYS = {"Polygon": "area", "LineString": "line", "LinearRing": "line", "Point": "point"}


def keep_backdrop(folder: DeskFolder, name: str, content: bytes) -> dict[str, Any]:
    """Copy a file into the folder; :func:`backdrop` of it; DataError if it is empty."""
    suffix = Path(name).suffix.lower()
    known = (*SUFFIXES, *geotiff.SUFFIXES, *pmtiles.SUFFIXES)
    return backdrop(folder, Path(folder.keep_map(content, suffix if suffix in known else ".geojson")).name)


def backdrop(folder: DeskFolder, name: str) -> dict[str, Any]:
    """The file ``name`` in the folder of maps: ``name``, ``shapes`` [deg] and ``image`` (or None)."""
    path = folder.inside(f"{MAPS}/{Path(name).name}")
    if not path.is_file():
        raise DataError(f"there is no map {shown_value(name)}")
    if path.suffix in geotiff.SUFFIXES:
        return {"name": name, "shapes": [], "image": geotiff.shown_image(path)}
    if path.suffix in pmtiles.SUFFIXES:
        return {"name": name, **pmtiles.shown_tiles(path)}
    return {"name": name, "shapes": _all_shapes(path, name), "image": None}


def _all_shapes(path: Path, name: str) -> list[dict[str, Any]]:
    """Name, kind (area, line, point) and lines [deg] of all shapes of a file."""
    if path.suffix in SUFFIXES:
        features = kml_features(path, SCENE_FILES, MapFaults(name), "backdrop")
    else:
        features = _features(parse_json(path.read_bytes(), name, SCENE_FILES))
    shapes = [shape for feature in features for shape in _shapes(name, feature)]
    if not shapes:
        raise DataError(f"{name} has no areas, lines or points; give GeoJSON, KML, PMTiles or GeoTIFF")
    if (count := sum(len(line) for shape in shapes for line in shape["lines"])) > MOST_CORNERS:
        raise DataError(f"{name} has {count:,} corners, at most {MOST_CORNERS:,} are drawn: simplify it")
    return shapes


def _features(read: Any) -> list[Any]:
    if not isinstance(read, dict):
        return []
    inner = read.get("features")
    return inner if isinstance(inner, list) else [read if "geometry" in read else {"geometry": read}]


def _shapes(where: str, feature: Any) -> Iterator[dict[str, Any]]:
    from shapely import get_parts
    from shapely.geometry import shape

    given = feature.get("geometry") if isinstance(feature, dict) else None
    if given is None:
        return
    told = feature.get("properties")
    title = told.get("name") or told.get("title") if isinstance(told, dict) else None
    try:
        parts = [part for many in get_parts([shape(given)]) for part in get_parts([many])]
        for part in parts:
            lines = [part.exterior, *part.interiors] if part.geom_type == "Polygon" else [part]
            found = [_degrees(line.coords) for line in lines if not line.is_empty]
            if found:
                yield {"name": str(title or "")[:80], "kind": KEYS[part.geom_type], "lines": found}
    except (ValueError, TypeError, KeyError, AttributeError, IndexError) as error:
        raise DataError(
            f"{where}: a geometry cannot be read ({error}); expected GeoJSON in degrees"
        ) from None


def _degrees(corners: Any) -> list[list[float]]:
    places: NDArray[np.float64] = np.array(corners, float)[:, :2]
    if not np.isfinite(places).all() or (np.abs(places) > (360.0, 90.0)).any():
        raise ValueError("a longitude or latitude is out of range")
    return [[float(lon), float(lat)] for lon, lat in places.round(DIGITS)]
