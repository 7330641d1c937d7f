"""Groups of entry points: what other packages add is found by name, or refused in one line."""

from __future__ import annotations

from collections.abc import Iterator
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from careful_io.errors import ConfigError
from declared_settings import Group
from declared_settings.extensions import installed_entries

CAKES = Group("my_ovens.cakes", "docs/cakes.md")


@pytest.fixture
def added(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[EntryPoint]]:
    """The entry points of every group."""
    entries: list[EntryPoint] = []
    monkeypatch.setattr("importlib.metadata.entry_points", lambda group: entries)
    installed_entries.cache_clear()
    yield entries
    installed_entries.cache_clear()


def entry(name: str, value: str) -> EntryPoint:
    return EntryPoint(name, value, CAKES.name)


def test_an_own_kind_and_an_added_one_are_found_by_name(added: list[EntryPoint]) -> None:
    added += [entry("tart", "os:sep"), entry("brownie", "os:name")]
    assert CAKES.names(["plain"]) == ("brownie", "tart")
    assert CAKES.kind({"plain": "flour"}, "plain", callable) == "flour"
    assert CAKES.kind({"plain": "flour"}, "tart", lambda cake: isinstance(cake, str)) in "/\\"
    assert len(CAKES.load_all()) == 2
    with pytest.raises(KeyError):
        CAKES.kind({}, "bread", callable)


@pytest.mark.parametrize(
    ("value", "reason"),
    [
        ("no_such_module:CAKE", r"cannot be loaded \(ModuleNotFoundError: .*\); repair or uninstall it"),
        ("os:no_such_name", r"cannot be loaded \(AttributeError"),
        ("os:sep", "is a str, which this group does not take; see docs/cakes.md"),
    ],
)
def test_an_entry_point_that_does_not_work_is_named(value: str, reason: str, added: list[EntryPoint]) -> None:
    added.append(entry("tart", value))
    assert CAKES.names() == ("tart",)  # not loaded
    with pytest.raises(ConfigError, match=rf"^entry point 'tart' \({value}\) in my_ovens.cakes {reason}"):
        CAKES.load("tart", callable)


def test_a_name_of_the_program_is_refused(added: list[EntryPoint]) -> None:
    added.append(entry("plain", "os:sep"))
    with pytest.raises(ConfigError, match=r"'plain' .* has a name that my_ovens uses; rename it"):
        CAKES.names(["plain"])


def test_two_packages_with_one_name_are_refused(added: list[EntryPoint]) -> None:
    added += [entry("tart", "b:B"), entry("tart", "a:A")]
    with pytest.raises(ConfigError, match=r"two packages add my_ovens\.cakes 'tart': a:A and b:B"):
        CAKES.names()


def test_a_missing_part_of_the_program_is_named(added: list[EntryPoint]) -> None:
    added.append(entry("tart", "os:sep"))
    assert CAKES.required("tart") in "/\\"
    with pytest.raises(ConfigError, match=r"has 'bread' in my_ovens\.cakes: reinstall my-ovens"):
        CAKES.required("bread")


def test_a_folder_is_found_without_an_import_and_refused_if_there_is_none(added: list[EntryPoint]) -> None:
    added.append(entry("data", "importlib.metadata"))
    (folder,) = CAKES.folders()
    assert folder.parts[-2:] == Path("importlib/metadata").parts
    added[:] = [entry("data", "importlib.no_such_folder")]
    installed_entries.cache_clear()
    with pytest.raises(ConfigError, match="names no folder of a package"):
        CAKES.folders()
