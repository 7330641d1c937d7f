"""Settings of the map and of the mission."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from pareto_ltl.settings.checks import SEEDS, CheckedSettings, check_time, setting
from pareto_ltl.settings.fidelity import BORDERS
from pareto_ltl.support.errors import ConfigError
from pareto_ltl.support.messages import shown_value


@dataclass
class RandomSceneConfig(CheckedSettings, section="scene.random"):
    """Regions and obstacles at random positions, in addition to those that the scene lists."""

    seed: int = setting(0, "seed of the map; the seed of the planner is the setting seed", SEEDS)
    regions: int = setting(0, "number of random regions", "[0, 26]", remark="named a to z")
    obstacles: int = setting(0, "number of random obstacles", "[0, 10_000]")
    radius: list[float] = setting(
        [0.05, 0.1],
        "smallest and largest radius, as a share of the map's shorter side, below 0.5",
        "(0, 0.5)",
    )
    gap: float = setting(
        0.02, "smallest gap between regions and obstacles, as a share of the map's shorter side", "[0, 0.5]"
    )

    def check_combinations(self) -> None:
        """Refuse radii that are not [smallest, largest]."""
        if len(self.radius) != 2 or self.radius[0] > self.radius[1]:
            raise ConfigError(
                "scene.random.radius must be [smallest, largest], shares of the map's shorter side, "
                f"got {shown_value(self.radius)}"
            )


@dataclass
class SceneConfig(CheckedSettings, section="scene"):
    """The map, in units of scene.unit; with scene.centre, a plane that is tangent to the Earth there."""

    # Coordinates are checked when the scene is built, as Hydra refuses the integers [1, 2] for floats.
    name: str = setting("scene", "name of the map")
    file: str | None = setting(
        None, "map file instead of the keys below: GeoJSON, KML (degrees) or scene.json (metres)"
    )
    unit: float = setting(1.0, "length of a coordinate unit", "[1e-3, 1e7]", unit="m")
    centre: list[float] | None = setting(
        None, "[latitude, longitude] of the middle of the bounds", unit="deg"
    )
    bounds: list[Any] = setting([], "[[west, south], [east, north]] of the map", unit="units")
    start: list[Any] = setting([], "start position [east, north]", unit="units")
    regions: dict[str, Any] = setting(
        {}, "name: corners of each region of the formula, or a list of outlines", unit="units"
    )
    obstacles: list[Any] = setting([], "corners of each obstacle", unit="units")
    windows: dict[str, Any] = setting(
        {},
        "name: {region, from, until, forbidden} of propositions that hold in a region for a limited time, "
        "e.g. a_before_noon: {region: a, until: 12h}; under the name of a region: limits that region itself; "
        "forbidden: true makes an obstacle that is active for a limited time",
    )
    border: str = setting(
        "auto",
        "whether leaving the map is a failure (wall) or not (open); auto: as the map file says, else as "
        "fidelity.border",
        choices=("auto", *BORDERS),
    )
    landmarks: list[Any] = setting(
        [],
        "corners of each area where the robot measures its position, or {corners: [...], fix: {...}} with "
        "the error of its fixes [m]: {sd: 50} or {along: 2000, across: 50, bearing: 30}; docs/maps.md",
        unit="units",
    )
    simplify: Any = setting(
        "auto",
        "how far outlines of more than 40 corners may move: obstacles outwards, visited regions inwards; "
        "auto: 1/500 of the longer side of the map, less where gaps are narrow; 0: never",
        "[0, 1e7]",
        unit="m",
        words=("auto",),
    )
    altitude: float | None = setting(
        None,
        "altitude of the flight, in the datum of the map: features with a floor above it or a ceiling "
        "below it are left out",
        "[-12_000, 1e5]",
        unit="m",
    )
    random: RandomSceneConfig = field(default_factory=RandomSceneConfig)

    def check_combinations(self) -> None:
        """Refuse a centre that is not a position on the Earth."""
        if self.centre is not None and (
            len(self.centre) != 2 or not -89 <= self.centre[0] <= 89 or not -180 <= self.centre[1] <= 360
        ):
            raise ConfigError(
                f"scene.centre must be [latitude, longitude] in degrees, got {shown_value(self.centre)}"
            )


@dataclass
class MissionConfig(CheckedSettings, section="mission"):
    """The mission of the robot, as a formula, a pattern or an automaton."""

    formula: str = setting("", "co-safe temporal-logic formula over the regions, e.g. F(a & F b)")
    start_time: str | None = setting(None, "departure, ISO 8601 UTC; null: the first wind time")
    pattern: str | None = setting(
        None, "instead of the formula: sequence, coverage, ... (the choices of the group mission)"
    )
    goals: list[str] = setting([], "regions or formulas that the pattern visits")
    avoid: list[str] = setting([], "regions that the pattern avoids")
    order: list[list[str]] = setting([], "pairs [first, then] of goals that the pattern orders")
    automaton: str | None = setting(None, "instead of the formula: a file in the HOA format")

    def check_combinations(self) -> None:
        """Refuse a start_time that is not a time."""
        check_time("mission.start_time", self.start_time)
