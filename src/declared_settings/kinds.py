"""Types of settings: whether a value has one, in words, and a value of Python as one."""

from __future__ import annotations

import math
import typing
from dataclasses import fields, is_dataclass
from functools import lru_cache
from numbers import Integral, Real
from types import NoneType, UnionType
from typing import Any

from careful_io.messages import shown_value

KIND_TEXTS = {int: "a whole number", float: "a number", str: "text", bool: "true or false"}
ITEM_TEXTS = {int: "whole numbers", float: "numbers", str: "texts"}


@lru_cache(maxsize=64)
def field_kinds(schema: Any) -> dict[str, Any]:
    """The type of each field of the dataclass ``schema``, by field name."""
    hints = typing.get_type_hints(schema)
    return {item.name: hints[item.name] for item in fields(schema)}  # a class variable is no field


def fits_kind(value: Any, kind: Any) -> bool:
    """Whether ``value`` has the type ``kind``; NumPy numbers count as numbers, booleans do not."""
    if kind is Any:
        return True
    if isinstance(kind, UnionType):
        return any(fits_kind(value, arm) for arm in kind.__args__)
    if kind is NoneType:
        return value is None
    if typing.get_origin(kind) is list:
        (item,) = typing.get_args(kind)
        return isinstance(value, list) and all(fits_kind(part, item) for part in value)
    if typing.get_origin(kind) is dict:
        return isinstance(value, dict)
    if kind in (int, float):
        return isinstance(value, Integral if kind is int else Real) and not isinstance(value, bool)
    return isinstance(value, kind)


def is_finite(value: Any) -> bool:
    """Whether ``value`` is a number, of Python or of NumPy, that is neither NaN nor infinite."""
    return fits_kind(value, float) and (isinstance(value, Integral) or math.isfinite(value))


def kind_text(kind: Any) -> str:
    """A type in words: "a whole number", "a list of numbers", "text or null"."""
    if isinstance(kind, UnionType):
        return " or ".join("null" if arm is NoneType else kind_text(arm) for arm in kind.__args__)
    if typing.get_origin(kind) is list:
        (item,) = typing.get_args(kind)
        return f"a list of {ITEM_TEXTS[item]}" if item in ITEM_TEXTS else "a list"
    if typing.get_origin(kind) is dict:
        return "a mapping of names to values"
    if is_dataclass(kind):
        return "a choice, a mapping or a settings object"
    return KIND_TEXTS.get(kind, str(getattr(kind, "__name__", kind)))


def kind_problem(key: str, value: Any, kind: Any) -> str:
    """Message for a ``value`` of ``key`` that does not have the type ``kind``."""
    whole = kind is int and isinstance(value, float) and value.is_integer()
    cure = f"; write it in digits, {int(value)}" if whole and abs(value) < 1e18 else ""
    return f"{key} must be {kind_text(kind)}, got {shown_value(value)}{cure}"
