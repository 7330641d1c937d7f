"""The installed reader of map files, which an application is: an entry point of ``pareto_ltl.formats``."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from careful_io.messages import LONGEST_LINE, shown_text
from careful_io.reading import Advice
from pareto_ltl.support.extensions import FORMATS

if TYPE_CHECKING:
    from pareto_ltl.world.scene_sketch import SceneSketch

LOG = logging.getLogger(__name__)
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
class MapFormats:
    """The reader of map files.

    Attributes
    ----------
    read : callable
        The sketch of a map file with the features of other files (``scene.zones``) and ``scene.roles``, or
        the document of a run's ``scene.json``; DataError if it cannot be read.
    linked : callable
        The files to which the links of a map lead, of those that the second argument allows.
    """

    ADVICE: ClassVar[Advice] = Advice(
        "check scene.file", "correct the map: GeoJSON, KML or a run's scene.json"
    )

    read: Callable[[Path, Sequence[str], Any], SceneSketch | Mapping[str, Any]]
    linked: Callable[..., tuple[Path, ...]]


@lru_cache
def map_formats() -> MapFormats:
    """The installed reader of map files."""
    found: MapFormats = FORMATS.required("maps")
    return found
