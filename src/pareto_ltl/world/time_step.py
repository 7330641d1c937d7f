"""The time step for a map: ``robot.dt=auto``, and a warning for a step that is too long.

A step is too long if the robot crosses a region or a passage in one step. It is too short if a flight needs
more steps than a path may have.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray

from careful_io.texts import distance_text
from pareto_ltl.settings import RobotConfig
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.world.scene import Scene

LOG = logging.getLogger(__name__)

STEPS_ACROSS = 18.0  # smallest number of full steps along the longer side of a map
SHARE_OF_PLACE = 0.6  # largest full step as a share of the width of the narrowest region or passage
SLOW = 0.6  # assumed ground speed as a share of the largest airspeed
DETOUR = 1.5  # assumed length of a flight as a multiple of the tour of all regions
RASTER = 160  # cells along the longer side of the map on which passages are measured
READABLE = (
    *(m * 10.0**k for k in range(-3, 1) for m in (1.0, 2.0, 5.0)),
    10.0, 15.0, 20.0, 30.0, 60.0, 120.0, 180.0, 300.0, 600.0, 900.0, 1200.0, 1800.0,
    3600.0, 7200.0, 10_800.0, 21_600.0, 43_200.0, 86_400.0,
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Narrowest:
    """The narrowest region or passage of a map: its name in messages, and its width [m]."""

    what: str
    width: float


def with_time_step(robot: RobotConfig, scene: Scene, max_steps: int) -> RobotConfig:
    """``robot`` with a number for ``dt`` [s]: from the settings, or for ``auto`` one that fits the map.

    Logs the value of ``auto``, and a warning for a step that is longer than a region or a passage.
    """
    if isinstance(robot.dt, str):
        dt = fitting_step(robot, scene, max_steps)
        LOG.info("robot.dt=auto: %g s, a full step of %s", dt, distance_text(robot.u_max * dt))
        return replace(robot, dt=dt)
    if warning := too_long(robot, scene, max_steps):
        LOG.warning("%s", warning)
    return robot


def fitting_step(robot: RobotConfig, scene: Scene, max_steps: int) -> float:
    """The longest round time step [s], of ``READABLE``, with

        u_max dt <= min(side / 18, 0.6 width),    dt >= 1.5 tour / (0.6 u_max max_steps)

    where side is the longer side of the map without :attr:`Scene.room`, width the width of the narrowest
    region or passage, and tour the length of a tour of all regions. If both limits cannot be met, the second
    one has priority.

    Eq. (M70) of docs/mathematics_methods.md.
    """
    side = float(np.ptp(scene.bounds, axis=0).max()) - 2.0 * scene.room
    longest = min(side / STEPS_ACROSS, SHARE_OF_PLACE * narrowest_place(scene).width) / robot.u_max
    least = DETOUR * tour_length(scene) / (SLOW * robot.u_max * max_steps)
    below = [dt for dt in READABLE if dt <= longest * (1 + 1e-9)]
    dt = below[-1] if below else longest
    return dt if dt >= least else next((s for s in READABLE if s >= least), least)


def too_long(robot: RobotConfig, scene: Scene, max_steps: int, times: float = 1.0) -> str:
    """A message with a step that fits, or "" if a full step is at most ``times`` the narrowest place."""
    place, step = narrowest_place(scene), robot.u_max * float(robot.dt)
    if step <= times * place.width or (fits := fitting_step(robot, scene, max_steps)) >= robot.dt:
        return ""
    return (
        f"a full step of {distance_text(step)} (robot.dt={robot.dt:g} at {robot.u_max:g} m/s) is longer than "
        f"{place.what} is wide ({distance_text(place.width)}): set robot.dt={fits:g}, or robot.dt=auto"
    )


def narrowest_place(scene: Scene) -> Narrowest:
    """The narrowest region or, if narrower, the narrowest passage that a flight to all regions must use."""
    places = [
        Narrowest(f"region {name!r}", max(map(polygon_width, outlines)))
        for name, outlines in scene.regions.items()
        if outlines
    ]
    passage = passage_width(scene)
    if math.isfinite(passage):
        places.append(Narrowest("the narrowest passage between obstacles", passage))
    side = Narrowest("the map", float(np.ptp(scene.bounds, axis=0).min()))
    return min(places, key=lambda place: place.width, default=side)


def polygon_width(corners: FloatArray) -> float:
    """Smallest distance [m] between two parallel lines that enclose the polygon ``corners`` (n, 2) [m]."""
    along = np.roll(corners, -1, axis=0) - corners
    length = np.linalg.norm(along, axis=1)
    along = along[length > 0] / length[length > 0, None]
    across = np.stack([-along[:, 1], along[:, 0]]).T @ corners.T
    return float(np.ptp(across, axis=1).min())


def tour_length(scene: Scene) -> float:
    """Length [m] of a tour from the start to all regions, each time to the nearest region not yet visited."""
    regions = [
        [corners.mean(axis=0) for corners in outlines] for outlines in scene.regions.values() if outlines
    ]
    return tour_of(scene.start, regions)


def tour_of(start: FloatArray, regions: Sequence[Sequence[FloatArray]]) -> float:
    """:func:`tour_length` from ``start`` (2,) to one of the places (2,) of each of ``regions`` [m]."""
    here, left, total = np.asarray(start, float), list(regions), 0.0
    while left:
        gaps = [min(float(np.linalg.norm(place - here)) for place in places) for places in left]
        nearest = int(np.argmin(gaps))
        total += gaps[nearest]
        here = min(left.pop(nearest), key=lambda place: float(np.linalg.norm(place - here)))
    return total


def passage_width(scene: Scene) -> float:
    """Width [m] of the narrowest passage on the widest paths from the start to all regions; inf for none.

    It is measured on a raster: twice the largest clearance c for which the start and all regions are in one
    connected component of the points that are at least c from every obstacle. Points near the start or in a
    region are not limited.
    """
    if not scene.obstacles:
        return math.inf
    clearance, wide, spacing = _raster(scene)
    levels = np.unique(clearance[clearance > 0])
    low, high = -1, len(levels)
    while high - low > 1:  # connected at levels[low], not at levels[high]
        middle = (low + high) // 2
        if _all_connected((clearance >= levels[middle]) | (wide > 0), wide):
            low = middle
        else:
            high = middle
    if low == len(levels) - 1:
        return math.inf
    return 2.0 * float(levels[low]) if low >= 0 else spacing


def _raster(scene: Scene) -> tuple[FloatArray, NDArray[np.int64], float]:
    """Points on a raster over the map: their clearance, the places that they are in, and their spacing [m].

    The clearance (NX, NY) is the distance to the nearest obstacle [m], 0 inside one. Places (NX, NY) are 1
    near the start, 2, 3, ... in or near each region, and 0 elsewhere and in obstacles.
    """
    from scipy.ndimage import distance_transform_edt

    low, high = scene.bounds
    spacing = float((high - low).max()) / RASTER
    x, y = np.meshgrid(*(np.arange(low[k] + spacing / 2, high[k], spacing) for k in (0, 1)), indexing="ij")

    def covered(area: shapely.Geometry) -> NDArray[np.bool_]:
        shapely.prepare(area)
        return np.asarray(shapely.contains_xy(area, x, y))

    free = ~covered(shapely.union_all([shapely.Polygon(corners) for corners in scene.obstacles]))
    clearance = np.full(free.shape, math.inf)
    if not free.all():
        distance = np.asarray(distance_transform_edt(free, sampling=spacing), float)
        clearance = np.maximum(distance - spacing / 2, 0.0)
    regions = [map(shapely.Polygon, outlines) for outlines in scene.regions.values() if outlines]
    around = [shapely.buffer(shapely.Point(scene.start), 4.0 * spacing)]
    around += [shapely.buffer(shapely.MultiPolygon(list(parts)), spacing) for parts in regions]
    wide = np.zeros(free.shape, np.int64)
    for number, area in enumerate(around, start=1):
        wide[covered(area) & free] = number
    return clearance, wide, spacing


def _all_connected(open_points: NDArray[np.bool_], wide: NDArray[np.int64]) -> bool:
    """Whether one connected component of ``open_points`` contains points of the start and of every region."""
    from scipy.ndimage import label

    parts, _ = label(open_points)
    meets = [set(parts[wide == number].tolist()) - {0} for number in range(1, int(wide.max()) + 1)]
    return bool(set.intersection(*meets)) if all(meets) else False


def step_of(robot: RobotConfig, scene: Scene, max_steps: int) -> float:
    """The time step [s] of :func:`with_time_step`, without log messages."""
    return fitting_step(robot, scene, max_steps) if isinstance(robot.dt, str) else float(robot.dt)
