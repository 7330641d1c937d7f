"""The limits of a plan: how close each segment comes to its chance constraint, what easier limits save."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from careful_io.texts import probability_text
from pareto_ltl.support.arrays import FloatArray

PRICE_KINDS = {
    "obstacle": "{} smaller on every side",
    "border": "{} farther out",
    "region": "{} larger on every side",
    "avoided": "{} smaller on every side",
    "airspeed": "{} more",
    "length": "{} more",
}  # kind: what a small change of it is, in words
SIGNIFICANT = 4.0  # standard errors of a price that is shown, at least


@dataclass(frozen=True, slots=True)
class SegmentLimits:
    """How close each of T segments comes to its chance constraint, obstacles and walls together.

    Attributes
    ----------
    nearest : tuple of str
        The barrier whose supporting line is the fewest standard deviations from the segment.
    deviations : (T,) float
        Standard deviations of its nearer end beyond that line, 40 at most.
    probability : (T,) float
        Σ_lines Q(z) of the segment, which ``planner.epsilon`` limits; Eq. (M73) of docs/mathematics.md.
    price : (T,) float
        Failures saved per metre by which all barriers were farther from the segment [1/m].
    """

    nearest: tuple[str, ...]
    deviations: FloatArray
    probability: FloatArray
    price: FloatArray

    def after(self, step: int) -> SegmentLimits:
        """The limits of the segments from ``step`` on."""
        return SegmentLimits(
            self.nearest[step:], self.deviations[step:], self.probability[step:], self.price[step:]
        )


@dataclass(frozen=True, slots=True)
class WorstSegment:
    """The segment of a path that is most likely to collide.

    Attributes
    ----------
    step : int
        Number of the segment, the first has the number 0.
    nearest : str
        Its closest barrier: ``obstacle 3``, ``the western border``, ``region c`` that the mission forbids.
    probability : float
        Σ_lines Q(z) over obstacles, walls and forbidden regions; Eq. (M73) of docs/mathematics.md.
    """

    step: int
    nearest: str
    probability: float


@dataclass(frozen=True, slots=True)
class Remedy:
    """A change that was tried on a plan, and the figures of the same path after it.

    Attributes
    ----------
    change : str
        For people: ``position feedback, robot.feedback_time=300``.
    worst_segment_probability : float
        Collision probability of the worst segment.
    failure : float
        Share of ``runs`` flights that fail.
    """

    change: str
    worst_segment_probability: float
    failure: float
    runs: int


def remedies_text(remedies: Sequence[Remedy]) -> str:
    """The figures of changes that help, at least one, for people."""
    shown = (
        f"{remedy.change}: worst segment {probability_text(remedy.worst_segment_probability)}, fails "
        f"{probability_text(remedy.failure)}"
        for remedy in remedies
    )
    return f"tried with {remedies[0].runs:,} flights of the same path each: {'; '.join(shown)}"


@dataclass(frozen=True, slots=True)
class Price:
    """The failures that a small change of one limit would save.

    Attributes
    ----------
    kind : str
        A key of :data:`PRICE_KINDS`.
    name : str
        The obstacle, border, region or limit.
    step : int or None
        The step at which the saving is largest.
    saving : float
        Fall of the failure rate per metre, and per m/s of airspeed.
    error : float
        Standard error of ``saving``: the flights that it is computed from are few. 0 where it is not known.
    """

    kind: str
    name: str
    step: int | None
    saving: float
    error: float = 0.0

    @property
    def change(self) -> str:
        """The change in words, with ``{}`` for its size: ``{} smaller on every side``."""
        return PRICE_KINDS[self.kind]

    @property
    def significant(self) -> bool:
        """Whether the interval of 95 % of the saving reaches from at least half of it to one and a half."""
        return self.saving >= SIGNIFICANT * self.error
