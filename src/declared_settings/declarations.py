"""Declarations of settings: unit, range, choices and meaning, written once beside each setting.

:func:`setting` declares a field; :class:`declared_settings.CheckedSettings` checks every field of a section
when the section is made.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from copy import deepcopy
from dataclasses import Field, dataclass, field, fields, is_dataclass
from functools import lru_cache
from typing import Any

from careful_io.errors import ConfigError
from careful_io.messages import shown_value
from declared_settings.extensions import Group
from declared_settings.kinds import field_kinds, fits_kind, is_finite, kind_problem, kind_text

DECLARED = "declared"  # key of a field's metadata


@dataclass(frozen=True, slots=True)
class Declaration:
    """Meaning, unit and range of a setting; of a list, the range of each item.

    Attributes
    ----------
    within : str
        The allowed numbers as an interval, ``[a, b]``, ``(a, b)`` without its ends or ``(0, b]``; empty: all.
    distinct : bool
        The setting is a list that must not be empty and must not hold a value twice.
    remark : str
        What the limits mean; printed in brackets after them.
    kinds : callable or None
        Returns further built-in choices, when they are needed first: the names in a table of kinds.
    group : Group or None
        Entry points whose names are allowed in addition to ``choices``.
    words : tuple of str
        Words that are allowed instead of a number, e.g. ``auto``; the type of the setting is then Any.
    """

    meaning: str
    within: str = ""
    unit: str | None = None
    choices: tuple[str, ...] = ()
    distinct: bool = False
    remark: str = ""
    kinds: Callable[[], Iterable[str]] | None = None
    group: Group | None = None
    words: tuple[str, ...] = ()

    @property
    def built_in(self) -> tuple[str, ...]:
        """The choices of the program itself."""
        return (*self.choices, *(self.kinds() if self.kinds is not None else ()))

    def all_choices(self) -> tuple[str, ...]:
        """Built-in choices, then those that other installed packages add."""
        return (*self.built_in, *(self.group.names() if self.group is not None else ()))

    def range_text(self) -> str:
        """The range in words, e.g. "at least 1"; empty if every value is allowed."""
        return " or ".join([self._number_range(), *self.words])

    def _number_range(self) -> str:
        if self.built_in:
            return f"one of {', '.join(self.all_choices())}"
        if not self.within:
            return ""
        low, high = map(limit_text, interval_ends(self.within))
        texts = {
            "()": f"between {low} and {high}, both excluded",
            "[]": f"in [{low}, {high}]",
            "(]": f"positive and at most {high}",
        }
        text = texts[self.within[0] + self.within[-1]]
        return f"{text} ({self.remark})" if self.remark else text

    def demand(self) -> str:
        """The range as it follows "must" in an error message, e.g. "be positive [s]"."""
        text = self._number_range()
        verb = "lie" if text.startswith(("between", "in ")) else "be"
        unit = f" [{self.unit}]" if self.unit and not self.built_in else ""
        words = f" or be {' or '.join(self.words)}" if self.words else ""
        return f"{verb} {text}{unit}{words}"

    def allows(self, value: Any) -> bool:
        """Whether one value (for a list: one item) is in the range; False for NaN if there is a range."""
        if self.built_in:
            return value in self.built_in or value in self.all_choices()
        if not self.range_text() or (isinstance(value, str) and value in self.words):
            return True
        if not is_finite(value) or not self.within:
            return is_finite(value)
        low, high = interval_ends(self.within)
        above = value >= low if self.within[0] == "[" else value > low
        below = value <= high if self.within[-1] == "]" else value < high
        return bool(above and below)


def limit_text(limit: float) -> str:
    """A limit as text: in digits up to a million, e.g. 10000, above that with an exponent, e.g. 1e7."""
    return f"{limit:.10g}" if abs(limit) <= 1e6 else f"{limit:g}".replace("e+0", "e").replace("e+", "e")


@lru_cache
def interval_ends(text: str) -> tuple[float, float]:
    """The ends of an interval such as ``[0, 1e6]``; whole numbers are exact."""
    low, high = (int(end) if end.isdigit() else float(end) for end in text[1:-1].split(", "))
    return low, high


def setting(default: Any, meaning: str, within: str = "", **more: Any) -> Any:
    """A dataclass field with a default; the others are the attributes of :class:`Declaration`."""
    metadata = {DECLARED: Declaration(meaning, within, **more)}
    if isinstance(default, list | dict):
        return field(default_factory=lambda: deepcopy(default), metadata=metadata)
    return field(default=default, metadata=metadata)


def declarations(section: Any) -> Iterator[tuple[Field[Any], Declaration]]:
    """The fields of a section (a class or an object) that :func:`setting` made, in order."""
    for item in fields(section):
        if DECLARED in item.metadata:
            yield item, item.metadata[DECLARED]


@dataclass(frozen=True, slots=True)
class Setting:
    """A setting, or a section of them: its key as a user types it, its type, and its declaration.

    Attributes
    ----------
    kind : type
        Of a section, its dataclass.
    declared : Declaration or None
        None for a section.
    """

    key: str
    kind: Any
    declared: Declaration | None

    @property
    def is_section(self) -> bool:
        """Whether it is a section."""
        return is_dataclass(self.kind)

    @property
    def kind_text(self) -> str:
        """The type in words: "a whole number", "a list of numbers", "text or null"."""
        return kind_text(self.kind)

    def problem(self, value: Any) -> str:
        """Message for a ``value`` that does not have the type."""
        return kind_problem(self.key, value, self.kind)

    def check(self, value: Any) -> None:
        """Raise ConfigError for a ``value`` of another type or out of range."""
        if not fits_kind(value, self.kind):
            raise ConfigError(self.problem(value))
        if self.declared is not None:
            check_value(self.key, value, self.declared)


def settings_below(schema: Any, where: str = "") -> Iterator[Setting]:
    """All settings and sections of the dataclass ``schema``, a section before what is in it."""
    for item in fields(schema):
        kind = field_kinds(schema)[item.name]
        yield Setting(where + item.name, kind, item.metadata.get(DECLARED))
        if is_dataclass(kind):
            yield from settings_below(kind, f"{where}{item.name}.")


def check_value(key: str, value: Any, declared: Declaration) -> None:
    """Raise :class:`ConfigError` if ``value`` (or an item of a list) is out of range.

    None is allowed, unless the setting has ``words``.
    """
    if declared.distinct:
        _check_distinct(key, value, declared)
    for item in value if isinstance(value, list) and not declared.words else [value]:
        if (item is not None or declared.words) and not declared.allows(item):
            found = "; got" if declared.built_in else ", got"
            raise ConfigError(f"{key} must {declared.demand()}{found} {shown_value(item)}")


def _check_distinct(key: str, values: list[Any], declared: Declaration) -> None:
    if not values and declared.built_in:
        raise ConfigError(f"{key} is empty: list at least one of {', '.join(declared.built_in)}")
    if not values:
        raise ConfigError(f"{key} is empty: list at least one value, e.g. {key}=[1,2,3]")
    if len({str(value) for value in values}) < len(values):
        raise ConfigError(f"{key} lists a value twice, got {shown_value(values)}")
