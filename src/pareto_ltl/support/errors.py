"""Errors that a user can correct; the one line of each states how.

The command line prints the text of these classes and ends with exit code 2. A ``ValueError`` that is none
of them means that a caller in Python passed a wrong argument.
"""

from __future__ import annotations

from careful_io.errors import ConfigError, DataError
from careful_io.errors import UserError as ParetoLtlError

__all__ = ["ConfigError", "DataError", "FormulaError", "InfeasibleError", "NotFoundError", "ParetoLtlError"]


class NotFoundError(DataError):
    """There is no plan, point, format or example of that name."""


class InfeasibleError(ParetoLtlError):
    """There is no answer with the given settings; the message names the setting to change."""


class FormulaError(ParetoLtlError, ValueError):
    """A mission formula that cannot be parsed, or that no finite flight can satisfy.

    Attributes
    ----------
    column : int or None
        Zero-based position of the error in the text of the formula; None if it has no position.
    """

    def __init__(self, message: str, column: int | None = None) -> None:
        super().__init__(message)
        self.column = column
