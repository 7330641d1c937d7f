"""Checks of values that a type and a range do not state: pairs, matrices, times, names of folders."""

from __future__ import annotations

import re
from datetime import datetime
from typing import Any

from careful_io.errors import ConfigError
from careful_io.messages import shown_value, wrong_value
from declared_settings.kinds import is_finite

SEEDS = f"[0, {2**63 - 1}]"  # range of a seed of random numbers
FIRST_YEAR, LAST_YEAR = 1900, 2200  # any other year is an error of the user
FOLDER_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,99}(?<!\.)")  # Windows drops a dot at the end
DEVICES = ("con", "prn", "aux", "nul", *(f"{port}{n}" for port in ("com", "lpt") for n in range(10)))


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
