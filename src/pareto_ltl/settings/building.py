"""Settings from Python values (names of choices in ``conf/``, mappings, settings objects), without Hydra.

The result is the same :class:`Settings` that the command line composes from the same values.
"""

from __future__ import annotations

import difflib
import re
import typing
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import fields, is_dataclass
from pathlib import Path
from types import NoneType, UnionType
from typing import TYPE_CHECKING, Any

from careful_io.messages import shown_text, shown_value
from careful_io.yaml_files import read_yaml
from pareto_ltl.settings import PRESETS, FidelityConfig, preset
from pareto_ltl.settings.checks import field_kinds, kind_problem
from pareto_ltl.support.errors import ConfigError, DataError, ParetoLtlError
from pareto_ltl.support.resources import choice_file, choices

if TYPE_CHECKING:
    from pareto_ltl.settings import Settings

SETTING_NAME = re.compile(r"\b([a-z_]+)\.([a-z_0-9]+)\b")  # in a message: planner.epsilon


def build_settings(sections: Mapping[str, Any]) -> Settings:
    """Make settings from ``sections``; sections and keys that are not given have their defaults.

    Parameters
    ----------
    sections : mapping of str to value
        Names of fields of :class:`Settings`, each with a value of its type. The value of a section can also
        be the name of a choice in ``conf/`` (``"calm"`` for ``wind``) or a mapping of its keys.

    Raises
    ------
    ConfigError
        If a key is unknown, or a value of the wrong type or out of range.
    """
    values = {name: _value(name, value) for name, value in sections.items()}
    for name, choice in sections.items():
        chosen = values[name] if isinstance(choice, str) else None
        if isinstance(chosen, Mapping) and isinstance(chosen.get(name), Mapping):
            values = _of_several(values.pop(name), values)
    return settings_of(values)


def _of_several(chosen: Mapping[str, Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """``values``, and what a choice of several sections (``@package _global_``) sets, which they override."""
    more = dict(values)
    for section, keys in chosen.items():
        given = values.get(section, {})
        more[section] = {**keys, **given} if isinstance(given, Mapping) else given
    return more


def settings_of(values: Mapping[str, Any]) -> Settings:
    """Settings from keys and values; each section is a mapping of its keys.

    The errors are the same as in :func:`build_settings`.
    """
    from pareto_ltl.settings import Settings

    built = _record(Settings, values, "")
    assert isinstance(built, Settings)
    return built


def unknown_setting(section: str, name: str, known: Iterable[str]) -> ConfigError:
    """The error for ``name`` in ``section`` (``"planner."``), with the closest of the ``known`` names."""
    if reason := _gone().get(f"{section}{name}"):
        return ConfigError(f"{section}{name} is no setting any more: {reason}; leave it out")
    names = list(dict.fromkeys(known))  # sweep is a group and a section
    near = difflib.get_close_matches(name, names, n=1)
    hint = f"did you mean {section}{near[0]}?" if near else f"there are {', '.join(names)}"
    return ConfigError(f"unknown setting {shown_text(f'{section}{name}')}; {hint}")


@contextmanager
def python_spelling() -> Iterator[None]:
    """Add a note to an error that names settings: how a caller in Python gives them."""
    try:
        yield
    except ParetoLtlError as error:
        if arguments := python_arguments(str(error)):
            error.add_note(f"in Python: pareto_ltl.plan(..., {arguments})")
        raise


def python_arguments(message: str) -> str:
    """The settings that a message names, as arguments of ``pareto_ltl.plan``; empty if it names none.

    The formula, which is its second argument, is left out.
    """
    from pareto_ltl.settings import Settings

    kinds, sections = field_kinds(Settings), dict[str, dict[str, None]]()
    for section, key in SETTING_NAME.findall(message):
        known = getattr(kinds.get(section), "__dataclass_fields__", ())
        if key in known and (section, key) != ("mission", "formula"):
            sections.setdefault(section, {})[f'"{key}": ...'] = None
    return ", ".join(f"{section}={{{', '.join(keys)}}}" for section, keys in sections.items())


def read_settings_file(path: Path, changes: Mapping[str, Any] | None = None) -> Settings:
    """The settings that a run wrote as ``config_resolved.yaml``, with ``changes`` by ``section.key``.

    What earlier versions wrote about the models of trees is left out. DataError if the file is damaged.
    """
    content = _yaml(path)
    for key in _gone():
        section, _, name = key.partition(".")
        if isinstance(content.get(section), dict):
            content[section].pop(name, None)
    for key, value in (changes or {}).items():
        section, _, name = key.partition(".")
        if not isinstance(before := content.get(section, {}), dict):
            raise DataError(f"{path}: {section} must be keys and values, found {shown_value(before)}")
        content[section] = before | {name: value}
    return build_settings(content)


def _gone() -> dict[str, str]:
    """Settings of earlier versions, and why they left."""
    from pareto_ltl.settings import Settings

    sections = (one for one in Settings.by_key().values() if one.is_section)
    return {f"{one.key}.{name}": reason for one in sections for name, reason in one.kind.gone.items()}


def section_of(section: str, value: Any) -> Any:
    """The settings of one section: ``value`` is a settings object, a mapping, or the name of a choice."""
    return getattr(build_settings({section: value}), section)


def choice_values(section: str, name: str) -> dict[str, Any]:
    """The keys and values of the choice ``name`` of ``section`` in ``conf/``."""
    return _yaml(choice_file(section, name))


def _value(section: str, value: Any) -> Any:
    """The keys and values of a choice or a mapping.

    Values of ``fidelity`` override its preset, values of ``wind`` the choice of its source, which has other
    bounds for a current than for a wind.
    """
    from pareto_ltl.settings import Settings

    schema = field_kinds(Settings).get(section)
    if isinstance(value, str) and is_dataclass(schema):
        return choice_values(section, value)
    if section == "wind" and isinstance(value, Mapping) and str(value.get("source")) in choices("wind"):
        return choice_values(section, str(value["source"])) | dict(value)
    if schema is FidelityConfig and isinstance(value, Mapping):
        name = str(value.get("name", FidelityConfig.name))
        # A name that is not a preset is refused later, when all values are checked.
        base = preset(name) if name in PRESETS else FidelityConfig()
        return {f.name: getattr(base, f.name) for f in fields(base)} | dict(value)
    return value


def _yaml(path: Path) -> dict[str, Any]:
    content = read_yaml(path)
    if not isinstance(content, dict | None):
        raise DataError(f"{path}: expected keys and values, found {type(content).__name__}")
    return content or {}


def _record(schema: Any, values: Mapping[str, Any], where: str) -> Any:
    """``schema(**values)`` with each value converted to the type of its field."""
    types = field_kinds(schema)
    for name in values:
        if name not in types:
            raise unknown_setting(where, str(name), types)
    return schema(**{name: _typed(types[name], value, where + name) for name, value in values.items()})


def _typed(kind: Any, value: Any, key: str) -> Any:
    """``value`` as type ``kind``: integers become floats, arrays and tuples become lists, paths become text.

    ConfigError if ``value`` does not fit.
    """
    if isinstance(kind, UnionType):
        if value is None and NoneType in kind.__args__:
            return None
        (kind,) = (arm for arm in kind.__args__ if arm is not NoneType)
    if is_dataclass(kind):
        if isinstance(value, Mapping):
            return _record(kind, value, f"{key}.")
        if is_dataclass(value):
            return value
    elif typing.get_origin(kind) is list:
        if isinstance(value := _as_lists(value), list):
            return [_typed(typing.get_args(kind)[0], item, key) for item in value]
    elif typing.get_origin(kind) is dict:
        if isinstance(value, Mapping):
            return {str(name): _as_lists(item) for name, item in value.items()}
    elif kind is float and not isinstance(value, bool):
        with suppress(TypeError, ValueError, OverflowError):
            return float(value)
    elif kind is str and isinstance(value, str | Path):
        return str(value)
    elif kind is Any or (type(value) is kind):
        return _as_lists(value)
    elif kind is int and hasattr(value, "__index__") and not isinstance(value, bool):
        return int(value)
    raise ConfigError(kind_problem(key, value, kind))


def _as_lists(value: Any) -> Any:
    """Arrays and tuples as lists, at any depth."""
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, list | tuple):
        return [_as_lists(item) for item in value]
    return value
