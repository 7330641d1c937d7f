"""A volume that a user gives: GeoJSON areas, or an operational intent as in ASTM F3548-21."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from careful_io.messages import shown_text
from careful_io.reading import MISSHAPEN, Advice, read_json
from pareto_ltl import DataError, Scene
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.departure import seconds_after
from pareto_ltl_apps.preflight.leaving import Area

ADVICE = Advice(
    missing="give a GeoJSON file with areas, or an operational intent (F3548)",
    damaged="write it again as GeoJSON",
)
NO_TIMES = -math.inf, math.inf


class Piece(NamedTuple):
    """A shapely area [m], active between two times [s after departure]."""

    area: Any
    first: float
    last: float


def given_area(path: Path, scene: Scene, t: FloatArray) -> Area:
    """The volume in ``path`` at each step of a plan with times ``t`` (T+1,) [s].

    During a step, a flight may be in all pieces that are active at some time of it.

    Raises
    ------
    DataError
        If the file is no such volume, or no piece is active during some step.
    """
    import shapely

    pieces = list(_pieces(path, read_json(path, ADVICE), scene))
    if not pieces:
        raise DataError(f"{path}: holds no area; {ADVICE.missing}")
    made: dict[tuple[int, ...], Any] = {}
    within = []
    for k in range(len(t) - 1):
        active = tuple(n for n, piece in enumerate(pieces) if piece.first < t[k + 1] and piece.last > t[k])
        if not active:
            raise DataError(
                f"{path}: no area is active {t[k] / 3600.0:.2f} h after departure, during step {k} of the "
                "plan; give areas for the whole flight"
            )
        if active not in made:
            made[active] = shapely.union_all([pieces[n].area for n in active])
        within.append(made[active])
    return Area(f"volume {path.name}", tuple(within))


def _pieces(path: Path, content: Mapping[str, Any], scene: Scene) -> Iterator[Piece]:
    try:
        if "volumes" in content:
            for volume in content["volumes"]:
                ring = [(v["lng"], v["lat"]) for v in volume["volume"]["outline_polygon"]["vertices"]]
                times = (volume[name]["value"] for name in ("time_start", "time_end"))
                yield Piece(_area(path, scene, [ring]), *(_seconds(path, scene, time) for time in times))
            return
        features = content.get("features", [content])
        for feature in features:
            shape, about = feature.get("geometry", feature), feature.get("properties") or {}
            named = zip(("time_start", "time_end"), NO_TIMES, strict=True)
            first, last = (
                end if about.get(name) is None else _seconds(path, scene, about[name]) for name, end in named
            )
            for rings in _polygons(shape):
                yield Piece(_area(path, scene, rings), first, last)
    except MISSHAPEN as error:
        reason = shown_text(f"{type(error).__name__} {error}")
        raise DataError(f"{path}: not as expected ({reason}); {ADVICE.missing}") from None


def _polygons(shape: Mapping[str, Any]) -> Sequence[Any]:
    """The polygons of a GeoJSON geometry, each a list of rings; none for points and lines."""
    kinds: dict[str, Sequence[Any]] = {
        "Polygon": [shape["coordinates"]], "MultiPolygon": shape["coordinates"],
    }  # fmt: skip
    return kinds.get(shape["type"], [])


def _area(path: Path, scene: Scene, rings: Sequence[Any]) -> Any:
    """A shapely area [m] of rings in degrees; in metres on a map without a place on Earth."""
    import shapely

    plane = [np.array([place[:2] for place in ring], float) for ring in rings]
    if scene.crs is not None:
        plane = [scene.frame.to_plane(ring[:, 0], ring[:, 1]) for ring in plane]
    area = shapely.Polygon(plane[0], plane[1:])
    if not shapely.is_valid(area) or shapely.area(area) == 0.0:
        reason = shapely.is_valid_reason(area)
        raise DataError(f"{path}: an area is not a simple polygon ({reason}); draw it without crossing lines")
    return area


def _seconds(path: Path, scene: Scene, time: Any) -> float:
    """A time in UTC, or after departure, as seconds after the departure."""
    return seconds_after(f"{path}: a time", time, scene.time_zero)
