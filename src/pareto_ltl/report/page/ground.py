"""Map, wind and trees of the page, as rounded numbers in the plane of the map."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from pareto_ltl.exports.degrees import crosses, outline_degrees
from pareto_ltl.exports.formats import holds_pole
from pareto_ltl.exports.geojson import border_corners
from pareto_ltl.planning.records import Forest
from pareto_ltl.report.lattice import (
    arrow_nodes,
    interpolate_slots,
    lattice_nodes,
    sampled_lattice,
    wind_deviation,
)
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.display import in_kilometres
from pareto_ltl.wind.records import WindField
from pareto_ltl.world.scene import Scene

DOUBT_NODES = 15  # along each side of the map
MOST_TIMES = 25  # times at which the wind is shown, at most
MOST_CORNERS = 20_000  # corners of all polygons, at most; more are thinned out
MOST_EDGES = 4000  # edges of trees, at most, drawn if there is no plan
FENCE_SAG = 50.0  # [m] of long edges in degrees
SPEED_DIGITS = 2
DEGREES = 6


def rounded(values: FloatArray, digits: int) -> list[Any]:
    """``values`` as nested lists with at most ``digits`` decimals."""
    found = np.round(np.asarray(values, float), digits) + 0.0  # no -0
    listed: list[Any] = found.astype(np.int64).tolist() if digits == 0 else found.tolist()
    return listed


def metre_digits(scene: Scene) -> int:
    """Decimals of positions in metres: a resolution of a ten-thousandth of the map or finer."""
    size = float(np.ptp(scene.bounds, axis=0).max())
    return int(np.clip(5 - np.floor(np.log10(max(size, 1e-9))), 0, 6))


def shown_map(scene: Scene) -> dict[str, Any]:
    """Outlines [m], and the unit of the axes."""
    digits = metre_digits(scene)
    total = sum(map(len, (*scene.region_outlines, *scene.obstacles, *scene.landmarks)))
    stride = max(1, -(-total // MOST_CORNERS))

    def outline(corners: FloatArray) -> list[Any]:
        return rounded(corners if len(corners) < 3 * stride else corners[::stride], digits)

    large = in_kilometres(float(np.ptp(scene.bounds, axis=0).max()))
    return {
        "bounds": rounded(scene.bounds, digits),
        "start": rounded(scene.start, digits),
        "regions": [
            {"name": name, "parts": [outline(c) for c in parts]} for name, parts in scene.regions.items()
        ],
        "obstacles": [outline(c) for c in scene.obstacles],
        "landmarks": [outline(c) for c in scene.landmarks],
        "walled": scene.walled,
        "windows": [
            {"name": name, "forbidden": name in scene.forbidden, "told": str(window)} | window.as_dict()
            for name, window in scene.windows.items()
        ],
        "unit": "km" if large else "m",
        "perMetre": 1e-3 if large else 1.0,
    }


def map_on_earth(scene: Scene) -> list[dict[str, Any]]:
    """Outlines in degrees for exported files; none for a map without a place on Earth, at a pole or 180°."""
    if scene.crs is None or holds_pole(scene):
        return []
    crs = scene.crs
    named = [("region", name, c) for name, parts in scene.regions.items() for c in parts]
    named += [("obstacle", f"obstacle {n}", c) for n, c in enumerate(scene.obstacles, 1)]
    named += [("landmark", f"landmark {n}", c) for n, c in enumerate(scene.landmarks, 1)]
    named += [("bounds", f"border ({scene.border})", border_corners(scene.bounds))]
    rings = [(role, name, outline_degrees(crs, corners, FENCE_SAG)) for role, name, corners in named]
    if any(crosses(ring) for _, _, ring in rings) or sum(len(ring) for _, _, ring in rings) > MOST_CORNERS:
        return []
    return [{"role": role, "name": name, "ring": rounded(ring, DEGREES)} for role, name, ring in rings]


def shown_wind(scene: Scene, wind: WindField, last: float) -> dict[str, Any]:
    """Expected wind and standard deviation at up to ``MOST_TIMES`` times until ``last`` [s]."""
    i, j = arrow_nodes(wind, scene.bounds)
    x, y = lattice_nodes(wind)
    a, b = (np.linspace(low, high, DOUBT_NODES) for low, high in scene.bounds.T)
    times = np.linspace(0.0, last, MOST_TIMES) if last > 0.0 and len(wind.times) > 1 else np.zeros(1)
    digits = metre_digits(scene)
    mean = np.array([interpolate_slots(wind.times, wind.mean, t)[np.ix_(i, j)] for t in times])
    doubt = np.array([sampled_lattice(wind, wind_deviation(wind, t), a, b) for t in times])
    return {
        "t": rounded(times, 0),
        "x": rounded(x[i], digits),
        "y": rounded(y[j], digits),
        "u": rounded(mean[..., 0], SPEED_DIGITS),  # [time][column][row], m/s
        "v": rounded(mean[..., 1], SPEED_DIGITS),
        "a": rounded(a, digits),
        "b": rounded(b, digits),
        "sd": rounded(doubt, SPEED_DIGITS),
        "level": wind.level,
    }


def shown_trees(scene: Scene, forest: Forest | None) -> list[Any]:
    """The oldest edges of the trees, four coordinates each [m], for a map without a plan."""
    if forest is None or not forest.trees:
        return []
    share = max(2, MOST_EDGES // len(forest.trees))
    edges: Iterable[FloatArray] = (
        np.hstack([tree.x[tree.parent[1:share]], tree.x[1:share]]) for tree in forest.trees
    )
    return rounded(np.concatenate(list(edges)), metre_digits(scene))
