"""Places in degrees as a map in a plane: the plane, the bounds and the edges."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import shapely

from careful_io.faults import Faults
from careful_io.reading import shown_json
from pareto_ltl.extend import Frame, Place, SceneSketch, open_bounds
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import DataError
from pareto_ltl_apps.formats.map_edges import straight_in_degrees, unwrapped
from pareto_ltl_apps.formats.map_features import Drawn, FeatureReader
from pareto_ltl_apps.formats.map_file import MapFile
from pareto_ltl_apps.formats.map_roles import FEATURE_ROLES

RECTANGULAR = 1e-9  # a border is a rectangle if it lacks at most this share of its bounding box


def sketch_features(files: Sequence[MapFile], reader: FeatureReader) -> SceneSketch:
    """Convert features to a map in a plane centred on it, with edges straight in longitude and latitude.

    Coordinates in another system are converted to degrees first. Features that are not valid are faults of
    the map and left out; DataError if none is valid.
    """
    where, found = files[0].where, list[Drawn]()
    faults = Faults(where)
    for file in files:
        if not isinstance(file.features, list):
            raise DataError(
                f"{file.where}: /features: expected an array of features, got {shown_json(file.features)}"
            )
        found += reader.read(file, faults)
    if not found:
        faults.refuse()
        raise DataError(f"{where} has no features; expected a role ({', '.join(FEATURE_ROLES)}) on each")
    roles = [role for role, _, _ in found]
    places = unwrapped([place for _, place, _ in found])
    borders = [place for role, place in zip(roles, places, strict=True) if role == "border"]
    border = borders[0] if borders else None
    box = _bounding_box(np.concatenate([place.corners for place in (borders or places)]))
    crs = str(Frame.at(*box.mean(axis=0)[::-1].tolist()).crs)

    def metres(corners: FloatArray) -> FloatArray:
        return Frame(crs).to_plane(*corners.T)

    size = float(np.ptp(metres(np.concatenate([place.corners for place in places])), axis=0).max())
    barriers = [role in ("obstacle", "border") for role in roles]
    places = straight_in_degrees([_turned(crs, place) for place in places], metres, size, barriers)
    flat = [place.moved(metres) for place in places]

    def all_of(wanted: str) -> tuple[Place, ...]:
        return tuple(place for role, place in zip(roles, flat, strict=True) if role == wanted)

    starts, fences = all_of("start"), all_of("border")
    reach = np.concatenate([_reach(place) for place in flat])
    bounds = _bounding_box(reach) if border is None else _bounding_box(fences[0].corners)
    with faults.noted():
        if border is None:
            bounds = open_bounds(_bounding_box(reach))
        elif _is_rectangle(border):
            bounds = _rectangle_bounds(where, border, metres)
    return SceneSketch(
        where=where,
        bounds=bounds,
        start=starts[0].lines[0].reshape(-1) if starts else np.zeros(0),
        regions=all_of("region"),
        obstacles=all_of("obstacle"),
        show=partial(_shown, crs),
        crs=crs,
        landmarks=all_of("landmark"),
        fence=None if border is None or _is_rectangle(border) else fences[0],
        timed=tuple(window for _, _, window in found if window is not None),
        faults=tuple(faults.texts),
        unread=reader.unread,
        drawing=_bounding_box(reach) if border is None else None,
    )


def _shown(crs: str, point: FloatArray) -> str:
    lon, lat = Frame(crs).to_geographic(point[None])
    return f"(longitude {lon[0]:.6g}, latitude {lat[0]:.6g})"


def _turned(crs: str, place: Place) -> Place:
    """``place`` with the bearing of its fix from the y axis of the plane instead of true north."""
    if place.fix is None or math.isnan(place.fix.bearing):
        return place
    turn = math.degrees(float(Frame(crs).convergence(*place.corners.mean(axis=0)[:, None])[0]))
    return replace(place, fix=place.fix._replace(bearing=place.fix.bearing - turn))


def _rectangle_bounds(where: str, border: Place, metres: Callable[[FloatArray], FloatArray]) -> FloatArray:
    """Bounds (2, 2) [m]: the box around a rectangular ``border`` [deg], moved inwards by its buffer."""
    low, high = _bounding_box(metres(_subdivided_outline(border.polygons[0][0])))
    bounds = np.stack([low + border.buffer, high - border.buffer])
    if (bounds[0] >= bounds[1]).any():
        raise DataError(f"{where}: nothing is left of the border within its buffer of {border.buffer:g} m")
    return bounds


def _reach(place: Place) -> FloatArray:
    """Corners of ``place`` [m], and points that bound its lines and points with their buffer."""
    aside = [line + side * place.buffer for line in place.lines for side in (-1.0, 1.0)]
    return np.concatenate([place.corners, *aside])


def _is_rectangle(border: Place) -> bool:
    """Whether the sides of a border are meridians and parallels."""
    polygon = shapely.Polygon(border.polygons[0][0])
    box = shapely.envelope(polygon).area
    return bool(polygon.area >= (1 - RECTANGULAR) * box)


def _subdivided_outline(corners: FloatArray) -> FloatArray:
    """``corners`` with further points along each edge, since parallels are curved in the plane."""
    steps = np.linspace(0, 1, 33)[:-1, None]
    return np.concatenate(
        [a + steps * (b - a) for a, b in zip(corners, np.roll(corners, -1, 0), strict=True)]
    )


def _bounding_box(points: FloatArray) -> FloatArray:
    return np.stack([points.min(axis=0), points.max(axis=0)])
