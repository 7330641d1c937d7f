"""Declarations of settings: type, unit, range and meaning are written once, beside the setting.

:func:`setting` declares a field; :class:`CheckedSettings` checks every field of a section when the section
is made. ``pareto-ltl --help=all`` prints the declarations.
"""

from __future__ import annotations

import math
import re
import typing
from collections.abc import Callable, Iterable, Iterator, Mapping
from copy import deepcopy
from dataclasses import Field, dataclass, field, fields, is_dataclass, replace
from datetime import datetime
from functools import lru_cache
from numbers import Integral, Real
from types import NoneType, UnionType
from typing import TYPE_CHECKING, Any, ClassVar, Self

from careful_io.messages import shown_value, wrong_value
from pareto_ltl.support.errors import ConfigError
from pareto_ltl.support.extensions import extension_names

if TYPE_CHECKING:
    from flight_quantities.levels import Level
    from pareto_ltl.settings import Settings

KIND_TEXTS = {int: "a whole number", float: "a number", str: "text", bool: "true or false"}
ITEM_TEXTS = {int: "whole numbers", float: "numbers", str: "texts"}
DECLARED = "declared"  # key of a field's metadata
FIRST_YEAR, LAST_YEAR = 1900, 2200  # of a departure or a wind time; any other year is an error of the user
SEEDS = f"[0, {2**63 - 1}]"
FOLDER_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,99}(?<!\.)")  # Windows drops a dot at the end
DEVICES = ("con", "prn", "aux", "nul", *(f"{port}{n}" for port in ("com", "lpt") for n in range(10)))


# --- types -----------------------------------------------------------------------------------


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


# --- ranges ----------------------------------------------------------------------------------


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
    group : str
        Group of entry points whose names are allowed in addition to ``choices`` (``support.extensions``).
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
    group: str = ""
    words: tuple[str, ...] = ()

    @property
    def built_in(self) -> tuple[str, ...]:
        """The choices that this package has."""
        return (*self.choices, *(self.kinds() if self.kinds is not None else ()))

    def all_choices(self) -> tuple[str, ...]:
        """Built-in choices, then those that other installed packages add."""
        return (*self.built_in, *(extension_names(self.group) if self.group else ()))

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


def is_finite(value: Any) -> bool:
    """Whether ``value`` is a number, of Python or of NumPy, that is neither NaN nor infinite."""
    return fits_kind(value, float) and (isinstance(value, Integral) or math.isfinite(value))


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


class CheckedSettings:
    """Base of all sections of the settings; ``section`` is the key on the command line.

    Construction raises :class:`ConfigError` if a value has the wrong type or is out of range.

    Attributes
    ----------
    after : str
        Of a section that another package adds: the section of the planner behind which it stands. Empty:
        behind the section before it in its table; the first one stands at the end.
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

    def complete(self, settings: Settings) -> None:
        """Set what other sections of ``settings`` leave open to this one; refuse what contradicts them."""

    def stated_height(self) -> tuple[str, Level] | None:
        """The height of the flight, if the section states it: ``key=value``, and the level."""

    def inert(self) -> Self:
        """The section without what opens a connection or continues another run."""
        return replace(self, **dict.fromkeys(self.acts))  # type: ignore[type-var]


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


def are_pairs(value: Any) -> bool:
    """Whether ``value`` is a list of pairs of finite numbers.

    Used for settings of type Any: Hydra refuses the integers ``[1, 0]`` for a list of floats.
    """
    return isinstance(value, list) and all(
        isinstance(pair, list) and len(pair) == 2 and all(map(is_finite, pair)) for pair in value
    )


def check_matrix(key: str, value: Any) -> None:
    """Raise :class:`ConfigError` unless ``value`` is a 2 x 2 matrix of finite numbers."""
    if not are_pairs(value) or len(value) != 2:
        raise wrong_value(key, "be a 2 x 2 matrix of numbers", value)


def check_time(key: str, text: str | None) -> None:
    """Raise :class:`ConfigError` unless ``text`` is None or an ISO 8601 time from 1900 to 2200."""
    if text is None:
        return
    expected = "expected e.g. 2018-10-09T18:00:00Z"
    try:
        stamp = datetime.fromisoformat(text.strip())
    except ValueError:
        raise ConfigError(f"{key} {shown_value(text)} is not an ISO 8601 time; {expected}") from None
    if not FIRST_YEAR <= stamp.year <= LAST_YEAR:
        raise ConfigError(
            f"{key} {shown_value(text)} is not between {FIRST_YEAR} and {LAST_YEAR}; {expected}"
        )


def check_folder_name(key: str, name: str) -> None:
    """Raise :class:`ConfigError` unless ``name`` can name a folder on every system."""
    if not FOLDER_NAME.fullmatch(name):
        signs = "be at most 100 letters (a to z), digits, dots, dashes or underscores, no dot at the end"
        raise wrong_value(key, f"{signs} (it names a folder)", name)
    if (device := name.split(".", 1)[0]).lower() in DEVICES:
        raise ConfigError(f"{key} must not begin with {device!r}, a device on Windows; write e.g. my_{name}")
