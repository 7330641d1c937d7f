"""What a map file holds as plain data: GeoJSON features, and a list of everything that was not read.

The formats are read by an application, which is an entry point of ``pareto_ltl.formats``.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

from pareto_ltl.support.extensions import FORMAT_GROUP, installed_object
from pareto_ltl.support.messages import LONGEST_LINE, shown_text
from pareto_ltl.support.reading import Advice

LOG = logging.getLogger(__name__)
SCENE_FILES = Advice("check scene.file", "correct the map: GeoJSON, KML or a run's scene.json")
LISTED = 100  # characters of one entry


@dataclass(slots=True)
class Unread:
    """What a map file has and the map has not.

    Attributes
    ----------
    lost : Counter of str
        What may be an obstacle, with the reason and the number of times; it is logged as a warning.
    passed : Counter of str
        What cannot be an obstacle, or is read on the careful side.
    """

    lost: Counter[str] = field(default_factory=Counter)
    passed: Counter[str] = field(default_factory=Counter)

    def update(self, other: Unread) -> None:
        """Add the entries of ``other``."""
        self.lost.update(other.lost)
        self.passed.update(other.passed)

    def log(self, where: str) -> None:
        """Log what was not read: one warning, and one line for the rest."""
        if text := self.warning():
            LOG.warning("%s: %s", where, text)
        if text := self.note():
            LOG.info("%s: %s", where, text)

    def warning(self) -> str:
        """One line about what may be an obstacle and was not read; empty if there is nothing."""
        return f"not read, and it may be an obstacle: {_listed(self.lost)}" if self.lost else ""

    def note(self) -> str:
        """One line about the rest that was not read; empty if there is nothing."""
        return f"not read: {_listed(self.passed)}" if self.passed else ""


def _listed(entries: Counter[str]) -> str:
    texts = [
        shown_text(text, LISTED * 2) + (f" ({number:,} times)" if number > 1 else "")
        for text, number in entries.items()
    ]
    line, shown = "; ".join(texts), len(texts)
    while len(line) > LONGEST_LINE - 300 and shown > 1:
        shown = shown * 3 // 4
        line = "; ".join(texts[:shown]) + f"; and {len(texts) - shown:,} more"
    return line


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


class MapFormats(NamedTuple):
    """The reader of map files.

    Attributes
    ----------
    read : callable
        The features of a map file, or the document of a run's ``scene.json``; DataError if it cannot be read.
    linked : callable
        The files to which the links of a map lead, of those that the second argument allows.
    with_limits : callable
        A feature with ``floor`` and ``ceiling`` if it is airspace.
    """

    read: Callable[[Path, Advice], MapFile | Mapping[str, Any]]
    linked: Callable[..., tuple[Path, ...]]
    with_limits: Callable[[str, str, Mapping[str, Any]], dict[str, Any]]


@lru_cache
def map_formats() -> MapFormats:
    """The installed reader of map files."""
    found: MapFormats = installed_object(FORMAT_GROUP, "maps")
    return found


def read_map_file(path: Path, advice: Advice = SCENE_FILES) -> MapFile | Mapping[str, Any]:
    """The features of a map file, or the document of a run's ``scene.json``; DataError as from the reader."""
    return map_formats().read(path, advice)


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
