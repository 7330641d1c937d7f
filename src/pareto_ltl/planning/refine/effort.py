"""How much a sampled search does, and at which gains it stops: one record, made once from the settings."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from pareto_ltl.settings import RefineConfig


@dataclass(frozen=True, slots=True)
class Polish:
    """Effort of a refinement.

    ``widths`` τ [m] in turn, ``inner`` solves for each of them, the first ``trust`` region [full steps], and
    the penalty ``stiff`` of a standard deviation that a segment lacks of its chance constraint [failures].
    A segment that exceeds epsilon by the share ``half`` counts afterwards like one flight in two that fails.
    From ``far``, a path may be far from where it ends: its first widths are never narrower.
    """

    widths: tuple[float, ...]
    inner: int = 4
    trust: float = 0.5
    stiff: float = 2.0  # with 10, paths did not find the way to other classes
    half: float = 1.0
    far: bool = False


@dataclass(frozen=True, slots=True)
class Effort:
    """The numbers of a search: counts and ratios, without a unit where none is given.

    Section ``refine`` of the settings gives ``flights``, ``sweep_flights``, ``classes`` and ``points``.
    Coarse settings have the values of :data:`COARSE`, too. All other numbers are the same for every search.
    """

    # --- flights and scouts ---
    flights: int
    sweep_flights: int
    classes: int
    points: int
    scouts: int = 2  # sweeps fitted to different flights: more flights made seeds agree no better
    more_flights: int = 4  # times as many flights are used where failures are rare
    sweep_share: float = 0.75  # of a time budget, after which only the last polish is left

    # --- polishes, widths in map sizes: a wide τ moves a path far, a narrow one counts failures exactly ---
    spread: float = 0.004  # deviation of flights [map sizes] below which widths are narrower
    narrowest: float = 0.2  # share of the usual widths, at least
    fall: float = 4.0  # ratio of the additional widths of a polish from afar
    first: Polish = Polish((0.020, 0.007), 4, far=True)  # of a start
    sweep: Polish = Polish((0.008, 0.004), 3)  # at a length cap, from a path polished before
    wide: Polish = Polish((0.020, 0.008, 0.004), 3, far=True)  # of a path that may have to change its form
    last: Polish = Polish((0.003, 0.002), 4, stiff=20.0, half=0.1)  # of a point of the front
    finest: Polish = Polish((0.002,), 4, stiff=20.0, half=0.1)
    closing: Polish = Polish((0.002,), 1, trust=0.1)  # within the chance constraints, by a general solver
    nearer: Polish = Polish((0.002,), 12, trust=0.1)  # the same, of a path that does not keep epsilon

    # --- starts ---
    distances: tuple[float, ...] = (2.6, 1.4, 0.8, 0.0)  # of taut lines from obstacles [standard deviations]
    depths: tuple[float, ...] = (1.0, 0.5, 0.25)  # of lines in regions: 0 the rim, 1 the middle
    orders: int = 24  # mission orders that taut lines are drawn for, those with the shortest ways
    varied_orders: int = 3  # of these, those whose lines are drawn at every distance from obstacles
    lines: int = 64  # classes of lines of the roadmap, the shortest
    tree_classes: int = 24  # classes and lengths of tree paths, those with the least risk

    # --- first looks ---
    looked_lines: int = 12  # the best lines that are polished; every search has the same ones
    looked_grown: int = 6  # the best tree paths, which do not compete with lines
    looked_longest: int = 4  # the longest starts, which fail little only once they are polished
    loose: float = 1.1  # factor by which the first polish may lengthen a start
    flipped: int = 2  # candidates that are tried on the other side of obstacles
    led_rounds: int = 2  # of leading the safest candidates through one landmark more
    led: int = 4  # candidates that are led in a round
    led_looks: int = 6  # copies of these that are polished
    rival: float = 4.0  # classes that fail more than this many times as often as the best one are dropped
    hopeless: float = 0.3  # share of the success of the best start, below which candidates are dropped

    # --- sweep of the length cap ---
    spacing: float = 1.03  # ratio of neighbouring caps
    last_spacing: float = 1.03  # largest ratio of the shortest cap that paths satisfy to the next
    longer: float = 1.08  # ratio of the caps beyond the longest that pays
    within: float = 1.002  # a path may exceed its cap by this factor: polishes meet caps by a penalty
    shorten: float = 1.3  # paths up to this many times as long as the cap are shortened to it
    pays: float = 0.95  # share of the failure of a shorter path, below which a longer one pays
    unseen: float = 0.5  # flights that are added to both: differences far below one flight do not count
    spare_steps: tuple[int, ...] = (0, 1)  # beyond the fewest, besides the number of the path itself
    slower: float = 0.1  # of the fewest steps: the best path is also tried in so many more
    apart: float = 0.01  # of the fewest steps: numbers of steps that differ by less are not both tried
    compared: int = 12  # classes, besides those that are swept, whose best path is compared by all flights

    # --- last polish of a front ---
    plateau: float = 1.5  # levels of the sweep: in a wider gap longer paths do not fail less
    gaps: int = 3  # of a front that are divided in a round
    lengthened: float = 1.05  # ratio of the caps beyond the longest point
    few: int = 3  # failures of all flights that are drawn, below which a path is not made safer
    rare: int = 30  # failures of the usual flights, below which more flights are used
    economic: int = 8  # points of a front, at most, that are tried at lower airspeeds
    economic_steps: tuple[float, ...] = (1.2, 1.45, 1.75)  # factors on their steps, where energy may be saved
    repairs: tuple[int, ...] = (0, 1, 2, 4)  # steps added to a path that cannot be flown

    # --- what is left of a time budget ---
    varied: int = 4  # points of a front that are varied between two reports
    varied_steps: tuple[int, ...] = (0, 1, 2, 3, 5, 8)  # numbers of steps beyond the fewest
    bump: float = 0.03  # standard deviation of a random bend [map sizes]

    # --- long paths: the time of a search is proportional to the number of steps ---
    legs: int = 100  # runs of equal controls that paths of 150 steps and more are made of, about

    @classmethod
    def of(cls, cfg: RefineConfig) -> Effort:
        """The effort that section ``refine`` asks for."""
        effort = cls(cfg.flights, cfg.sweep_flights, cfg.classes, cfg.points)
        return replace(effort, **COARSE) if cfg == cfg.coarse() else effort

    @property
    def least(self) -> float:
        """The failure rate below which the flights do not distinguish paths."""
        return self.unseen / self.all_flights

    @property
    def all_flights(self) -> int:
        """The flights that are drawn."""
        return self.more_flights * self.flights


COARSE: dict[str, Any] = {  # of a first impression, a third of the CPU time and less
    "scouts": 1, "looked_lines": 3, "looked_grown": 3, "looked_longest": 1, "flipped": 1, "led_rounds": 0,
    "spacing": 1.1, "last_spacing": 1.06, "economic": 3,
}  # fmt: skip
USUAL = Effort.of(RefineConfig())  # of a caller that asks for starts without a search
