"""What a setting may be: unit, range and meaning are written once, beside the setting.

:func:`setting` declares a field; :class:`CheckedSettings` checks every field of a section when the section
is made. ``pareto-ltl --help=all`` prints the same words.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from copy import deepcopy
from dataclasses import Field, dataclass, field, fields
from typing import Any, ClassVar

from pareto_ltl.support.errors import ConfigError
from pareto_ltl.support.extensions import extension_names

DECLARED = "declared"  # key of a field's metadata


@dataclass(frozen=True, slots=True)
class Declaration:
    """Meaning, unit and range of a setting; of a list, the range of each item.

    Attributes
    ----------
    least, most : float or None
        Smallest and largest value, both allowed.
    above, below : float or None
        Limits that are not allowed themselves.
    not_negative : bool
        The same as ``least=0``; the message then says "must not be negative".
    distinct : bool
        A list that is not empty and holds no value twice.
    remark : str
        What the limits stand for; printed in brackets after them.
    group : str
        Entry points whose names are choices too (``support.extensions``).
    """

    meaning: str
    unit: str | None = None
    least: float | None = None
    most: float | None = None
    above: float | None = None
    below: float | None = None
    not_negative: bool = False
    choices: tuple[str, ...] = ()
    distinct: bool = False
    remark: str = ""
    group: str = ""

    def all_choices(self) -> tuple[str, ...]:
        """Our own choices, then those that other packages add."""
        return (*self.choices, *(extension_names(self.group) if self.group else ()))

    def range_text(self) -> str:
        """The range in words, e.g. "at least 1"; empty where every value is allowed."""
        remark = f" ({self.remark})" if self.remark else ""
        if self.choices:
            return f"one of {', '.join(self.all_choices())}"
        if self.above is not None and self.below is not None:
            return f"between {self.above:g} and {self.below:g}, both excluded{remark}"
        if self.least is not None and self.most is not None:
            return f"in [{self.least:g}, {self.most:g}]{remark}"
        if self.above == 0:
            return f"positive{remark}"
        if self.not_negative:
            return f"not negative{remark}"
        return f"at least {self.least:g}{remark}" if self.least is not None else ""

    def demand(self) -> str:
        """The range as an error message says it after "must", e.g. "be positive [s]"."""
        text = self.range_text()
        if text.startswith("one of"):
            return f"be {text}"
        if text.startswith(("between", "in ")):
            return f"lie {text}"
        unit = f" [{self.unit}]" if self.unit else ""
        return f"{text.replace('not ', 'not be ') if self.not_negative else f'be {text}'}{unit}"

    def allows(self, value: Any) -> bool:
        """Whether one value (an item, where the setting is a list) lies in the range; never for NaN."""
        if self.choices:
            return value in self.choices or value in self.all_choices()
        if not self.range_text():
            return True
        least = 0.0 if self.not_negative else self.least
        return math.isfinite(value) and (
            (least is None or value >= least)
            and (self.most is None or value <= self.most)
            and (self.above is None or value > self.above)
            and (self.below is None or value < self.below)
        )


def setting(default: Any, meaning: str, **limits: Any) -> Any:
    """A field with its default, meaning and range (the attributes of :class:`Declaration`)."""
    metadata = {DECLARED: Declaration(meaning, **limits)}
    if isinstance(default, list | dict):
        return field(default_factory=lambda: deepcopy(default), metadata=metadata)
    return field(default=default, metadata=metadata)


def declarations(section: Any) -> Iterator[tuple[Field[Any], Declaration]]:
    """The fields of a section (a class or an object) that :func:`setting` made, in order."""
    for item in fields(section):
        if DECLARED in item.metadata:
            yield item, item.metadata[DECLARED]


class CheckedSettings:
    """A section of the settings; ``section`` is its key on the command line."""

    section: ClassVar[str] = ""

    def __post_init__(self) -> None:
        for item, declared in declarations(self):
            key = f"{self.section}.{item.name}" if self.section else item.name
            check_value(key, getattr(self, item.name), declared)
        self.check_combinations()

    def check_combinations(self) -> None:
        """Refuse what is wrong about several values together, or about the shape of one."""


def check_value(key: str, value: Any, declared: Declaration) -> None:
    """Raise :class:`ConfigError` if ``value`` (or an item of a list) is out of range; None is allowed."""
    if declared.distinct:
        _check_distinct(key, value, declared)
    for item in value if isinstance(value, list) else [value]:
        if item is not None and not declared.allows(item):
            found = f"; got {item!r}" if declared.choices else f", got {item}"
            raise ConfigError(f"{key} must {declared.demand()}{found}")


def _check_distinct(key: str, values: list[Any], declared: Declaration) -> None:
    if not values and declared.choices:
        raise ConfigError(f"{key} is empty: list at least one of {', '.join(declared.choices)}")
    if not values:
        raise ConfigError(f"{key} is empty: list at least one value, e.g. {key}=[1,2,3]")
    if len({str(value) for value in values}) < len(values):
        raise ConfigError(f"{key} lists a value twice, got {values}")


def are_number_rows(value: Any, width: int) -> bool:
    """Whether ``value`` is a list of rows of ``width`` finite numbers.

    A schema of floats would refuse ``[1, 0]``, which holds whole numbers.
    """
    return isinstance(value, list) and all(
        isinstance(row, list)
        and len(row) == width
        and all(isinstance(number, int | float) and math.isfinite(number) for number in row)
        for row in value
    )


def check_matrix(key: str, value: Any) -> None:
    """Raise :class:`ConfigError` unless ``value`` is a 2 x 2 matrix of finite numbers."""
    if not are_number_rows(value, 2) or len(value) != 2:
        raise ConfigError(f"{key} must be a 2 x 2 matrix of numbers, got {value}")


def check_outline(key: str, value: Any) -> None:
    """Raise :class:`ConfigError` unless ``value`` is a list of pairs of finite numbers."""
    if not are_number_rows(value, 2):
        raise ConfigError(f"{key} must be a list of [longitude, latitude] in degrees, got {value}")
