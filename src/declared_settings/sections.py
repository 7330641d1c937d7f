"""Sections of settings, each checked when it is made, and all settings of a program."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import asdict, field, fields, is_dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, ClassVar, Self, TypeVar

from careful_io.errors import ConfigError, DataError
from careful_io.messages import shown_value
from declared_settings.building import settings_of, unknown_setting
from declared_settings.choices import Choices, read_values
from declared_settings.declarations import (
    DECLARED,
    Declaration,
    Setting,
    check_value,
    declarations,
    settings_below,
)
from declared_settings.extensions import Group
from declared_settings.kinds import field_kinds, fits_kind, kind_problem

SETTING_NAME = re.compile(r"\b([a-z_]+)\.([a-z_0-9]+)\b")  # in a message: planner.epsilon


class CheckedSettings:
    """Base of all sections of settings, which are dataclasses; ``section`` is the key of the section.

    Construction raises :class:`ConfigError` if a value has the wrong type or is out of range.

    Attributes
    ----------
    after : str
        Of a section that another package adds: the section behind which it stands. Empty: behind the section
        before it in its table; the first one stands at the end.
    acts : mapping of str to str
        Settings that open a connection or continue another run unless they are null, and what they do.
    gone : mapping of str to str
        Settings of earlier versions, and why they left.
    result : bool
        Whether a result can depend on the section.
    """

    section: ClassVar[str] = ""
    after: ClassVar[str] = ""
    acts: ClassVar[Mapping[str, str]] = {}
    gone: ClassVar[Mapping[str, str]] = {}
    result: ClassVar[bool] = True

    @classmethod
    def declared(cls, name: str) -> Declaration:
        """The declaration of the setting ``name``."""
        return next(declared for item, declared in declarations(cls) if item.name == name)

    def __init_subclass__(cls, section: str = "", after: str = "") -> None:
        cls.section, cls.after = section, after

    def __post_init__(self) -> None:
        kinds: dict[str, Any] = field_kinds(type(self))  # type: ignore[arg-type]  # classes have a hash
        for item in fields(self):  # type: ignore[arg-type]
            key = f"{self.section}.{item.name}" if self.section else item.name
            value = getattr(self, item.name)
            if not fits_kind(value, kinds[item.name]):
                raise ConfigError(kind_problem(key, value, kinds[item.name]))
            if DECLARED in item.metadata:
                check_value(key, value, item.metadata[DECLARED])
        self.check_combinations()

    def check_combinations(self) -> None:
        """Raise ConfigError for values that contradict each other, or for a list of the wrong shape."""

    def complete(self, settings: Any) -> None:
        """Set what other sections of ``settings`` leave open to this one; refuse what contradicts them."""

    def inert(self) -> Self:
        """The section without what opens a connection or continues another run."""
        return replace(self, **dict.fromkeys(self.acts))  # type: ignore[type-var]


Section = TypeVar("Section", bound=CheckedSettings)
Whole = TypeVar("Whole", bound="AllSettings")


class AllSettings(CheckedSettings):
    """Base of all settings of a program: a dataclass of sections, and of settings outside of them.

    ``settings[OvenSettings]`` is the section of that type.

    Attributes
    ----------
    choices : Choices or None
        Files of choices, whose names can stand for the values of a section.
    """

    choices: ClassVar[Choices | None] = None

    def __getitem__(self, kind: type[Section]) -> Section:
        """The section of the type ``kind``."""
        found: Section = getattr(self, kind.section)
        return found

    def sections(self) -> Iterator[CheckedSettings]:
        """All sections, in order."""
        values = (getattr(self, item.name) for item in fields(self))  # type: ignore[arg-type]
        return (value for value in values if isinstance(value, CheckedSettings))

    def with_sections(self, *sections: CheckedSettings) -> Self:
        """These settings with other ``sections``."""
        changes: dict[str, Any] = {section.section: section for section in sections}
        return replace(self, **changes)  # type: ignore[type-var]

    def inert(self) -> Self:
        """Settings that open no connection and continue no other run; no result depends on these."""
        return self.with_sections(*(section.inert() for section in self.sections()))

    def as_yaml(self) -> str:
        """Every setting, as YAML."""
        import yaml

        values = asdict(self)  # type: ignore[call-overload]
        text: str = yaml.safe_dump(values, sort_keys=False, default_flow_style=None, width=110)
        return text

    @classmethod
    def of(cls, sections: Mapping[str, Any]) -> Self:
        """Settings of ``sections``; sections and keys that are not given have their defaults.

        Parameters
        ----------
        sections : mapping of str to value
            Names of fields, each with a value of its type. The value of a section can also be a mapping of
            its keys or the name of one of the ``choices``, which can set other sections, too.

        Raises
        ------
        ConfigError
            If a key is unknown, or a value of the wrong type or out of range.
        """
        values = {name: cls.values_of(name, value) for name, value in sections.items()}
        for name, choice in sections.items():
            chosen = values[name] if isinstance(choice, str) else None
            if isinstance(chosen, Mapping) and isinstance(chosen.get(name), Mapping):
                values = _of_several(values.pop(name), values)
        return cls.of_values(values)

    @classmethod
    def of_values(cls, values: Mapping[str, Any]) -> Self:
        """Settings of keys and values alone; each section is a mapping of its keys."""
        made: Self = settings_of(cls, values, unknown=cls.unknown)
        return made

    @classmethod
    def of_file(cls, path: Path, changes: Mapping[str, Any] | None = None) -> Self:
        """The settings of a file that :meth:`as_yaml` made, with ``changes`` by ``section.key``.

        Settings of earlier versions (``gone``) are left out. DataError if the file is damaged.
        """
        content = read_values(path)
        for key in cls.gone_settings():
            section, _, name = key.partition(".")
            if isinstance(content.get(section), dict):
                content[section].pop(name, None)
        for key, value in (changes or {}).items():
            section, _, name = key.partition(".")
            if not isinstance(before := content.get(section, {}), dict):
                raise DataError(f"{path}: {section} must be keys and values, found {shown_value(before)}")
            content[section] = before | {name: value}
        return cls.of(content)

    @classmethod
    def of_section(cls, name: str, value: Any) -> Any:
        """The section ``name`` of a settings object, of a mapping of its keys, or of the name of a choice."""
        return getattr(cls.of({name: value}), name)

    @classmethod
    def values_of(cls, section: str, value: Any) -> Any:
        """The keys and values of the choice ``value`` of a ``section``, if it is one; else ``value``."""
        kinds = field_kinds(cls)  # type: ignore[arg-type]  # classes have a hash
        if isinstance(value, str) and cls.choices is not None and is_dataclass(kinds.get(section)):
            return cls.choices.values(section, value)
        return value

    @classmethod
    def by_key(cls) -> Mapping[str, Setting]:
        """All settings and sections by their keys, with type, unit, range and meaning."""
        return _settings_by_key(cls)  # type: ignore[arg-type]  # classes have a hash

    @classmethod
    def gone_settings(cls) -> dict[str, str]:
        """Settings of earlier versions by their keys, and why they left."""
        sections = (one for one in cls.by_key().values() if one.is_section)
        return {f"{one.key}.{name}": reason for one in sections for name, reason in one.kind.gone.items()}

    @classmethod
    def unknown(cls, section: str, name: str, known: Iterable[str]) -> ConfigError:
        """The error for ``name`` in ``section`` (``"planner."``), with the closest of the ``known`` names."""
        if reason := cls.gone_settings().get(f"{section}{name}"):
            return ConfigError(f"{section}{name} is no setting any more: {reason}; leave it out")
        return unknown_setting(section, name, known)

    @classmethod
    def named_in(cls, message: str) -> dict[str, list[str]]:
        """The settings that a ``message`` names: of each section its keys, in the order of the text."""
        found: dict[str, list[str]] = {}
        for section, key in dict.fromkeys(SETTING_NAME.findall(message)):
            if f"{section}.{key}" in cls.by_key():
                found.setdefault(section, []).append(key)
        return found


@lru_cache
def _settings_by_key(schema: type) -> dict[str, Setting]:
    return {one.key: one for one in settings_below(schema)}


def _of_several(chosen: Mapping[str, Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """``values``, and what a choice of several sections sets, which they override."""
    more = dict(values)
    for section, keys in chosen.items():
        given = values.get(section, {})
        both = isinstance(keys, Mapping) and isinstance(given, Mapping)
        more[section] = {**keys, **given} if both else values.get(section, keys)
    return more


def with_added_sections(group: Group) -> Callable[[type[Whole]], type[Whole]]:
    """A decorator below ``dataclass``, which adds a field for each section that other packages add.

    The entry points of ``group`` are tuples of sections.
    """

    def extended(own: type[Whole]) -> type[Whole]:
        names, added = list(own.__annotations__), dict[str, type]()
        for table in group.load_all(_are_sections):
            place = len(names)
            for section in table:
                name = section.section
                if hasattr(own, name):
                    raise ConfigError(
                        f"settings {name!r} of {section.__module__}: the name is taken; uninstall it"
                    )
                place = names.index(section.after) + 1 if section.after else place
                names.insert(place, name)
                place += 1
                setattr(own, name, field(default_factory=section))
                added[name] = section
        own.__annotations__ = {name: added.get(name) or own.__annotations__[name] for name in names}
        return own

    return extended


def _are_sections(table: Any) -> bool:
    return isinstance(table, tuple) and all(
        isinstance(kind, type) and issubclass(kind, CheckedSettings) for kind in table
    )
