"""The features of a map file for a program in which somebody draws on it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pareto_ltl.support.errors import DataError
from pareto_ltl.world.scene_checks import check_parts
from pareto_ltl_apps.formats.map_features import FeatureReader, in_degrees
from pareto_ltl_apps.formats.map_file import MapFile
from pareto_ltl_apps.formats.map_formats import read_map_file
from pareto_ltl_apps.formats.map_plane import sketch_features
from pareto_ltl_apps.formats.map_roles import RoleRules


def opened_features(
    path: Path, roles: Any = None
) -> tuple[list[dict[str, Any]], tuple[str, ...], Mapping[str, Any]]:
    """The features of a map file with their roles [deg], what was not read, and the file's other members.

    The map may lack its start or regions, so that somebody can draw them. ``roles`` is as ``scene.roles``.

    Raises
    ------
    DataError
        If the file cannot be read, is in metres, or has a fault for which a plan would be refused.
    """
    found = read_map_file(path)
    if not isinstance(found, MapFile):
        raise DataError(f"scene file {path} is a run's scene.json, in metres; open a map in degrees")
    reader = FeatureReader(RoleRules.of(roles or {}))
    sketch = sketch_features([found], reader)
    check_parts(sketch)
    plain = reader.plain if found.crs is None else [in_degrees(one, found) for one in reader.plain]
    texts = tuple(text for text in (reader.unread.warning(), reader.unread.note()) if text)
    return plain, texts, found.members
