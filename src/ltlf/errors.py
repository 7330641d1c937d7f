"""Errors of texts and formulas; each is one line that says how to correct it."""

from __future__ import annotations


class FormulaError(ValueError):
    """A formula that cannot be parsed, or that no finite word can satisfy.

    Attributes
    ----------
    column : int or None
        Zero-based position of the error in the text of the formula; None if it has no position.
    """

    def __init__(self, message: str, column: int | None = None) -> None:
        super().__init__(message)
        self.column = column


class StatesError(FormulaError):
    """An automaton with more than ``max_states`` states; ``way_out`` is how to allow more."""

    def __init__(self, max_states: int, way_out: str = "raise max_states") -> None:
        super().__init__(
            f"the automaton has more than {max_states} states; simplify the formula, pass only the letters "
            f"that can occur, or {way_out}"
        )


class PatternError(ValueError):
    """Arguments of which a pattern makes no formula."""
