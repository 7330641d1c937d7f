"""Map files: GeoJSON and KML in degrees, and the ``scene.json`` and ``cells.json`` of a run in metres."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from pareto_ltl.support.archives import stored
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import DataError
from pareto_ltl.support.files import write_json
from pareto_ltl.support.messages import shown_text
from pareto_ltl.support.reading import Advice, parse_json, read_bounded, refuse_many_features
from pareto_ltl.support.schemas import check_document
from pareto_ltl.world.cells import Decomposition
from pareto_ltl.world.fix_shapes import fix_document, read_fix
from pareto_ltl.world.scene import Scene
from pareto_ltl.world.scene_faults import MapFaults
from pareto_ltl.world.scene_geojson import crs_name, sketch_features
from pareto_ltl.world.scene_kml import SUFFIXES, kml_features
from pareto_ltl.world.scene_shapes import refuse_crossings
from pareto_ltl.world.scene_sketch import (
    Place,
    SceneSketch,
    called,
    numbered_outlines,
    read_bounds,
    read_landmarks,
    read_places,
    read_start,
)
from pareto_ltl.world.windows import TimedPlace, Window

SCENE_FILES = Advice("check scene.file", "correct the map: GeoJSON, KML or a run's scene.json")


def scene_to_dict(scene: Scene) -> dict[str, Any]:
    """``scene`` as dicts and lists, the content of ``scene.json``."""
    return {
        "bounds": scene.bounds.tolist(),
        "start": scene.start.tolist(),
        "regions": {name: _listed_region(outlines) for name, outlines in scene.regions.items()},
        "obstacles": [polygon.tolist() for polygon in scene.obstacles],
        "landmarks": [polygon.tolist() for polygon in scene.landmarks],
        "border": scene.border,
        "crs": scene.crs,
        "time_zero": scene.time_zero,
    } | _added(scene)


def _added(scene: Scene) -> dict[str, Any]:
    """The keys that only some maps have: windows, forbidden, simplified, names and fixes."""
    windows = {name: window.as_dict() for name, window in scene.windows.items()}
    timed = {"windows": windows, "forbidden": list(scene.forbidden)} if windows else {}
    names = {"obstacle_names": list(scene.obstacle_names)} if scene.obstacle_names else {}
    fixes = {"landmark_fixes": list(map(fix_document, scene.landmark_fixes))} if scene.landmark_fixes else {}
    return timed | names | fixes | ({"simplified": scene.simplified} if scene.simplified else {})


def _listed_region(outlines: tuple[FloatArray, ...]) -> list[Any]:
    """A region with one outline as that outline, any other as a list of outlines."""
    parts = [outline.tolist() for outline in outlines]
    return parts[0] if len(parts) == 1 else parts


def _region_parts(listed: list[Any]) -> list[Any]:
    """The list of outlines; the inverse of :func:`_listed_region`."""
    return listed if not listed or isinstance(listed[0][0], list) else [listed]


def scene_from_dict(data: Mapping[str, Any]) -> Scene:
    """The inverse of :func:`scene_to_dict`, exact to the bit; DataError if a key is missing."""
    missing = [key for key in ("bounds", "start", "regions", "obstacles") if key not in data]
    if missing:
        raise DataError(f"scene.json lacks {', '.join(missing)}; was it written by this program?")
    _check_departure("scene.json", data.get("time_zero"))
    return Scene(
        bounds=np.array(data["bounds"], float),
        start=np.array(data["start"], float),
        regions={
            name: tuple(np.array(part, float) for part in _region_parts(listed))
            for name, listed in data["regions"].items()
        },
        obstacles=tuple(np.array(polygon, float) for polygon in data["obstacles"]),
        crs=data.get("crs"),
        time_zero=data.get("time_zero"),
        landmarks=tuple(np.array(polygon, float) for polygon in data.get("landmarks") or ()),
        border=data.get("border") or "open",
        windows={name: Window.from_dict(window) for name, window in (data.get("windows") or {}).items()},
        forbidden=tuple(data.get("forbidden") or ()),
        simplified=data.get("simplified") or 0.0,
        obstacle_names=tuple(data.get("obstacle_names") or ()),
        landmark_fixes=tuple(
            read_fix("scene.json", f"landmark {number}", fix)
            for number, fix in enumerate(data.get("landmark_fixes") or (), 1)
        ),
    )


def sketch_file(path: Path) -> SceneSketch:
    """The map of a GeoJSON, KML, KMZ or ``scene.json`` file; DataError for any other or a damaged file."""
    if path.suffix.lower() in SUFFIXES:
        faults = MapFaults(f"scene file {path}")
        return sketch_features(faults, kml_features(path, SCENE_FILES, faults), None)
    where, content = f"scene file {path}", read_bounded(path, SCENE_FILES)
    refuse_many_features(where, content, b'"geometry"')
    data = parse_json(content, str(path), SCENE_FILES)
    if isinstance(data, dict) and data.get("type") == "FeatureCollection":
        return sketch_features(MapFaults(where), data.get("features", []), crs_name(where, data.get("crs")))
    if isinstance(data, dict) and "bounds" in data:
        return _sketch_results(path, data)
    raise DataError(
        f"{where} is neither a GeoJSON FeatureCollection nor a run's scene.json; expected one of the two"
    )


def _sketch_results(path: Path, data: Mapping[str, Any]) -> SceneSketch:
    check_document(data, "scene", str(path), SCENE_FILES)
    where = f"scene file {path}"
    faults = MapFaults(where)
    _check_departure(where, data.get("time_zero"))
    names = data.get("obstacle_names") or ()
    if names and len(names) != len(data["obstacles"]):
        faults.add(f"{where}: {len(names)} obstacle_names for {len(data['obstacles'])} obstacles")
    obstacles, landmarks = numbered_outlines(data.get("obstacles", ())), data.get("landmarks") or ()
    fixes = data.get("landmark_fixes") or ()
    if fixes and len(fixes) != len(landmarks):
        faults.add(f"{where}: {len(fixes)} landmark_fixes for {len(landmarks)} landmarks")
        fixes = ()
    if not faults.texts and names:
        obstacles = [(name or key, drawn) for (key, drawn), name in zip(obstacles, names, strict=True)]
    return SceneSketch(
        where=where,
        bounds=read_bounds(where, "bounds", data["bounds"]),
        start=read_start(where, "start", data.get("start") or []),
        regions=tuple(
            place
            for name, drawn in data["regions"].items()
            for place in (
                read_places(faults, "region", [(name, drawn)], np.copy)
                if drawn
                else [Place(name, called("region", name))]
            )
        ),
        obstacles=read_places(faults, "obstacle", obstacles, np.copy),
        show=lambda point: f"({point[0]:.6g} m, {point[1]:.6g} m)",
        crs=data.get("crs"),
        time_zero=data.get("time_zero"),
        landmarks=read_landmarks(faults, landmarks, fixes, np.copy),
        border=data.get("border"),
        timed=tuple(
            TimedPlace(name, w["region"], w.get("begin"), w.get("end"), name in (data.get("forbidden") or ()))
            for name, w in (data.get("windows") or {}).items()
        ),
        simplified=data.get("simplified") or 0.0,
        faults=tuple(faults.texts),
    )


def _check_departure(where: str, time_zero: str | None) -> None:
    try:
        datetime.fromisoformat("2000-01-01" if time_zero is None else time_zero)
    except ValueError:
        raise DataError(
            f"{where}: time_zero is {shown_text(repr(time_zero))}; expected an ISO 8601 time such as "
            "2018-10-09T18:00:00Z"
        ) from None


# --- files of a run ----------------------------------------------------------------------------


def write_scene(directory: Path, scene: Scene) -> None:
    """Write ``scene.json``."""
    write_json(directory / "scene.json", scene_to_dict(scene))


def read_scene(place: Path | str) -> Scene:
    """The map of ``scene.json``, a file or the directory that has it."""
    with stored(place, "scene.json", "a scene", "scene") as content:
        scene = scene_from_dict(content)
        refuse_crossings((*scene.region_outlines, *scene.obstacles, *scene.landmarks))
        return scene


def write_cells(directory: Path, decomposition: Decomposition) -> None:
    """Write ``cells.json``."""
    write_json(directory / "cells.json", asdict(decomposition))


def read_cells(place: Path | str) -> Decomposition:
    """The cells of ``cells.json``, a file or the directory that has it."""
    with stored(place, "cells.json", "a decomposition", "cells") as content:
        return Decomposition(
            cells=_polygons(content["cells"]),
            labels=tuple(frozenset(label) for label in content["labels"]),
            doors=np.array(content["doors"], np.int64).reshape(-1, 2),
            obstacles=_polygons(content["obstacles"]),
            regions={name: _polygons(parts) for name, parts in content["regions"].items()},
        )


def _polygons(lists: list[Any]) -> tuple[FloatArray, ...]:
    return tuple(np.array(polygon, float) for polygon in lists)
