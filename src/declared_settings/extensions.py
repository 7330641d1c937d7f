"""What other packages add to a program: Python entry points, in groups.

An entry point is imported only when its name is used.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from importlib.machinery import PathFinder
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from careful_io.errors import ConfigError

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

Kind = TypeVar("Kind")


@dataclass(frozen=True, slots=True)
class Group:
    """A group of entry points, by which other packages add kinds of one sort.

    Attributes
    ----------
    name : str
        The package of the program, a dot and the sort: ``my_program.sources``.
    example : str
        Where authors find an example of each kind; messages name it.
    """

    name: str
    example: str = "its documentation"

    @property
    def program(self) -> str:
        """The package to which the kinds are added."""
        return self.name.partition(".")[0]

    def names(self, own: Iterable[str] = ()) -> tuple[str, ...]:
        """The names that other packages add, sorted; ``own`` are the names of the program.

        Raises
        ------
        ConfigError
            If an added name is one of ``own``.
        """
        entries = installed_entries(self.name)
        for name in own:
            if name in entries:
                raise ConfigError(
                    f"{_entry_text(entries[name])} has a name that {self.program} uses; rename it, or "
                    "uninstall it"
                )
        return tuple(entries)

    def kind(self, own: Mapping[str, Kind], name: str, expected: Callable[[Any], bool]) -> Kind:
        """The object called ``name``: a value of ``own``, or the loaded entry point.

        ``expected`` returns whether a loaded object is of the right kind. Raises ``KeyError`` if the name is
        unknown, and ``ConfigError`` if an entry point has a name of ``own``, does not load or is of another
        kind.
        """
        self.names(own)
        return own[name] if name in own else self.load(name, expected)

    def load(self, name: str, expected: Callable[[Any], bool]) -> Any:
        """The object of entry point ``name``; errors as in :meth:`kind`."""
        entry = installed_entries(self.name)[name]
        try:
            loaded = entry.load()
        except Exception as error:
            reason = f"{type(error).__name__}: {' '.join(str(error).split())}"
            raise ConfigError(
                f"{_entry_text(entry)} cannot be loaded ({reason}); repair or uninstall it"
            ) from error
        if not expected(loaded):
            raise ConfigError(
                f"{_entry_text(entry)} is a {type(loaded).__name__}, which this group does not take; see "
                f"{self.example}"
            )
        return loaded

    def load_all(self, expected: Callable[[Any], bool] = lambda _: True) -> list[Any]:
        """The objects of all entry points, by name; errors as in :meth:`kind`."""
        return [self.load(name, expected) for name in sorted(installed_entries(self.name))]

    def required(self, name: str) -> Any:
        """The object of entry point ``name``, a part of the program; ConfigError if it is missing."""
        if name not in installed_entries(self.name):
            distribution = self.program.replace("_", "-")
            raise ConfigError(f"no installed package has {name!r} in {self.name}: reinstall {distribution}")
        return self.load(name, lambda _: True)

    def folders(self) -> tuple[Path, ...]:
        """The folders of packages that the entry points name, which are not imported, by name."""
        return tuple(_folder(entry) for entry in installed_entries(self.name).values())


@lru_cache
def installed_entries(group: str) -> dict[str, EntryPoint]:
    """The installed entry points of ``group``, by name; ConfigError if two packages add one name."""
    from importlib.metadata import entry_points

    found: dict[str, EntryPoint] = {}
    for entry in sorted(entry_points(group=group), key=lambda entry: (entry.name, entry.value)):
        other = found.get(entry.name)
        if other is not None and other.value != entry.value:
            raise ConfigError(
                f"two packages add {group} {entry.name!r}: {other.value} and {entry.value}; uninstall one"
            )
        found[entry.name] = entry
    return found


def _folder(entry: EntryPoint) -> Path:
    """The folder of the package that the entry point names, without importing it."""
    search: list[str] | None = None
    for part in entry.value.split("."):
        found = PathFinder.find_spec(part, search)
        search = list(found.submodule_search_locations or ()) if found is not None else []
        if not search:
            raise ConfigError(f"{_entry_text(entry)} names no folder of a package; repair or uninstall it")
    return Path((search or [""])[0])


def _entry_text(entry: EntryPoint) -> str:
    package = f" of {entry.dist.name}" if entry.dist is not None else ""
    return f"entry point {entry.name!r} ({entry.value}) in {entry.group}{package}"
