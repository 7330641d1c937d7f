"""Errors that a user can correct; the one line of each states how."""

from __future__ import annotations


class UserError(Exception):
    """Base class of the errors that a command line reports in one line instead of a traceback."""


class ConfigError(UserError):
    """A setting is unknown, missing, of the wrong type or out of range."""


class DataError(UserError):
    """An input, such as a file or a cache, is not as expected."""
