"""From a request to the settings of a command line; maps read before planning."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pareto_ltl
from careful_io.messages import shown_value
from careful_io.reading import shown_json
from pareto_ltl.support.errors import ConfigError, DataError, NotFoundError
from pareto_ltl.support.resources import CONF
from pareto_ltl_apps.desk.allowed import parted, setting_words
from pareto_ltl_apps.desk.folder import DeskFolder
from pareto_ltl_apps.formats.opened_map import opened_features
from pareto_ltl_apps.view.page.ground import shown_map

COMMANDS = ("plan", "departure", "wind")
EXAMPLES = ("hop", "phi1", "phi2")
SUFFIX = re.compile(r"\.[a-z0-9]{1,12}")  # of a map that is kept


def command_words(folder: DeskFolder, request: Mapping[str, Any]) -> list[str]:
    """Command and settings for the body of ``POST /api/plans``; the map is kept in ``folder``.

    Raises
    ------
    ConfigError
        If the request is not of the documented form, or a setting leads out of the folder.
    """
    if (command := request.get("command", COMMANDS[0])) not in COMMANDS:
        raise ConfigError(f"command must be one of {', '.join(COMMANDS)}, got {shown_json(command)}")
    words, given = request.get("overrides", []), request.get("settings", {})
    if not isinstance(words, list) or not all(isinstance(word, str) for word in words):
        raise ConfigError(f"overrides must be a list of texts KEY=VALUE, got {shown_json(words)}")
    if not isinstance(given, dict):
        raise ConfigError(f"settings must be an object, from keys to values, got {shown_json(given)}")
    pairs = [*given.items(), *map(parted, words)]
    if (formula := request.get("formula")) is not None:
        pairs.append(("mission.formula", formula))
    found = setting_words(folder, pairs)
    if (drawn := request.get("map")) is not None:
        if not isinstance(drawn, dict):
            raise ConfigError(f"map must be a GeoJSON FeatureCollection, got {shown_json(drawn)}")
        text = json.dumps(drawn, ensure_ascii=False, sort_keys=True, indent=1) + "\n"  # same map, same bytes
        found = setting_words(folder, [*pairs, ("scene.file", folder.keep_map(text.encode()))])
    if not found:
        raise ConfigError("there is nothing to plan: give settings, or a map and a formula")
    return [command, *found]


def read_map(folder: DeskFolder, name: str, content: bytes, role: str = "") -> dict[str, Any]:
    """The features of a map file, with roles, in degrees, and ``warnings`` of what was not read.

    ``role`` is the role of features that state none.

    DataError for a map that a plan would refuse, except that it may lack its start or regions.
    """
    suffix = Path(name).suffix.lower()
    path = folder.inside(folder.keep_map(content, suffix if SUFFIX.fullmatch(suffix) else ".geojson"))
    try:
        features, warnings, members = opened_features(path, role)
    except DataError as error:
        raise DataError(str(error).replace(str(path), name)) from None
    return {**members, "type": "FeatureCollection", "features": features, "warnings": list(warnings)}


def choices_of_desk() -> dict[str, Any]:
    """Names of vehicles, winds, patterns and examples, with their first comment as a note."""
    return {
        "robot": [_noted("robot", name) for name in CONF.names("robot")],
        "wind": [_noted("wind", name) for name in ("sample", "calm", "noaa", "csv", "netcdf", "grib")],
        "mission": [_noted("mission", name) for name in CONF.names("mission") if not name.startswith("phi")],
        "planner": [_noted("planner", name) for name in CONF.names("planner")],
        "examples": list(EXAMPLES),
    }


def _noted(group: str, name: str) -> dict[str, str]:
    text = CONF.file(group, name).read_text(encoding="utf-8").removeprefix("# @package _global_\n")
    note = re.match(r"# (.*?)(?=\n[^#]|\Z)", text, re.DOTALL)
    return {"name": name, "note": "" if note is None else " ".join(note[1].replace("\n#", "").split())}


def example_map(name: str) -> dict[str, Any]:
    """A ready map as GeoJSON with roles; NotFoundError if there is no such example."""
    if name not in EXAMPLES:
        raise NotFoundError(f"there is no example {shown_value(name)}; there are {', '.join(EXAMPLES)}")
    scene = pareto_ltl.read_map(name)
    assert scene.crs is not None
    lon, lat = scene.frame.to_geographic(scene.start[None])
    features: list[dict[str, Any]] = [
        _feature("start", "start", {"type": "Point", "coordinates": [float(lon[0]), float(lat[0])]})
    ]
    for drawn in shown_map(scene)["shapes"]:
        role = "border" if drawn["role"] == "bounds" else drawn["role"]
        features.append(_feature(role, drawn["name"], {"type": "Polygon", "coordinates": [drawn["ring"]]}))
    return {"type": "FeatureCollection", "features": features}


def _feature(role: str, name: str, geometry: dict[str, Any]) -> dict[str, Any]:
    return {"type": "Feature", "properties": {"role": role, "name": name}, "geometry": geometry}
