"""The record of a map."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from pareto_ltl.settings.fidelity import BORDERS
from pareto_ltl.support.arrays import FloatArray, require_shape
from pareto_ltl.support.display import Displayed, distance_text, listed_text
from pareto_ltl.world.fix_shapes import FixShape
from pareto_ltl.world.windows import Window

TITLE = re.compile(r"(obstacle )?\d+|obstacle \d+ \((?P<name>.*)\)", re.DOTALL)  # of an obstacle


@dataclass(frozen=True, slots=True, repr=False)
class Scene(Displayed):
    """A map: start of the robot, regions to visit, obstacles not to touch.

    Attributes
    ----------
    bounds : (2, 2) float
        South-west and north-east corner [m].
    start : (2,) float
        Position at departure [m].
    regions : mapping of name to tuple of (n, 2) float
        Regions of interest: each is the union of simple polygons without a common area, counter-clockwise
        [m]. The proposition of a region without polygons never holds. The constructor also accepts one
        polygon (n, 2) for a region.
    obstacles : tuple of (n, 2) float
        Simple polygons, counter-clockwise [m].
    landmarks : tuple of (n, 2) float
        Convex polygons in which the robot gets a position fix [m].
    border : str
        ``wall`` if leaving the map is a failure, else ``open``.
    crs : str or None
        PROJ string of the plane; None for a plane without position on Earth.
    time_zero : str or None
        Departure, ISO 8601 UTC; all other times are seconds since then.
    windows : mapping of proposition to Window
        When propositions hold. A window with the name of its region limits when the region is active.
    forbidden : tuple of str
        Propositions with a window that must never hold: obstacles that are active for a limited time.
    simplified : float
        Largest distance by which outlines were moved to simplify them [m]: obstacles and forbidden regions
        outwards, visited regions inwards.
    obstacle_names : tuple of str
        The name that the map gives to each obstacle, empty for those without one; () if none has a name.
    landmark_fixes : tuple of FixShape or None
        The error of fixes at each landmark, None for ``robot.fix_sd``; () if it is None for all.
    """

    bounds: FloatArray
    start: FloatArray
    regions: Mapping[str, tuple[FloatArray, ...]]
    obstacles: tuple[FloatArray, ...] = ()
    crs: str | None = None
    time_zero: str | None = None
    landmarks: tuple[FloatArray, ...] = ()
    border: str = "open"
    windows: Mapping[str, Window] = field(default_factory=dict)
    forbidden: tuple[str, ...] = ()
    simplified: float = 0.0
    obstacle_names: tuple[str, ...] = ()
    landmark_fixes: tuple[FixShape | None, ...] = ()

    def __post_init__(self) -> None:
        require_shape("bounds", self.bounds, 2, 2)
        if not (self.bounds[0] < self.bounds[1]).all():
            raise ValueError(
                f"bounds must be a south-west and a north-east corner, got {self.bounds.tolist()}"
            )
        require_shape("start", self.start, 2)
        if self.border not in BORDERS:
            raise ValueError(f"border must be one of {', '.join(BORDERS)}, got {self.border!r}")
        parts = {
            name: (found,) if isinstance(found, np.ndarray) else tuple(found)
            for name, found in self.regions.items()
        }
        object.__setattr__(self, "regions", parts)
        for polygon in (*self.region_outlines, *self.obstacles, *self.landmarks):
            require_shape("polygon", polygon, None, 2)
        if self.obstacle_names and len(self.obstacle_names) != len(self.obstacles):
            raise ValueError(f"{len(self.obstacle_names)} obstacle_names for {len(self.obstacles)} obstacles")
        if self.landmark_fixes and len(self.landmark_fixes) != len(self.landmarks):
            raise ValueError(f"{len(self.landmark_fixes)} landmark_fixes for {len(self.landmarks)} landmarks")
        for name, window in self.windows.items():
            if window.region not in self.regions:
                raise ValueError(f"window {name!r} is of {window.region!r}, which is not a region of the map")
        if missing := set(self.forbidden) - set(self.windows):
            raise ValueError(f"forbidden: {sorted(missing)} have no window")

    @property
    def walled(self) -> bool:
        """Whether leaving the map is a failure."""
        return self.border == "wall"

    @property
    def region_outlines(self) -> tuple[FloatArray, ...]:
        """The polygons of all regions."""
        return tuple(outline for outlines in self.regions.values() for outline in outlines)

    def obstacle_title(self, number: int) -> str:
        """``obstacle 3``, or ``obstacle 3 (EFKU CTR)`` if it has a name; the first has the number 1."""
        name = self.obstacle_names[number - 1] if self.obstacle_names else ""
        return f"obstacle {number} ({name})" if name else f"obstacle {number}"

    @staticmethod
    def name_in_title(text: str) -> str:
        """The name in a title of :meth:`obstacle_title`; of a number alone, none; any other text itself."""
        title = TITLE.fullmatch(text)
        return text if title is None else title["name"] or ""

    def barrier_title(self, barrier: str) -> str:
        """``barrier`` for people: for ``obstacle 3`` its title, for others, as borders, the same text."""
        kind, _, number = barrier.rpartition(" ")
        known = kind == "obstacle" and number.isdecimal() and 0 < int(number) <= len(self.obstacles)
        return self.obstacle_title(int(number)) if known else barrier

    def facts(self) -> Mapping[str, str]:
        """Size, regions, obstacles, border, departure and time windows."""
        east, north = (float(side) for side in self.bounds[1] - self.bounds[0])
        return {
            "size": f"{distance_text(east)} x {distance_text(north)}",
            "regions": listed_text(self.regions),
            "obstacles": f"{len(self.obstacles)}",
            "border": self.border,
            "departure": self.time_zero or "not set",
        } | {f"{name} holds": str(window) for name, window in self.windows.items()}
