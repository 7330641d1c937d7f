"""Map, wind and trees as rounded numbers: in degrees, or in metres for a map that has no place on Earth."""

from __future__ import annotations

from typing import Any

import numpy as np

from pareto_ltl import Scene, WindField
from pareto_ltl.extend import Forest, Frame
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl_apps.exports.degrees import crosses
from pareto_ltl_apps.exports.formats import holds_pole
from pareto_ltl_apps.exports.geojson import titled_outlines
from pareto_ltl_apps.view import lattice
from pareto_ltl_apps.view.geography import geography_around

MAX_TIMES = 25  # times at which the wind is shown, at most
MAX_CORNERS = 20_000  # corners of all polygons, at most; more are thinned out
MAX_EDGES = 4000  # edges of trees, at most, drawn if there is no plan
FENCE_SAG = 50.0  # [m] of long edges in degrees
SPEED_DIGITS = 2
DEGREES = 6  # digits of outlines
DEGREE_DIGITS = 5  # of degrees, more than of metres: a degree is 1e5 m


def rounded(values: FloatArray, digits: int) -> list[Any]:
    """``values`` as nested lists with at most ``digits`` decimals."""
    found = np.round(np.asarray(values, float), digits) + 0.0  # no -0
    listed: list[Any] = found.astype(np.int64).tolist() if digits == 0 else found.tolist()
    return listed


def metre_digits(scene: Scene) -> int:
    """Decimals of positions in metres: a resolution of a ten-thousandth of the map or finer."""
    size = float(np.ptp(scene.bounds, axis=0).max())
    return int(np.clip(5 - np.floor(np.log10(max(size, 1e-9))), 0, 6))


def shown_crs(scene: Scene) -> str | None:
    """The CRS of a map that is shown in degrees; None for one without a place on Earth, or with a pole."""
    return None if scene.crs is None or holds_pole(scene) else scene.crs


def north_turn(scene: Scene, points: FloatArray) -> FloatArray:
    """Angles (N,) [rad] to add to directions of the plane at ``points`` (N, 2) [m]: north is at the top."""
    crs = shown_crs(scene)
    return np.zeros(len(points)) if crs is None else Frame(crs).north(points)


def map_places(scene: Scene, points: FloatArray, coarser: int = 0) -> list[Any]:
    """``points`` (..., 2) [m] as rounded longitudes and latitudes; metres without a place on Earth.

    ``coarser`` digits are left out of those that positions have.
    """
    digits, crs = metre_digits(scene) - coarser, shown_crs(scene)
    return (
        rounded(points, digits) if crs is None else rounded(Frame(crs).lonlat(points), DEGREE_DIGITS + digits)
    )


def shown_map(scene: Scene) -> dict[str, Any]:
    """Closed outlines, start and border as the map shows them, and the times at which regions hold.

    ``exported`` says whether files can hold the outlines: not if they are thinned out or cut by 180 degrees.
    """
    named = [("region", name, c) for name, parts in scene.regions.items() for c in parts]
    named += titled_outlines(scene)
    stride = max(1, -(-sum(len(corners) for _, _, corners in named) // MAX_CORNERS))
    crs = shown_crs(scene)
    digits = metre_digits(scene) if crs is None else DEGREES

    def ring_of(corners: FloatArray) -> FloatArray:
        some = corners if len(corners) < 3 * stride else corners[::stride]
        return (
            np.concatenate([some, some[:1]]) if crs is None else Frame(crs).outline_degrees(some, FENCE_SAG)
        )

    rings = [(role, name, ring_of(corners)) for role, name, corners in named]
    return {
        "earthly": crs is not None,
        "shapes": [{"role": role, "name": name, "ring": rounded(ring, digits)} for role, name, ring in rings],
        "exported": crs is not None and stride == 1 and not any(crosses(ring) for _, _, ring in rings),
        "start": map_places(scene, scene.start),
        "walled": scene.walled,
        "windows": [
            {"name": name, "forbidden": name in scene.forbidden, "told": str(window)} | window.as_dict()
            for name, window in scene.windows.items()
        ],
    }


def shown_geography(scene: Scene) -> dict[str, Any] | None:
    """Coasts, borders and cities on the map and beside it; None if the map is not shown in degrees."""
    found = None if shown_crs(scene) is None else geography_around(scene)
    return None if found is None else found.as_dict()


def shown_wind(scene: Scene, wind: WindField, last: float) -> dict[str, Any]:
    """Expected wind and standard deviation on a lattice at up to ``MAX_TIMES`` times until ``last`` [s]."""
    i, j = lattice.arrow_nodes(wind, scene.bounds)
    x, y = lattice.lattice_nodes(wind)
    nodes = np.stack(np.meshgrid(x[i], y[j], indexing="ij"), axis=-1).reshape(-1, 2)
    times = np.linspace(0.0, last, MAX_TIMES) if last > 0.0 and len(wind.times) > 1 else np.zeros(1)
    mean = np.array([lattice.interpolate_slots(wind.times, wind.mean, t)[np.ix_(i, j)] for t in times])
    doubt = np.array([lattice.wind_deviation(wind, t)[np.ix_(i, j)] for t in times])
    speed, bearing = np.hypot(mean[..., 0], mean[..., 1]), np.arctan2(mean[..., 0], mean[..., 1])
    bearing = bearing + north_turn(scene, nodes).reshape(len(i), len(j))
    north = np.stack([speed * np.sin(bearing), speed * np.cos(bearing)], axis=-1)
    return {
        "t": rounded(times, 0),
        "utc": scene.frame.utc(times),
        "shape": [len(i), len(j)],
        "at": map_places(scene, nodes),
        "uv": rounded(north.reshape(len(times), -1, 2), SPEED_DIGITS),  # [time][place], m/s
        "sd": rounded(doubt.reshape(len(times), -1), SPEED_DIGITS),
        "level": wind.level,
    }


def shown_trees(scene: Scene, forest: Forest | None) -> list[Any]:
    """The oldest edges of the trees, two places each, for a map without a plan."""
    return [] if forest is None else map_places(scene, lattice.oldest_edges(forest, MAX_EDGES))
