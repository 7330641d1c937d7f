"""The folder of a desk: maps, winds, results and the mission that is drawn; no other file can be accessed.

The mission survives a restart and a second tab; its number grows with each change.
"""

from __future__ import annotations

import glob
import hashlib
import json
import re
from contextlib import suppress
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any

from careful_io.files import write_bytes, write_text
from careful_io.messages import shown_value
from careful_io.reading import read_json
from pareto_ltl.support.errors import ConfigError, DataError, NotFoundError

MAPS, WINDS, PLANS, DRAFT = "maps", "winds", "plans", "mission.json"
REMOVED = "removed"  # plans that were taken from the list
FILE_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,99}")
PLAN_NAME = re.compile(r"[0-9]{8}-[0-9]{6}-[0-9a-f]{4}(_[a-z0-9_.]{1,40})?")
LONGEST_NAME = 255  # [bytes] of a file, on every system
OUTSIDE = "lies outside of the folder of the desk; copy it there"


class RevisionError(ConfigError):
    """Another tab has written the mission since it was read."""

    status = 409


@dataclass(frozen=True, slots=True)
class DeskFolder:
    """The only place that a desk reads and writes; ``root`` is absolute, without symbolic links."""

    root: Path

    @classmethod
    def opened(cls, path: Path) -> DeskFolder:
        """The folder ``path``, made if it is missing; DataError if it is a file."""
        if path.exists() and not path.is_dir():
            raise DataError(f"{path} is a file; give a folder for the desk, e.g. --folder desk")
        path.mkdir(parents=True, exist_ok=True)
        return cls(path.resolve())

    def inside(self, text: str) -> Path:
        """The path of ``text``, relative to the folder; ConfigError if it lies elsewhere."""
        if any(len(part.encode(errors="replace")) > LONGEST_NAME for part in text.split("/")):
            raise ConfigError(f"{shown_value(text)} has a name of more than {LONGEST_NAME} bytes")
        path = None if "\0" in text else (self.root / text).resolve()
        if path is None or not path.is_relative_to(self.root) or "~" in _first_letters(self.root, path, text):
            raise ConfigError(f"{shown_value(text)} {OUTSIDE}")
        return path

    def plan_place(self, name: str) -> Path:
        """The results directory ``name``; NotFoundError if no plan can have that name, or for a link."""
        place = self.root / PLANS / name if PLAN_NAME.fullmatch(name) else None
        if place is None or place.resolve() != place:
            raise NotFoundError(f"there is no plan {shown_value(name)}")
        return place

    def removed_place(self, name: str) -> Path:
        """A free place for the results directory ``name`` when it is removed; NotFoundError for a link."""
        removed = self.root / REMOVED
        if removed.resolve() != removed:
            raise NotFoundError(f"{REMOVED} in the folder of the desk is a link; remove it")
        names = (name if k == 1 else f"{name}-{k}" for k in count(1))
        return next(removed / one for one in names if not (removed / one).exists())

    def keep_map(self, content: bytes, suffix: str = ".geojson") -> str:
        """Write a map under a name of its content; return the path relative to the folder."""
        name = f"{MAPS}/{hashlib.sha256(content).hexdigest()[:16]}{suffix}"
        self._keep(name, content)
        return name

    def keep_wind(self, name: str, content: bytes) -> str:
        """Write a file of winds; return the path relative to the folder."""
        if not FILE_NAME.fullmatch(name):
            raise DataError(f"{shown_value(name)} is not a file name; use letters, digits, '.', '_' and '-'")
        self._keep(f"{WINDS}/{name}", content)
        return f"{WINDS}/{name}"

    def _keep(self, name: str, content: bytes) -> None:
        path = self.inside(name)
        path.parent.mkdir(exist_ok=True)
        write_bytes(path, content)

    def path_of(self, key: str, text: str) -> str:
        """The file, folder or pattern that the setting ``key`` names, relative to the folder.

        Raises
        ------
        ConfigError
            If it, a match of the pattern, or a link below it lies elsewhere, or if there is nothing of that
            name.
        """
        if "://" in text:
            raise ConfigError(f"{key}: {shown_value(text)} is an address; the desk reads files of its folder")
        try:
            path = self.inside(text)
        except ConfigError as error:
            raise ConfigError(f"{key}: {error}") from None
        name = path.relative_to(self.root).as_posix()
        if path.exists():
            found = [path]
        else:
            name, pattern = text, str(self.root / text)
            found = [Path(match) for match in glob.glob(pattern, recursive=True)]
        for place in found:
            below = place.rglob("*") if place.is_dir() else ()
            links = (entry for entry in below if entry.is_symlink())
            for entry in (place, *links):
                if not entry.resolve().is_relative_to(self.root):
                    raise ConfigError(f"{key}: {shown_value(text)} {OUTSIDE}")
        if not found:
            raise ConfigError(
                f"{key}: there is nothing named {shown_value(text)} in the folder of the desk; copy it there"
            )
        return name

    def read_draft(self) -> dict[str, Any]:
        """``revision`` and ``mission`` as last drawn; revision 0 without a file, or with a damaged one."""
        with suppress(DataError, OSError):
            found = read_json(self.root / DRAFT)
            if isinstance(found.get("revision"), int):
                return {"revision": found["revision"], "mission": found.get("mission")}
        return {"revision": 0, "mission": None}

    def write_draft(self, revision: Any, mission: Any) -> dict[str, Any]:
        """Write ``mission`` after the revision that it was made from; RevisionError if that is old."""
        last = self.read_draft()["revision"]
        if revision != last:
            raise RevisionError(
                "the mission was changed in another tab: load this page again, or close the other tab"
            )
        content = {"revision": last + 1, "mission": mission}
        write_text(self.root / DRAFT, json.dumps(content, ensure_ascii=False) + "\n")
        return {"revision": last + 1}


def _first_letters(root: Path, path: Path, text: str) -> str:
    """How a text and the path of it in the folder begin: with ``~`` for the home of a user."""
    return text[:1] + path.relative_to(root).as_posix()[:1]
