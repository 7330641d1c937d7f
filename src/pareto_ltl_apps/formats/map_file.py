"""What a map file holds as plain data: GeoJSON features, and a list of everything that was not read."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from careful_io.messages import shown_text
from pareto_ltl.extend import Unread


@dataclass(frozen=True, slots=True)
class MapFile:
    """The content of one map file.

    Attributes
    ----------
    where : str
        Start of every message, e.g. ``scene file map.geojson``.
    kind : str
        The format, e.g. ``GeoJSON``.
    features : list
        GeoJSON features, not yet checked. A member ``title`` names a feature in messages.
    crs : str or None
        The system of the coordinates; None for degrees (WGS 84).
    role : str
        The role of features without one, e.g. ``obstacle`` for airspace; empty: they need a role.
    hint : str
        How a feature gets a role in this format, for messages.
    unread : Unread
        Everything in the file that is not in ``features``.
    faults : tuple of str
        Messages about parts of the file that cannot be read.
    members : mapping
        Members of a GeoJSON object that no FeatureCollection has.
    """

    where: str
    kind: str
    features: list[Any]
    crs: str | None = None
    role: str = ""
    hint: str = "give it the property role"
    unread: Unread = field(default_factory=Unread)
    faults: tuple[str, ...] = ()
    members: Mapping[str, Any] = field(default_factory=dict)


def needs_a_map(found: MapFile) -> str:
    """Why a file of airspace or of a fence is no whole map, and the way out; empty for other files."""
    if found.kind in ("GeoJSON", "KML") or any(_role_of(feature) == "start" for feature in found.features):
        return ""
    return (
        f"{found.where} is {_article(found.kind)}: it has no start and no regions; draw these as GeoJSON or "
        f"KML, and name this file in scene.zones, as in scene.zones=[{shown_text(Path(found.where).name)}]"
    )


def _article(kind: str) -> str:
    return kind if kind.startswith("a ") else f"a file of airspace in the format {kind}"


def _role_of(feature: Any) -> Any:
    properties = feature.get("properties") if isinstance(feature, dict) else None
    return properties.get("role") if isinstance(properties, dict) else None
