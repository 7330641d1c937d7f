"""Choices of settings: YAML files ``GROUP/NAME.yaml`` of a program and of the packages that add some."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from careful_io.errors import ConfigError, DataError
from careful_io.messages import shown_value
from careful_io.yaml_files import read_yaml
from declared_settings.extensions import Group


@dataclass(frozen=True, slots=True)
class Choices:
    """The files of choices, in one folder for each group.

    Attributes
    ----------
    own : callable
        Returns the folder of the program for a group; it may not exist.
    added : Group
        Entry points of other packages: folders with a folder ``GROUP`` for each group.
    root : str
        How messages call the folder of all groups.
    """

    own: Callable[[str], Path]
    added: Group
    root: str = "conf"

    def added_folders(self) -> tuple[Path, ...]:
        """The folders that other packages add; ConfigError if a name of their choices is taken."""
        places, seen = self.added.folders(), set[str]()
        for place in places:
            for path in sorted(place.glob("*/*.yaml")):
                group, name = path.parent.name, f"{self.root}/{path.parent.name}/{path.stem}"
                if name in seen or (self.own(group) / path.name).exists():
                    raise ConfigError(
                        f"{path}: there is another choice {name}; rename this one, or uninstall it"
                    )
                seen.add(name)
        return places

    def _files(self, group: str) -> list[Path]:
        """The files of ``group``, the files of the program first."""
        folders = [self.own(group), *(place / group for place in self.added_folders())]
        return [path for folder in folders for path in folder.glob("*.yaml")]

    def names(self, group: str) -> list[str]:
        """The names of the choices of ``group``, sorted."""
        return sorted({path.stem for path in self._files(group)})

    def file(self, group: str, name: str) -> Path:
        """The file of the choice ``name`` of ``group``; ConfigError with the choices if there is none."""
        for path in self._files(group):  # names are compared, as ``name`` may not be a valid file name
            if path.stem == name:
                return path
        raise ConfigError(
            f"there is no {group} {shown_value(name)}; there are {', '.join(self.names(group))}"
        )

    def values(self, group: str, name: str) -> dict[str, Any]:
        """The keys and values of the choice ``name`` of ``group``."""
        return read_values(self.file(group, name))


def read_values(path: Path) -> dict[str, Any]:
    """The keys and values of the YAML file ``path``; DataError if it has none."""
    content = read_yaml(path)
    if not isinstance(content, dict | None):
        raise DataError(f"{path}: expected keys and values, found {type(content).__name__}")
    return content or {}
