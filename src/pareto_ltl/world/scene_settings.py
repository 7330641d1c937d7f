"""Turns the settings of section ``scene`` into a checked scene in metres; adds random places."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from string import ascii_lowercase
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.random import Generator

from careful_io.faults import Faults
from careful_io.files import write_json
from careful_io.messages import shown_text
from careful_io.texts import distance_text, listed_text
from careful_io.times import lacks_zone
from flight_quantities import frames
from flight_quantities.heights import Height
from pareto_ltl.settings import SceneConfig
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl.support.resources import CONF
from pareto_ltl.world import scene_sketch as sk
from pareto_ltl.world.projection import Frame
from pareto_ltl.world.scene import Scene
from pareto_ltl.world.scene_checks import LARGE_ERROR, checked_scene
from pareto_ltl.world.scene_files import sketch_file
from pareto_ltl.world.scene_sketch import DrawingRules, MissionUse, SceneSketch, SkyRoom, unknown_use
from pareto_ltl.world.time_step import tour_of

LOG = logging.getLogger(__name__)
PLACEMENT_TRIES = 20_000  # random positions tried for one disc
SHRINK = 0.9  # of the room around a drawing, until its plane is good enough
CORNER_RANGE = (5, 9)  # of a polygon: smallest number, largest number + 1

PlacedDisc = tuple[float, float, float]


def scene_from_settings(
    cfg: SceneConfig,
    time_zero: str | None = None,
    border: str = "open",
    use: Callable[[], MissionUse | None] = unknown_use,
    height: Height | None = None,
    room: Callable[[float], SkyRoom] | None = None,
) -> Scene:
    """The checked scene of ``cfg``, in metres.

    Parameters
    ----------
    cfg : SceneConfig
        If ``file`` is set, the scene is read from the file. Otherwise positions are

            x = (coordinate - c) * unit

        with c the middle of the bounds if ``centre`` is set, else 0.
    time_zero : str or None
        Departure, ISO 8601 UTC; None keeps the departure of the file.
    border : str
        The value of ``cfg.border = auto`` if the map file has none.
    use : callable
        How the mission uses the regions, see :class:`DrawingRules`.
    height : Height or None
        Of the flight; places above or below it are left out.
    room : callable or None
        The room around the drawing of a map without a border, from the length of a tour of its regions [m];
        None: the least, :func:`open_bounds`.

    Raises
    ------
    DataError
        If the scene is incomplete or inconsistent.
    """
    sketch = _sketch(cfg)
    sketch.unread.log(sketch.where)
    if sketch.drawing is not None:
        sketch = _with_room(sketch, room, walled=cfg.border == "wall")
    known = _known_border(cfg, sketch, border)
    departure, faults = time_zero or sketch.time_zero, Faults(sketch.where, sketch.faults)
    times = faults.each(sketch.timed, lambda place: place.window(sketch.where, departure))
    windows = {place.name: window for place, window in times}
    zoneless = [place.name for place in sketch.timed if any(map(lacks_zone, (place.begin, place.end)))]
    if zoneless:
        LOG.warning(
            "%s: times of %s state no zone and are taken as UTC; write 2018-10-09T18:00:00Z, or the offset: "
            "2018-10-09T13:00:00-05:00", sketch.where, shown_text(listed_text(zoneless)),
        )  # fmt: skip
    sketch = replace(sketch, faults=tuple(faults.texts))
    scene = checked_scene(
        sketch,
        DrawingRules(
            use, cfg.simplify, cfg.altitude if height is None else height, cfg.ground, known == "wall"
        ),
    )
    forbidden = tuple(place.name for place in sketch.timed if place.forbidden)
    return replace(scene, time_zero=departure, border=known, windows=windows, forbidden=forbidden)


def read_map(path: Any, altitude: float | None = None) -> Scene:
    """The checked map of a file: GeoJSON, KML, KMZ, a run's ``scene.json``; of features; or a ready map.

    Parameters
    ----------
    path : str, Path, GeoDataFrame or another object with ``__geo_interface__``
        Ready maps are ``"hop"`` (36.7 to 37.3° N, 91.5 to 92.5° W), and ``"phi1"``, ``"phi2"`` and
        ``"random"`` (32.4 to 41.5° N, 86.0 to 98.0° W). Columns of a GeoDataFrame are properties of its
        features: ``role`` and ``name``.
    altitude : float, optional
        Height of the flight [m], in the datum of the map: places that are not active there are left out.

    Raises
    ------
    DataError
        If the file cannot be read or the map has faults; one message names all of them.
    """
    if isinstance(path, Scene) and altitude is None:
        return path
    if not hasattr(path, "__geo_interface__"):
        from pareto_ltl.settings import Settings

        named = path in CONF.names("scene")
        ready = Settings.of_section("scene", path) if named else SceneConfig(file=str(path))
        assert isinstance(ready, SceneConfig)
        if altitude is not None:
            ready = replace(ready, altitude=altitude)
        return scene_from_settings(add_random_places(ready))
    if getattr(path, "crs", None) is not None and hasattr(path, "to_crs"):
        path = path.to_crs("EPSG:4326")  # of GeoPandas, in any system
    with TemporaryDirectory(prefix="pareto_ltl_") as folder:
        file = Path(folder) / "features.geojson"
        write_json(file, path.__geo_interface__)
        try:
            return scene_from_settings(SceneConfig(file=str(file), altitude=altitude))
        except DataError as error:
            text = str(error).replace(f"scene file {file}", "the given features")
            raise DataError(text.replace(str(file), "the given features")) from None


def _known_border(cfg: SceneConfig, sketch: SceneSketch, border: str) -> str:
    """Whether leaving the map is a failure; never by default if its author drew no border."""
    if cfg.border != "auto":
        return cfg.border
    return "open" if sketch.drawing is not None else sketch.border or border


def _with_room(sketch: SceneSketch, room: Callable[[float], SkyRoom] | None, *, walled: bool) -> SceneSketch:
    """A map without a border with room for flights around its drawing; one line says how much.

    The plane limits the room: at its corners, lengths are wrong by 1 % at most.
    """
    assert sketch.drawing is not None
    needed = SkyRoom(0.0, "")
    names = dict.fromkeys(place.name for place in sketch.regions if not place.solid)
    if room is not None and len(sketch.start) and names:
        centres = [[p.corners.mean(axis=0) for p in sketch.regions if p.name == name] for name in names]
        needed = room(tour_of(sketch.start, centres))
    margin, bounds = needed.margin, sk.open_bounds(sketch.drawing, needed.margin)
    while margin > 1.0 and Frame(sketch.crs).scale_error(bounds) > LARGE_ERROR:
        margin *= SHRINK
        bounds = sk.open_bounds(sketch.drawing, margin)
    if margin < (least := sk.least_room(sketch.drawing)):
        margin, needed = least, SkyRoom(least, f"{100 * sk.LEAST_ROOM:g} % of its longer side")
    elif margin < needed.margin:
        needed = SkyRoom(margin, "as far as lengths in the plane of the map are right to 1 %")
    if not walled:
        LOG.info(
            "%s: it has no border, so the sky is open: leaving the map is no failure; plans lie within %s of "
            "the drawing (%s); draw a border to make one", sketch.where, distance_text(margin), needed.reason,
        )  # fmt: skip
    return replace(sketch, bounds=bounds, room=margin - least)


def scene_sketch(cfg: SceneConfig) -> SceneSketch:
    """The map of ``cfg`` in metres, before the checks of the complete map; DataError if not readable."""
    sketch = _sketch(cfg)
    Faults(sketch.where, sketch.faults).refuse()
    return sketch


def _sketch(cfg: SceneConfig) -> SceneSketch:
    if cfg.file:
        return sketch_file(Path(cfg.file).expanduser(), cfg.zones, cfg.roles)
    if cfg.zones:
        raise ConfigError("scene.zones are added to the map of scene.file, which is not set: name a map file")
    return _sketch_settings(cfg)


def _sketch_settings(cfg: SceneConfig) -> SceneSketch:
    where = f"scene {cfg.name!r}"
    faults = Faults(where)
    bounds = faults.tried(lambda: sk.read_bounds(where, "scene.bounds", cfg.bounds))
    start = faults.tried(lambda: sk.read_start(where, "scene.start", cfg.start))
    middle = np.zeros(2) if bounds is None or cfg.centre is None else bounds.mean(axis=0)

    def metres(corners: FloatArray) -> FloatArray:
        return (corners - middle) * cfg.unit

    def show(point: FloatArray) -> str:
        x, y = point / cfg.unit + middle
        return f"({x:.6g}, {y:.6g})"

    regions = sk.read_places(faults, "region", cfg.regions.items(), metres)
    obstacles = sk.read_places(faults, "obstacle", sk.numbered_outlines(cfg.obstacles), metres)
    landmarks = sk.read_places(faults, "landmark", sk.numbered_outlines(cfg.landmarks), metres)
    timed = faults.tried(lambda: tuple(sk.read_timed(where, cfg.windows, cfg.regions))) or ()
    if bounds is None:
        faults.refuse()
    assert bounds is not None
    return SceneSketch(
        where=where,
        bounds=metres(bounds),
        start=np.zeros(0) if start is None else metres(start),
        regions=regions,
        obstacles=obstacles,
        show=show,
        crs=frames.local_plane(*cfg.centre) if cfg.centre is not None else None,
        landmarks=landmarks,
        timed=timed,
        faults=tuple(faults.texts),
    )


# --- random places ----------------------------------------------------------------------------------


def add_random_places(cfg: SceneConfig) -> SceneConfig:
    """``cfg`` with the random regions and obstacles of ``cfg.random`` added, in the units of the scene.

    Each is a convex polygon with corners on a random circle. The circles are at least ``random.gap`` apart
    from each other, from the start, and from the named regions and obstacles, so that every region can be
    reached. The same ``random.seed`` gives the same map.

    Raises
    ------
    ConfigError
        If there is no free position for one of them.
    """
    wanted = cfg.random
    if wanted.regions + wanted.obstacles == 0:
        return cfg
    rng = np.random.default_rng(wanted.seed)
    circles = _existing_discs(cfg)
    polygons = []
    for _ in range(wanted.regions + wanted.obstacles):
        circles.append(_free_disc(rng, cfg, circles))
        polygons.append(_inscribed_polygon(rng, circles[-1]))
    names = [name for name in ascii_lowercase if name not in cfg.regions][: wanted.regions]
    return replace(
        cfg,
        regions={**cfg.regions, **dict(zip(names, polygons, strict=False))},
        obstacles=[*cfg.obstacles, *polygons[wanted.regions :]],
        random=replace(wanted, regions=0, obstacles=0),
    )


def _existing_discs(cfg: SceneConfig) -> list[PlacedDisc]:
    """Discs around the start and around the regions and obstacles of ``cfg``."""
    circles: list[PlacedDisc] = [(float(cfg.start[0]), float(cfg.start[1]), 0.0)] if cfg.start else []
    for polygon in (*cfg.regions.values(), *cfg.obstacles):
        corners = np.array(polygon, float)
        middle = corners.mean(axis=0)
        circles.append((*middle, float(np.linalg.norm(corners - middle, axis=1).max())))
    return circles


def _free_disc(rng: Generator, cfg: SceneConfig, circles: list[PlacedDisc]) -> PlacedDisc:
    low, high = np.array(cfg.bounds, float)
    side = float((high - low).min())
    gap, (smallest, largest) = cfg.random.gap * side, cfg.random.radius
    others = np.array(circles).reshape(-1, 3)
    for _ in range(PLACEMENT_TRIES):
        radius = side * rng.uniform(smallest, largest)
        middle = rng.uniform(low + radius + gap, high - radius - gap)
        apart = np.linalg.norm(others[:, :2] - middle, axis=1)
        if np.all(apart >= others[:, 2] + radius + gap):
            return float(middle[0]), float(middle[1]), float(radius)
    raise ConfigError(
        f"scene.random: {cfg.random.regions} regions and {cfg.random.obstacles} obstacles do not fit the "
        f"map; ask for fewer, for a smaller scene.random.radius (now {cfg.random.radius}) or gap"
    )


def _inscribed_polygon(rng: Generator, circle: PlacedDisc) -> list[list[float]]:
    """Corners of a convex polygon on the circle, one at a random position in each of several equal arcs."""
    x, y, radius = circle
    corners = int(rng.integers(*CORNER_RANGE))
    angles = 2 * np.pi * (np.arange(corners) + rng.uniform(0.1, 0.9, corners)) / corners
    return [[x + radius * float(np.cos(a)), y + radius * float(np.sin(a))] for a in angles]
