"""The files of a KML map: a KML file with those in its folder, or a KMZ archive.

A file has a name relative to the folder of the map; a KMZ archive is a folder with the name of the archive.
"""

from __future__ import annotations

import posixpath
import zipfile
import zlib
from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar
from urllib.parse import unquote

from careful_io import reading
from careful_io.messages import shown_text
from careful_io.reading import MAX_BYTES, Advice, read_bounded
from pareto_ltl.support.errors import DataError

Found = TypeVar("Found")
MAX_TRIED = 20  # KML files of an archive among which the map is looked for


def any_file(_path: Path) -> bool:
    """Whether a file that a map links to may be read: yes."""
    return True


def linked_name(name: str, href: str) -> str | None:
    """The name of the file to which ``href`` in the file ``name`` leads; None if it is outside the folder."""
    target = unquote(href.partition("#")[0].partition("?")[0]).replace("\\", "/")
    joined = posixpath.normpath(posixpath.join(posixpath.dirname(name), target))
    bad = not target or joined.startswith(("/", "..")) or "\0" in joined or ":" in joined
    return None if bad else joined


@dataclass(slots=True)
class KmlSources:
    """The files of the map ``path``.

    Attributes
    ----------
    members : list of str
        The KML files of an archive.
    beside : list of Path
        The files in the folder of the map that links have led to, also those that could not be read.
    readable : callable
        Whether such a file may be read.
    """

    path: Path
    advice: Advice
    members: list[str] = field(default_factory=list)
    beside: list[Path] = field(default_factory=list)
    readable: Callable[[Path], bool] = any_file

    @classmethod
    def of(cls, path: Path, advice: Advice, readable: Callable[[Path], bool] = any_file) -> KmlSources:
        """The sources of a KML or KMZ file; DataError if an archive cannot be opened or has no KML."""
        found = cls(path, advice, readable=readable)
        if found.archived:
            found.members = [name for name in found._names() if name.lower().endswith(".kml")]
            if not found.members:
                raise DataError(f"{path}: there is no KML file in it; {advice.damaged}")
        return found

    @property
    def archived(self) -> bool:
        """Whether the map is an archive; a KMZ file under another name is one."""
        return is_archive(self.path)

    @property
    def place(self) -> str:
        """Where linked files have to be, for messages."""
        return "archive, nor beside it" if self.archived else "folder of the map"

    def main(self, has_roles: Callable[[str], bool]) -> str:
        """The name of the map: in an archive the file with roles, ``doc.kml`` and outer folders first."""
        if not self.archived:
            return self.path.name
        order = sorted(self.members, key=lambda name: (name.lower() != "doc.kml", name.count("/")))
        names = [self._inner(name) for name in order]
        return next((name for name in names[:MAX_TRIED] if _tried(has_roles, name)), names[0])

    def others(self, read: Collection[str]) -> list[str]:
        """The KML files of the archive that are not in ``read``."""
        return [name for name in self.members if self._inner(name) not in read]

    def has(self, name: str) -> bool:
        """Whether there is a file ``name``, in the archive or in the folder of the map."""
        inside = self._member(name)
        if inside is not None:
            return inside in self.members or inside in self._names()
        place = self._place(name)
        return place is not None and place.is_file()

    def content(self, name: str, advice: Advice) -> bytes:
        """The bytes of the file ``name``; DataError if it cannot be read."""
        inside = self._member(name)
        if inside is not None:
            return self._unpacked(self.path, inside)
        place = self._place(name)
        if place is None:
            raise DataError(f"{name} lies outside of the folder of the map; copy it there")
        if name != self.path.name:
            self.beside.append(self.path.parent / name)
            if not self.readable(self.beside[-1]):
                raise DataError(f"{self.beside[-1]} may not be read")
        if is_archive(place):
            return self._first_kml(place)
        return read_bounded(place, advice)

    def _inner(self, member: str) -> str:
        return posixpath.normpath(f"{self.path.name}/{member}")

    def _member(self, name: str) -> str | None:
        """The name within the archive; None for a file beside it."""
        head = f"{self.path.name}/"
        return name.removeprefix(head) if self.archived and name.startswith(head) else None

    def _place(self, name: str) -> Path | None:
        """The path of a file in the folder of the map; None if a link of the file system leads out of it."""
        try:
            place = (self.path.parent / name).resolve()
            inside = place.is_relative_to(self.path.parent.resolve()) or name == self.path.name
        except (OSError, ValueError):
            return None
        return place if inside else None

    def _names(self) -> list[str]:
        return _opened(self.path, self.advice, lambda archive: archive.namelist())

    def _first_kml(self, place: Path) -> bytes:
        names = [n for n in _opened(place, self.advice, lambda a: a.namelist()) if n.lower().endswith(".kml")]
        if not names:
            raise DataError(f"{place}: there is no KML file in it; {self.advice.damaged}")
        return self._unpacked(place, next((n for n in names if n.lower() == "doc.kml"), names[0]))

    def _unpacked(self, place: Path, member: str) -> bytes:
        def read(archive: zipfile.ZipFile) -> bytes:
            with archive.open(member) as file:
                return file.read(MAX_BYTES + 1)

        data = _opened(place, self.advice, read)
        if len(data) > MAX_BYTES:
            raise DataError(f"{place}: has more than {MAX_BYTES / 2**20:g} MiB, which is the limit")
        return data


def is_archive(path: Path) -> bool:
    """Whether ``path`` has the suffix or the first bytes of an archive."""
    if path.suffix.lower() == ".kmz":
        return True
    try:
        reading.refuse_special(path)
        with path.open("rb") as file:
            return file.read(4) == b"PK\x03\x04"
    except (OSError, ValueError, DataError):
        return False


def _tried(has_roles: Callable[[str], bool], name: str) -> bool:
    try:
        return has_roles(name)
    except DataError:
        return False


def _opened(path: Path, advice: Advice, use: Callable[[zipfile.ZipFile], Found]) -> Found:
    """The result of ``use`` on an archive; DataError if it is damaged."""
    reading.refuse_special(path)
    try:
        with zipfile.ZipFile(path) as archive:
            return use(archive)
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror or error}); {advice.missing}") from error
    except (
        zipfile.BadZipFile, zlib.error, EOFError, KeyError, RuntimeError, NotImplementedError, ValueError
    ) as error:  # fmt: skip
        raise DataError(
            f"{path}: not a KMZ archive ({shown_text(str(error), 200)}); {advice.damaged}"
        ) from error
