"""From a request to the settings of a command line; formulas and maps explained before planning."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pareto_ltl.logic.automaton import translate
from pareto_ltl.logic.formula import disputed_reading, parse_formula
from pareto_ltl.logic.in_words import mission_in_words
from pareto_ltl.logic.patterns import formula_of
from pareto_ltl.report.page.ground import shown_map
from pareto_ltl.report.page.machine import shown_automaton
from pareto_ltl.serve.folder import DeskFolder
from pareto_ltl.settings import MissionConfig
from pareto_ltl.settings.building import section_of
from pareto_ltl.support.errors import ConfigError, DataError, ParetoLtlError
from pareto_ltl.support.messages import shown_value
from pareto_ltl.support.reading import shown_json
from pareto_ltl.support.resources import choice_file, choices
from pareto_ltl.world.projection import to_geographic
from pareto_ltl.world.scene_settings import opened_features, scene_from_settings

COMMANDS = ("plan", "departure", "wind")
EXAMPLES = ("hop", "phi1", "phi2")
SUFFIX = re.compile(r"\.[a-z0-9]{1,12}")  # of a map that is kept
MOST_STATES = 500  # of an automaton that is explained while somebody types


def command_words(folder: DeskFolder, request: Mapping[str, Any]) -> list[str]:
    """Command and settings for the body of ``POST /api/plans``; the map is kept in ``folder``.

    Raises
    ------
    ConfigError
        If the request is not of the documented form, or a setting leads out of the folder.
    """
    if (command := request.get("command", COMMANDS[0])) not in COMMANDS:
        raise ConfigError(f"command must be one of {', '.join(COMMANDS)}, got {shown_json(command)}")
    words = request.get("overrides", [])
    if not isinstance(words, list) or not all(isinstance(word, str) for word in words):
        raise ConfigError(f"overrides must be a list of texts KEY=VALUE, got {shown_json(words)}")
    folder.check_words(words)
    found = list(words)
    if (drawn := request.get("map")) is not None:
        if not isinstance(drawn, dict):
            raise ConfigError(f"map must be a GeoJSON FeatureCollection, got {shown_json(drawn)}")
        text = json.dumps(drawn, ensure_ascii=False, sort_keys=True, indent=1) + "\n"  # same map, same bytes
        found.append(f"scene.file={folder.keep_map(text.encode())}")
    if (formula := request.get("formula")) is not None:
        if not isinstance(formula, str):
            raise ConfigError(f"formula must be a text, got {shown_json(formula)}")
        found.append(f"mission.formula={quoted(formula)}")
    if not found:
        raise ConfigError("there is nothing to plan: give overrides, or a map and a formula")
    return [command, *found]


def quoted(text: str) -> str:
    """``text`` as a value that Hydra reads as text."""
    if "${" in text:
        raise ConfigError(f"{shown_value(text)} is not a formula")
    return "'" + text.replace("\\", "\\\\").replace("'", "\\'") + "'"


def explained_formula(asked: Mapping[str, Any]) -> dict[str, Any]:
    """A formula, or the formula of a pattern, in words and as an automaton; or its error and its column."""
    text = ""
    try:
        mission = section_of("mission", {key: value for key, value in asked.items() if value})
        assert isinstance(mission, MissionConfig)
        text = formula_of(mission)
        tree = parse_formula(text)
        automaton = translate(text, None, MOST_STATES)
    except ParetoLtlError as error:
        return {"formula": text, "error": str(error), "column": getattr(error, "column", None)}
    return {
        "formula": text,
        "words": mission_in_words(text),
        "note": disputed_reading(text),
        "names": sorted(tree.atoms),
        "states": automaton.n_states,
        "impossible": bool(automaton.contradiction),
        "automaton": shown_automaton(automaton),
        "error": None,
    }


def read_map(folder: DeskFolder, name: str, content: bytes) -> dict[str, Any]:
    """The features of a map file, with roles, in degrees, and ``warnings`` of what was not read.

    DataError for a map that a plan would refuse, except that it may lack its start or regions.
    """
    suffix = Path(name).suffix.lower()
    path = folder.inside(folder.keep_map(content, suffix if SUFFIX.fullmatch(suffix) else ".geojson"))
    try:
        features, warnings, members = opened_features(path)
    except DataError as error:
        raise DataError(str(error).replace(str(path), name)) from None
    return {**members, "type": "FeatureCollection", "features": features, "warnings": list(warnings)}


def choices_of_desk() -> dict[str, Any]:
    """Names of vehicles, winds, patterns and examples, with their first comment as a note."""
    return {
        "robot": [_noted("robot", name) for name in choices("robot")],
        "wind": [_noted("wind", name) for name in ("sample", "calm", "noaa", "csv", "netcdf", "grib")],
        "mission": [_noted("mission", name) for name in choices("mission") if not name.startswith("phi")],
        "planner": [_noted("planner", name) for name in choices("planner")],
        "examples": list(EXAMPLES),
    }


def _noted(group: str, name: str) -> dict[str, str]:
    text = choice_file(group, name).read_text(encoding="utf-8")
    note = re.match(r"# (.*?)(?=\n[^#]|\Z)", text, re.DOTALL)
    return {"name": name, "note": "" if note is None else " ".join(note[1].replace("\n#", "").split())}


def example_map(name: str) -> dict[str, Any]:
    """A ready map as GeoJSON with roles; DataError if there is no such example."""
    if name not in EXAMPLES:
        raise DataError(f"there is no example {shown_value(name)}; there are {', '.join(EXAMPLES)}")
    cfg = section_of("scene", name)
    scene = scene_from_settings(cfg)
    assert scene.crs is not None
    lon, lat = to_geographic(scene.crs, scene.start[None])
    features: list[dict[str, Any]] = [
        _feature("start", "start", {"type": "Point", "coordinates": [float(lon[0]), float(lat[0])]})
    ]
    for drawn in shown_map(scene)["shapes"]:
        role = "border" if drawn["role"] == "bounds" else drawn["role"]
        features.append(_feature(role, drawn["name"], {"type": "Polygon", "coordinates": [drawn["ring"]]}))
    return {"type": "FeatureCollection", "features": features}


def _feature(role: str, name: str, geometry: dict[str, Any]) -> dict[str, Any]:
    return {"type": "Feature", "properties": {"role": role, "name": name}, "geometry": geometry}
