"""What a cost of a path is; ``costs/`` has a file for each, in which :func:`cost` decorates its function."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar


@dataclass(frozen=True, slots=True)
class Cost:
    """A cost of a path; a lower one is better.

    Attributes
    ----------
    name : str
        Its key in ``Objectives.costs``, ``plan.json`` and ``selection.costs``.
    column : str
        Its column in ``front.csv`` and its name in ``metrics.json``, with the unit.
    of : callable
        Function from the problem, positions (T+1, 2) [m] and air-relative velocities (T, 2) [m/s] to the
        cost; None if the robot has no such cost. The expected path is straight, at constant speed, between
        positions.
    text : callable
        The number with its unit, as text.
    note : str
        What the number is, in a few words, for the page.
    label : str
        Its name with the unit of axes and heads of tables; the column if it is empty.
    scale : float
        The number in the unit of ``label``, for 1 in the unit of ``column``.
    """

    name: str
    column: str
    of: Callable[..., float | None]
    text: Callable[[float], str]
    note: str = ""
    label: str = ""
    scale: float = 1.0


F = TypeVar("F", bound=Callable[..., float | None])
COSTS: dict[str, Cost] = {}  # the costs of this package


def cost(
    column: str, text: Callable[[float], str], note: str = "", label: str = "", scale: float = 1.0
) -> Callable[[F], F]:
    """Make the decorated function a cost of its name; the arguments are attributes of :class:`Cost`."""

    def add(function: F) -> F:
        name = function.__name__
        COSTS[name] = Cost(name, column, function, text, note, label, scale)
        return function

    return add
