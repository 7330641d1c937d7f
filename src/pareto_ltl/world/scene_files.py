"""Map files in degrees, and the ``scene.json`` and ``cells.json`` of a run in metres."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from careful_io.faults import Faults
from careful_io.files import write_json
from careful_io.messages import shown_text, shown_value
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import DataError
from pareto_ltl.support.schemas import check_document
from pareto_ltl.support.stored import stored
from pareto_ltl.world import scene_sketch as sk
from pareto_ltl.world.cells import Decomposition
from pareto_ltl.world.map_formats import MapFormats, map_formats
from pareto_ltl.world.scene import AbsentPlace, Scene, read_fix
from pareto_ltl.world.scene_shapes import refuse_crossings
from pareto_ltl.world.scene_sketch import Place, SceneSketch
from pareto_ltl.world.windows import TimedPlace, Window


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
    """The keys that only some maps have, such as windows, names and absent places."""
    windows = {name: window.as_dict() for name, window in scene.windows.items()}
    timed = {"windows": windows, "forbidden": list(scene.forbidden)} if windows else {}
    names = {"obstacle_names": list(scene.obstacle_names)} if scene.obstacle_names else {}
    shapes = [fix and fix.document for fix in scene.landmark_fixes]
    fixes = {"landmark_fixes": shapes} if shapes else {}
    absent = {"absent": [place.as_dict() for place in scene.absent]} if scene.absent else {}
    moved = {"simplified": scene.simplified} if scene.simplified else {}
    room = {"room": scene.room} if scene.room else {}
    return timed | names | fixes | moved | absent | room


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
        regions={name: _polygons(_region_parts(listed)) for name, listed in data["regions"].items()},
        obstacles=_polygons(data["obstacles"]),
        crs=data.get("crs"),
        time_zero=data.get("time_zero"),
        landmarks=_polygons(data.get("landmarks") or ()),
        border=data.get("border") or "open",
        windows={name: Window.from_dict(window) for name, window in (data.get("windows") or {}).items()},
        forbidden=tuple(data.get("forbidden") or ()),
        simplified=data.get("simplified") or 0.0,
        obstacle_names=tuple(data.get("obstacle_names") or ()),
        landmark_fixes=tuple(
            read_fix("scene.json", f"landmark {number}", fix)
            for number, fix in enumerate(data.get("landmark_fixes") or (), 1)
        ),
        absent=_absent(data),
        room=data.get("room") or 0.0,
    )


def _absent(data: Mapping[str, Any]) -> tuple[AbsentPlace, ...]:
    return tuple(map(AbsentPlace.from_dict, data.get("absent") or ()))


def sketch_file(path: Path, zones: Sequence[str] = (), roles: Any = ()) -> SceneSketch:
    """The map of a file, with the features of the files ``zones``; ``roles`` are ``scene.roles``.

    DataError for a damaged file, or one that is no map.
    """
    found = map_formats().read(path, zones, roles)
    return found if isinstance(found, SceneSketch) else _sketch_results(path, found)


def _sketch_results(path: Path, data: Mapping[str, Any]) -> SceneSketch:
    check_document(data, "scene", str(path), MapFormats.ADVICE)
    where = f"scene file {path}"
    faults = Faults(where)
    _check_departure(where, data.get("time_zero"))
    landmarks = data.get("landmarks") or ()
    obstacles = sk.numbered_outlines(data.get("obstacles", ()))
    names, fixes = data.get("obstacle_names") or (), data.get("landmark_fixes") or ()
    if names and len(names) != len(obstacles):
        faults.add(f"{where}: {len(names)} obstacle_names for {len(obstacles)} obstacles")
    elif names:
        obstacles = [(name or key, drawn) for (key, drawn), name in zip(obstacles, names, strict=True)]
    if fixes and len(fixes) != len(landmarks):
        faults.add(f"{where}: {len(fixes)} landmark_fixes for {len(landmarks)} landmarks")
    elif fixes:
        landmarks = [{"corners": drawn, "fix": fix} for drawn, fix in zip(landmarks, fixes, strict=True)]
    windows, forbidden = data.get("windows") or {}, data.get("forbidden") or ()
    for name, window in windows.items():
        if (region := window["region"]) not in data["regions"]:
            regions = ", ".join(data["regions"]) or "none"
            faults.add(
                f"{where}: window {shown_text(name)!r} is of {shown_value(region)}; regions are {regions}"
            )
    for name in sorted(set(forbidden) - set(windows)):
        faults.add(f"{where}: forbidden lists {shown_value(name)}, but windows has no such name")
    return SceneSketch(
        where=where,
        bounds=sk.read_bounds(where, "bounds", data["bounds"]),
        start=sk.read_start(where, "start", data.get("start") or []),
        regions=tuple(
            place
            for name, drawn in data["regions"].items()
            for place in (
                sk.read_places(faults, "region", [(name, drawn)], np.copy)
                if drawn
                else [Place(name, sk.called("region", name))]
            )
        ),
        obstacles=sk.read_places(faults, "obstacle", obstacles, np.copy),
        show=lambda point: f"({point[0]:.6g} m, {point[1]:.6g} m)",
        crs=data.get("crs"),
        time_zero=data.get("time_zero"),
        landmarks=sk.read_places(faults, "landmark", sk.numbered_outlines(landmarks), np.copy),
        border=data.get("border"),
        timed=tuple(
            TimedPlace(name, w["region"], w.get("begin"), w.get("end"), name in forbidden)
            for name, w in windows.items()
        ),
        simplified=data.get("simplified") or 0.0,
        absent=_absent(data),
        room=data.get("room") or 0.0,
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


def _polygons(lists: Sequence[Any]) -> tuple[FloatArray, ...]:
    return tuple(np.array(polygon, float) for polygon in lists)
