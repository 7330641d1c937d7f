"""Settings from mappings of Python values, which are converted to the types of their fields."""

from __future__ import annotations

import typing
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import is_dataclass
from pathlib import Path
from types import NoneType, UnionType
from typing import Any

from careful_io.errors import ConfigError
from careful_io.messages import shown_text
from declared_settings.kinds import field_kinds, kind_problem

Unknown = Callable[[str, str, Iterable[str]], ConfigError]


def unknown_setting(section: str, name: str, known: Iterable[str]) -> ConfigError:
    """The error for ``name`` in ``section`` (``"planner."``), with the closest of the ``known`` names."""
    import difflib

    names = list(dict.fromkeys(known))  # a group of choices can have the name of a section
    near = difflib.get_close_matches(name, names, n=1)
    hint = f"did you mean {section}{near[0]}?" if near else f"there are {', '.join(names)}"
    return ConfigError(f"unknown setting {shown_text(f'{section}{name}')}; {hint}")


def settings_of(
    schema: Any, values: Mapping[str, Any], where: str = "", unknown: Unknown = unknown_setting
) -> Any:
    """``schema(**values)`` with each value converted to the type of its field; a section is a mapping.

    ``where`` begins the keys of messages (``"planner."``). Raises ConfigError if a key is not known, which
    ``unknown`` makes, or if a value is of the wrong type or out of range.
    """
    types = field_kinds(schema)
    for name in values:
        if name not in types:
            raise unknown(where, str(name), types)
    typed = {name: _typed(types[name], value, where + name, unknown) for name, value in values.items()}
    return schema(**typed)


def _typed(kind: Any, value: Any, key: str, unknown: Unknown) -> Any:
    """``value`` as type ``kind``: integers become floats, arrays and tuples become lists, paths become text.

    ConfigError if ``value`` does not fit.
    """
    if isinstance(kind, UnionType):
        if value is None and NoneType in kind.__args__:
            return None
        (kind,) = (arm for arm in kind.__args__ if arm is not NoneType)
    if is_dataclass(kind):
        if isinstance(value, Mapping):
            return settings_of(kind, value, f"{key}.", unknown)
        if is_dataclass(value):
            return value
    elif typing.get_origin(kind) is list:
        if isinstance(value := _as_lists(value), list):
            return [_typed(typing.get_args(kind)[0], item, key, unknown) for item in value]
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
