"""The polygons and transitions of the margin of a flight, and the numbers of binding events.

A binding event is the signed distance of one point of a flight from one line or corner. During the search it
is represented by a number, since storing whole events takes three times as long.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from plane_kernels.clearance import CERTAIN, Event, segment_clearance
from plane_kernels.types import BoolArray, Cells, Corners, Faces, FloatArray, IntArray, Point
from plane_logic.types import Logic
from typed_kernels.jit import by_type, inlined, kernel

NOWHERE = -1  # number, and step, of "no event"
SATURATED = 12.0  # widths of the sigmoid: margins below minus this count as -CERTAIN, an error of 6e-6


class Guards(NamedTuple):
    """Transitions between claims "the state is at least as good as p", and their letters.

    Edge i leads from ``source[i]`` to ``target[i]`` if one of the letters ``letter[ptr[i]:ptr[i + 1]]`` is
    read or, with ``spared[i]``, if none of them is read. ``patient``: the empty letter leaves every claim
    unchanged. ``barring``: every hazard ends the mission or does nothing, so that margins need no automaton
    states of flights. In epoch e, the edges ``first[e, q]`` to ``first[e, q + 1]`` lead from q. ``needs``
    (Q,): bit set of the letters that every path from q to acceptance reads, 0 in small automata.
    """

    source: IntArray
    target: IntArray
    spared: BoolArray
    ptr: IntArray
    letter: IntArray
    patient: bool
    barring: bool
    first: IntArray
    needs: IntArray


class MarginModel(NamedTuple):
    """Polygons and automaton of a margin; face k of a polygon is the edge from its corner k to the next.

    ``shown`` are the convex polygons that have a letter, ``first`` (M + 1,) is the first polygon of each of
    the M letters, ``letter`` the letter of each polygon, ``column`` (M,) the column of each letter in
    ``logic.delta``. ``faces`` and ``corners`` are the barriers:
    obstacles, and walls as one face without corners. ``hazards`` are the faces of the cells
    ``logic.hazards``.
    """

    shown: Faces
    first: IntArray
    letter: IntArray
    column: IntArray
    guards: Guards
    faces: Faces
    corners: Corners
    hazards: Faces
    cells: Cells
    logic: Logic


class Met(NamedTuple):
    """The barrier that binds in each flight (n,), as an event: step, normal and share of the step."""

    t: IntArray
    nx: FloatArray
    ny: FloatArray
    share: FloatArray


class Near(NamedTuple):
    """Bounding boxes of all flights, and the polygons near them.

    Attributes
    ----------
    box : (T+1, 4) float
        Bounding box of all positions after each step: centre (x, y), half width and half height [m].
    shown_first : (T+2,) int, shown : int
        Polygons ``shown[shown_first[t]:shown_first[t + 1]]`` are near at step t.
    met_first : (T+1,) int, met : int
        Barriers ``met[met_first[t]:met_first[t + 1]]`` are near the segments from step t.
    crossed_first : (T+1,) int, crossed : int
        The same for hazards and their segments.
    """

    box: FloatArray
    shown_first: IntArray
    shown: IntArray
    met_first: IntArray
    met: IntArray
    crossed_first: IntArray
    crossed: IntArray


class Scratch(NamedTuple):
    """Memory for the margins of n flights.

    ``claims``: memory of the mission margins, whose type selects the algorithm; ``near``: polygons near the
    flights; ``margins`` (n,): the result [m]; ``event`` (n,): number of the binding event of each mission
    margin; ``met``: the binding barrier of each flight; ``ends`` (4, n) and ``gap`` (n,) are temporary: the
    segments of one step, and their distances from one barrier [m].
    """

    claims: Any
    near: Near
    margins: FloatArray
    event: IntArray
    met: Met
    ends: FloatArray
    gap: FloatArray


@by_type
def mission_margins(
    claims: Any, model: MarginModel, mean: FloatArray, off: FloatArray, floor: float, scratch: Scratch
) -> None:
    """Fill ``scratch.margins`` and ``scratch.event`` with the largest W_T of an accepting claim.

    The flights are ``mean`` (T+1, 2) + ``off`` (T+1, 2, n). A margin below ``floor`` [m] counts as
    -``CERTAIN``.

    Eq. (M53) of docs/mathematics_methods.md.
    """
    raise NotImplementedError


@kernel
def part_margin(faces: Faces, part: int, at: Point, floor: float) -> tuple[float, int]:
    """Signed distance [m] to the nearest face of a polygon, inside positive, and the row of that face.

    The distance is -CERTAIN if it is not above ``floor`` [m].
    """
    least, row = CERTAIN, -1
    for j in range(faces.ptr[part], faces.ptr[part + 1]):
        slack = faces.offset[j] - faces.normal[j, 0] * at.x - faces.normal[j, 1] * at.y
        if slack < least:
            least, row = slack, j
            if least <= floor:
                return -CERTAIN, row
    return least, row


@kernel
def letter_event(model: MarginModel, letter: int, t: int, at: Point) -> Event:
    """The largest signed distance of ``at`` over the polygons of ``letter``, as an event."""
    faces, best = model.shown, Event(-CERTAIN, t, 0.0, 0.0, 0.0)
    for k in range(model.first[letter], model.first[letter + 1]):
        least, row = part_margin(faces, k, at, best.margin)
        if least > best.margin:
            best = Event(least, t, -faces.normal[row, 0], -faces.normal[row, 1], 0.0)
    return best


# --- numbers of events ------------------------------------------------------------------------


@inlined
def letter_number(model: MarginModel, t: int, letter: int, spared: bool) -> int:
    """Number of the event "letter read (with ``spared``: not read) at step t"."""
    return 2 * (t * len(model.first) + letter) + (1 if spared else 0)


@inlined
def hazard_number(model: MarginModel, t: int, hazard: int, met: bool) -> int:
    """Number of the event "hazard missed (with ``met``: met) between step t and the next"."""
    return -2 - 2 * (t * len(model.logic.hazards.cell) + hazard) - (1 if met else 0)


@kernel
def numbered_event(
    model: MarginModel, mean: FloatArray, off: FloatArray, margin: float, number: int
) -> Event:
    """The event with a ``number``, with its gradient, in the flight ``mean`` + ``off`` (T+1, 2)."""
    if number == NOWHERE:
        return Event(margin, NOWHERE, 0.0, 0.0, 0.0)
    if number >= 0:
        t, letter = divmod(number // 2, len(model.first))
        at = Point(mean[t, 0] + off[t, 0], mean[t, 1] + off[t, 1])
        found = letter_event(model, letter, t, at)
    else:
        t, hazard = divmod((-2 - number) // 2, len(model.logic.hazards.cell))
        start = Point(mean[t, 0] + off[t, 0], mean[t, 1] + off[t, 1])
        end = Point(mean[t + 1, 0] + off[t + 1, 0], mean[t + 1, 1] + off[t + 1, 1])
        found = segment_clearance(model.hazards, model.logic.hazards, hazard, t, start, end, CERTAIN)
    sign = -1.0 if number % 2 == 1 else 1.0
    return Event(margin, t, sign * found.nx, sign * found.ny, found.share)
