"""Extensions by other packages: Python entry points in the groups below.

``pareto_ltl.stages``           a ``Record`` that pipelines can list (``run/record.py``)
``pareto_ltl.stage_tables``     a tuple of such records, which every pipeline knows: stages of applications
``pareto_ltl.plan_additions``   a ``PlanAddition`` (``run/plan_additions.py``)
``pareto_ltl.settings``         a tuple of sections of the settings (``CheckedSettings``)
``pareto_ltl.interface``        a function or class that ``pareto_ltl`` gives under that name
``pareto_ltl.formats``          what reads the files of others: ``maps``, ``winds``, ``automata``
``pareto_ltl.commands``         the command line, ``pareto-ltl``
``pareto_ltl.wind_sources``     a ``WindSource`` (``wind/sources``)
``pareto_ltl.patterns``         a function from ``MissionConfig`` to a formula (``logic/patterns.py``)
``pareto_ltl.selection_rules``  a function that picks a path of a front (``planning/selection_rules.py``)
``pareto_ltl.costs``            a ``Cost`` of a path (``planning/costs/``)
``pareto_ltl.exports``          an ``ExportFormat`` of plans, for an autopilot or a map
``pareto_ltl.conf``             a folder of YAML choices: ``robot/``, ``scene/``, ``pipelines/`` and so on

An entry point is imported only when its name is used. ``examples/extension/`` has one of each.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import lru_cache
from importlib.machinery import PathFinder
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from pareto_ltl.support.errors import ConfigError

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

Kind = TypeVar("Kind")

STAGE_GROUP = "pareto_ltl.stages"
FORMAT_GROUP = "pareto_ltl.formats"
PLAN_ADDITION_GROUP = "pareto_ltl.plan_additions"
STAGE_TABLE_GROUP = "pareto_ltl.stage_tables"
SETTINGS_GROUP = "pareto_ltl.settings"
INTERFACE_GROUP = "pareto_ltl.interface"
COMMAND_GROUP = "pareto_ltl.commands"
WIND_SOURCE_GROUP = "pareto_ltl.wind_sources"
PATTERN_GROUP = "pareto_ltl.patterns"
SELECTION_RULE_GROUP = "pareto_ltl.selection_rules"
COST_GROUP = "pareto_ltl.costs"
CONF_GROUP = "pareto_ltl.conf"


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


def extension_names(group: str, own: Iterable[str] = ()) -> tuple[str, ...]:
    """Names that other packages add to ``group``, sorted; ``own`` are the built-in names.

    Raises
    ------
    ConfigError
        If an added name is one of ``own``.
    """
    names = installed_entries(group)
    for name in own:
        if name in names:
            raise ConfigError(
                f"{_entry_text(names[name])} has a name that pareto_ltl uses; rename it, or uninstall it"
            )
    return tuple(names)


def known_kind(group: str, own: Mapping[str, Kind], name: str, expected: Callable[[Any], bool]) -> Kind:
    """The object called ``name``: a value of ``own``, or the loaded entry point of ``group``.

    ``expected`` returns whether a loaded object is of the right kind. Raises ``KeyError`` if the name is
    unknown, and ``ConfigError`` if an entry point has a built-in name, does not load or is of another kind.
    """
    extension_names(group, own)
    return own[name] if name in own else load_extension(group, name, expected)


def load_extension(group: str, name: str, expected: Callable[[Any], bool]) -> Any:
    """The object of entry point ``name``; errors as in :func:`known_kind`."""
    entry = installed_entries(group)[name]
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
            "examples/extension"
        )
    return loaded


def load_all(group: str, expected: Callable[[Any], bool] = lambda _: True) -> list[Any]:
    """The objects of all entry points of ``group``, by name; errors as in :func:`known_kind`."""
    return [load_extension(group, name, expected) for name in sorted(installed_entries(group))]


def installed_object(group: str, name: str) -> Any:
    """The object of entry point ``name``; ConfigError if no package has it."""
    if name not in installed_entries(group):
        raise ConfigError(f"no installed package has {name!r} in {group}: reinstall pareto-ltl")
    return load_extension(group, name, lambda _: True)


def extension_folders() -> tuple[Path, ...]:
    """Folders of YAML choices that other packages add, sorted by the names of their entry points."""
    return tuple(_folder(entry) for entry in installed_entries(CONF_GROUP).values())


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
