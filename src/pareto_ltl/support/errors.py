"""The ways in which planning can fail, each with one line that says what to do.

``ValueError`` is for callers of the Python interface who break a contract; the classes below
are for what reaches a user: the command line prints their text and ends with exit code 2.
"""

from __future__ import annotations


class ParetoLtlError(Exception):
    """Base class of the errors that the command line reports in one line instead of a traceback."""


class ConfigError(ParetoLtlError):
    """A setting is unknown, missing, of the wrong type or out of range."""


class DataError(ParetoLtlError):
    """An input (a wind file, a scene, a cache) is not as expected."""


class InfeasibleError(ParetoLtlError):
    """There is no answer with the given settings; the message says which setting to change."""


class FormulaError(ParetoLtlError, ValueError):
    """A mission formula that cannot be read, or that no finite flight can complete.

    Attributes
    ----------
    column : int or None
        Zero-based position in the formula's text, where there is one.
    """

    def __init__(self, message: str, column: int | None = None) -> None:
        super().__init__(message)
        self.column = column


__all__ = ["ConfigError", "DataError", "FormulaError", "InfeasibleError", "ParetoLtlError"]
