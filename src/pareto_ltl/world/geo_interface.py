"""Maps and paths as GeoJSON, for the packages that read ``__geo_interface__``: shapely, GeoPandas and others.

On Earth, coordinates are longitude and latitude, and lines have so many points that they stay where they are
in the plane. They continue beyond 180 degrees, so that no shape is cut. Else they are metres.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.world.projection import Frame

if TYPE_CHECKING:
    from pareto_ltl.world.scene import Scene

Feature = dict[str, Any]


def line_feature(frame: Frame, points: FloatArray, about: Mapping[str, Any]) -> Feature:
    """A line through ``points`` (N, 2) [m]."""
    return _feature("LineString", _coordinates(frame, points), about)


def scene_features(scene: Scene) -> dict[str, Any]:
    """All places of a map with their roles; ``read_map`` reads them again, but for what a plane alone has."""
    (west, south), (east, north) = scene.bounds
    border = np.array([[west, south], [east, south], [east, north], [west, north]])
    features = [
        _feature("Point", _coordinates(scene.frame, scene.start[None])[0], {"role": "start"}),
        _polygons(scene.frame, [border], {"role": "border"}),
        *_places(scene),
    ]
    return {"type": "FeatureCollection", "features": features}


def _places(scene: Scene) -> Iterator[Feature]:
    for name, outlines in scene.regions.items():
        if outlines:
            yield _polygons(scene.frame, outlines, {"role": "region", "name": name})
    names = scene.obstacle_names or [""] * len(scene.obstacles)
    for name, outline in zip(names, scene.obstacles, strict=True):
        yield _polygons(scene.frame, [outline], {"role": "obstacle"} | ({"name": name} if name else {}))
    for outline in scene.landmarks:
        yield _polygons(scene.frame, [outline], {"role": "landmark"})


def _polygons(frame: Frame, outlines: Sequence[FloatArray], about: Mapping[str, Any]) -> Feature:
    """Several outlines without a common area as one feature."""
    rings = [[_coordinates(frame, np.concatenate([corners, corners[:1]]))] for corners in outlines]
    return _feature("Polygon", rings[0], about) if len(rings) == 1 else _feature("MultiPolygon", rings, about)


def _coordinates(frame: Frame, points: FloatArray) -> list[Any]:
    if not frame.on_earth:
        found: list[Any] = points.tolist()
        return found
    places = frame.lonlat(points) if len(points) == 1 else frame.line_degrees(points)
    places[:, 0] = np.unwrap(places[:, 0], period=360.0)
    return list(places.round(Frame.DECIMALS).tolist())


def _feature(kind: str, coordinates: Any, about: Mapping[str, Any]) -> Feature:
    return {
        "type": "Feature",
        "geometry": {"type": kind, "coordinates": coordinates},
        "properties": dict(about),
    }
