"""Map, wind and trees as rounded numbers: in degrees, or in metres for a map that has no place on Earth."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from pareto_ltl.exports.degrees import crosses, lonlat, outline_degrees
from pareto_ltl.exports.formats import holds_pole
from pareto_ltl.exports.geojson import border_corners
from pareto_ltl.planning.records import Forest
from pareto_ltl.report.lattice import (
    arrow_nodes,
    interpolate_slots,
    lattice_nodes,
    wind_deviation,
)
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.wind.records import WindField
from pareto_ltl.world.navigation import utc_times
from pareto_ltl.world.projection import meridian_convergence, to_geographic
from pareto_ltl.world.scene import Scene

MOST_TIMES = 25  # times at which the wind is shown, at most
MOST_CORNERS = 20_000  # corners of all polygons, at most; more are thinned out
MOST_EDGES = 4000  # edges of trees, at most, drawn if there is no plan
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


def on_earth(scene: Scene) -> bool:
    """Whether the map is shown in degrees: it has a place on Earth, and no pole."""
    return scene.crs is not None and not holds_pole(scene)


def shown_places(scene: Scene, points: FloatArray, coarser: int = 0) -> list[Any]:
    """``points`` (..., 2) [m] as rounded longitudes and latitudes, or as metres of a map that is no Earth.

    ``coarser`` digits are left out of those that positions have.
    """
    digits = metre_digits(scene) - coarser
    if on_earth(scene) and scene.crs is not None:
        return rounded(lonlat(scene.crs, points), DEGREE_DIGITS + digits)
    return rounded(points, digits)


def shown_map(scene: Scene) -> dict[str, Any]:
    """Closed outlines, start and border as the map shows them, and the times at which regions hold.

    ``exported`` says whether files can hold the outlines: not for maps that 180 degrees cut.
    """
    named = [("region", name, c) for name, parts in scene.regions.items() for c in parts]
    named += [("obstacle", scene.obstacle_title(n), c) for n, c in enumerate(scene.obstacles, 1)]
    named += [("landmark", f"landmark {n}", c) for n, c in enumerate(scene.landmarks, 1)]
    stride = max(1, -(-sum(len(corners) for _, _, corners in named) // MOST_CORNERS))
    named = [(role, name, c if len(c) < 3 * stride else c[::stride]) for role, name, c in named]
    named += [("bounds", f"border ({scene.border})", border_corners(scene.bounds))]
    earthly = on_earth(scene)
    shapes, cut = [], False
    for role, name, corners in named:
        if earthly and scene.crs is not None:
            ring = outline_degrees(scene.crs, corners, FENCE_SAG)
            shapes.append({"role": role, "name": name, "ring": rounded(ring, DEGREES)})
            cut |= crosses(ring)
        else:
            ring = np.concatenate([corners, corners[:1]])
            shapes.append({"role": role, "name": name, "ring": rounded(ring, metre_digits(scene))})
    return {
        "earthly": earthly,
        "shapes": shapes,
        "exported": earthly and not cut,
        "start": shown_places(scene, scene.start),
        "walled": scene.walled,
        "windows": [
            {"name": name, "forbidden": name in scene.forbidden, "told": str(window)} | window.as_dict()
            for name, window in scene.windows.items()
        ],
    }


def shown_wind(scene: Scene, wind: WindField, last: float) -> dict[str, Any]:
    """Expected wind and standard deviation on a lattice at up to ``MOST_TIMES`` times until ``last`` [s]."""
    i, j = arrow_nodes(wind, scene.bounds)
    x, y = lattice_nodes(wind)
    nodes = np.stack(np.meshgrid(x[i], y[j], indexing="ij"), axis=-1).reshape(-1, 2)
    times = np.linspace(0.0, last, MOST_TIMES) if last > 0.0 and len(wind.times) > 1 else np.zeros(1)
    mean = np.array([interpolate_slots(wind.times, wind.mean, t)[np.ix_(i, j)] for t in times])
    doubt = np.array([wind_deviation(wind, t)[np.ix_(i, j)] for t in times])
    turn = np.zeros(len(nodes))
    if on_earth(scene) and scene.crs is not None:  # arrows stand on a map with north at the top
        turn = meridian_convergence(scene.crs, *to_geographic(scene.crs, nodes))
    speed, bearing = np.hypot(mean[..., 0], mean[..., 1]), np.arctan2(mean[..., 0], mean[..., 1])
    bearing = bearing + turn.reshape(len(i), len(j))
    north = np.stack([speed * np.sin(bearing), speed * np.cos(bearing)], axis=-1)
    return {
        "t": rounded(times, 0),
        "utc": utc_times(scene.time_zero, times),
        "shape": [len(i), len(j)],
        "at": shown_places(scene, nodes),
        "uv": rounded(north.reshape(len(times), -1, 2), SPEED_DIGITS),  # [time][place], m/s
        "sd": rounded(doubt.reshape(len(times), -1), SPEED_DIGITS),
        "level": wind.level,
    }


def shown_trees(scene: Scene, forest: Forest | None) -> list[Any]:
    """The oldest edges of the trees, two places each, for a map without a plan."""
    if forest is None or not forest.trees:
        return []
    share = max(2, MOST_EDGES // len(forest.trees))
    edges: Iterable[FloatArray] = (
        np.stack([tree.x[tree.parent[1:share]], tree.x[1:share]], axis=1) for tree in forest.trees
    )
    return shown_places(scene, np.concatenate(list(edges)))
