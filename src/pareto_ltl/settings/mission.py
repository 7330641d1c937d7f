"""Settings of what is planned: the map, the mission and the robot."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from careful_io.messages import shown_value, wrong_value
from declared_settings import SEEDS, CheckedSettings, are_pairs, check_matrix, check_time, setting
from pareto_ltl.settings.fidelity import BORDERS
from pareto_ltl.support.errors import ConfigError

POWER_KINDS = ("none", "body", "wing", "rotor", "table")
WATTS = {"within": "[0, 1e9]", "unit": "W"}


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
            pair = "be [smallest, largest], shares of the map's shorter side"
            raise wrong_value("scene.random.radius", pair, self.radius)


@dataclass
class SceneConfig(CheckedSettings, section="scene"):
    """The map, in units of scene.unit; with scene.centre, a plane that is tangent to the Earth there."""

    # Coordinates are checked when the scene is built, as Hydra refuses the integers [1, 2] for floats.
    name: str = setting("scene", "name of the map")
    file: str | None = setting(
        None, "map file instead of the keys below: GeoJSON, KML (degrees) or scene.json (metres)"
    )
    zones: list[str] = setting(
        [],
        "files whose features are added to the map of scene.file: airspace (OpenAir, ED-269, OpenAIP, FAA), "
        "fences (.plan, .waypoints), GeoJSON, KML; features without a role are obstacles",
    )
    roles: Any = setting(
        {},
        "what features without a role are: region, obstacle, start, border, landmark or none; one for "
        "all, or {FILE: role, PROPERTY: {VALUE: role}, else: role}, e.g. {class: {D: obstacle, E: none}}",
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
        "height of the flight above mean sea level (above ground with a robot.level above ground): the same "
        "height as robot.level, for maps; features with a floor above it or a ceiling below it are left out",
        "[-12_000, 32_000]",
        unit="m",
    )
    ground: float | None = setting(
        None,
        "height of the ground above mean sea level, for flights above ground: the density of the air there",
        "[-500, 9000]",
        unit="m",
        remark="null: not known, taken as 0",
    )
    random: RandomSceneConfig = field(default_factory=RandomSceneConfig)

    def check_combinations(self) -> None:
        """Refuse a centre that is not a position on the Earth."""
        if self.centre is not None and (
            len(self.centre) != 2 or not -89 <= self.centre[0] <= 89 or not -180 <= self.centre[1] <= 360
        ):
            raise wrong_value("scene.centre", "be [latitude, longitude] in degrees", self.centre)


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


# --- the robot -------------------------------------------------------------------------------


@dataclass
class PowerConfig(CheckedSettings, section="robot.power"):
    """Power P(v) that the robot draws at the airspeed v, and the energy that it may use."""

    kind: str = setting(
        "none",
        "law of P: none (energy is not reported), body (base + drag v³), wing (base + drag v³ + lift / v), "
        "rotor (base + blade (1 + 3 v²/tip²) + lifting (√(1 + v⁴/4 wake⁴) - v²/2 wake²)^½ + drag v³), or "
        "table (through points)",
        choices=POWER_KINDS,
    )
    base: float = setting(0.0, "power at any airspeed: computer, sensors, payload", **WATTS)
    drag: float = setting(
        0.0, "body, wing and rotor: drag, multiplied by the airspeed cubed", "[0, 1e9]", unit="W s³/m³"
    )
    lift: float = setting(0.0, "wing: induced drag, divided by the airspeed", "[0, 1e12]", unit="W m/s")
    blade: float = setting(0.0, "rotor: blade profile power in hover", **WATTS)
    lifting: float = setting(0.0, "rotor: induced power in hover", **WATTS)
    tip: float = setting(100.0, "rotor: speed of the blade tips", "[1, 1e3]", unit="m/s")
    wake: float = setting(4.0, "rotor: induced velocity in hover", "[1e-2, 1e3]", unit="m/s")
    points: list[Any] = setting([], "table: pairs [airspeed, power], increasing airspeeds, linear between",
                                unit="m/s, W")  # fmt: skip
    capacity: float | None = setting(
        None, "energy available for one mission; paths that need more are not chosen. null: not known",
        "(0, 1e9]", unit="Wh",
    )  # fmt: skip

    def check_combinations(self) -> None:
        """Refuse a table that is not two or more points in order, and a capacity without a power curve."""
        if self.kind == "table" and not (
            len(self.points) > 1
            and are_pairs(self.points)
            and all(v >= 0 and watts >= 0 for v, watts in self.points)
            and all(low[0] < high[0] for low, high in zip(self.points, self.points[1:], strict=False))
        ):
            raise ConfigError(
                "robot.power.points must be two or more pairs [airspeed, power], none negative, airspeeds "
                f"rising, e.g. [[10,80],[20,150]], got {shown_value(self.points)}"
            )
        if self.kind == "none" and self.capacity is not None:
            raise ConfigError(
                "robot.power.capacity needs a power curve: set robot.power.kind to one of "
                f"{', '.join(POWER_KINDS[1:])}, or capacity to null"
            )


@dataclass
class RobotConfig(CheckedSettings, section="robot"):
    """The robot: x' = A x + dt B u + dt w, u_min ≤ ‖u‖ ≤ u_max."""

    dt: Any = setting(
        "auto",
        "time step; auto: short compared with the regions and passages of the map, and long enough that "
        "planner.max_steps suffices (world/time_step.py)",
        "[1e-3, 1e6]",
        unit="s",
        words=("auto",),
    )
    u_max: float = setting(30.0, "largest airspeed", "[1e-3, 1e4]", unit="m/s")
    u_min: float = setting(
        0.0,
        "smallest airspeed, at most u_max",
        "[0, 1e4]",
        unit="m/s",
        remark="0: the robot can hover, or stop its motor and drift",
    )
    bank: float = setting(
        0.0,
        "bank angle in turns: exported headings and airspeeds account for the time and displacement of "
        "a turn",
        "[0, 80]",
        unit="deg",
        remark="0: the heading changes at once",
    )
    turn_delay: float = setting(
        0.0, "time from a command to turn until half of the bank angle is reached", "[0, 600]", unit="s"
    )
    wind_limit: float | None = setting(
        None,
        "largest wind in which the robot may fly; pareto-ltl check compares the wind along the plan with it",
        "(0, 200]",
        unit="m/s",
        remark="null: no limit",
    )
    level: str | None = setting(
        None,
        "height of the flight: above ground (100m), above mean sea level (300m amsl), a pressure (925hPa) or "
        "a depth (30m depth); with wind.level=auto the wind is read there",
    )
    air_temperature: float | None = setting(
        None,
        "temperature of the air at the height of the flight, for the calibrated airspeed",
        "[-100, 60]",
        unit="degC",
        remark="null: of the wind file where it has one, else of the standard atmosphere",
    )
    a: list[Any] = setting([[1.0, 0.0], [0.0, 1.0]], "matrix A of the dynamics (2 x 2)")
    b: list[Any] = setting([[1.0, 0.0], [0.0, 1.0]], "matrix B of the dynamics (2 x 2, invertible)")
    start_sd: float = setting(0.0, "standard deviation of the start position", "[0, 1e6]", unit="m")
    feedback_time: float | None = setting(
        None,
        "time constant with which a robot that always knows its position returns to the plan",
        "(0, 1e7]",
        unit="s",
        remark="null: open loop",
    )
    airspeed_sd: float | None = setting(
        None,
        "standard deviation of the airspeed's error, relative to the airspeed, one for the whole flight",
        "(0, 0.5]",
        remark="0.015: 1.5 %; null: not modelled, where 0 would claim a perfect sensor",
    )
    heading_sd: float | None = setting(
        None,
        "standard deviation of the heading's error, one for the whole flight",
        "(0, 30]",
        unit="deg",
        remark="null: not modelled, where 0 would claim a perfect sensor",
    )
    clock_sd: float | None = setting(
        None,
        "standard deviation of the clock's error, by which legs begin late, one for the whole flight",
        "(0, 3600]",
        unit="s",
        remark="null: not modelled, where 0 would claim a perfect sensor",
    )
    airspeed_bias: float = setting(
        0.0,
        "expected error of the airspeed, relative: what is flown beyond what the instrument shows",
        "[-0.5, 0.5]",
        remark="known from a calibration or a fix; headings and airspeeds of plans correct it",
    )
    heading_bias: float = setting(
        0.0,
        "expected error of the heading, clockwise: what is flown beyond what the compass shows",
        "[-90, 90]",
        unit="deg",
    )
    clock_bias: float = setting(
        0.0, "expected error of the clock, by which legs begin late", "[-3600, 3600]", unit="s"
    )
    error_correlation: list[float] = setting(
        [0.0, 0.0, 0.0],
        "correlations of the errors of airspeed and heading, airspeed and clock, heading and clock",
        "(-1, 1)",
    )
    start_error_covariance: list[Any] = setting(
        [[0.0, 0.0], [0.0, 0.0], [0.0, 0.0]],
        "covariances of the start (x, y) [m] with the errors of airspeed, heading [deg] and clock [s]",
        remark="after a fix; start_sd is then of what they do not explain",
    )
    effort_risk: float = setting(
        0.05,
        "probability, in one step, that feedback commands an airspeed above u_max or below u_min, with "
        "fidelity.judge=bound; with flights, which are limited to these, nothing is reserved",
        "(0, 1)",
    )
    fix_sd: float = setting(100.0, "standard deviation of a position fix at a landmark", "(0, 1e6]", unit="m")
    fix_time: float = setting(
        300.0,
        "time constant with which the robot corrects a deviation that it knows from fixes",
        "(0, 1e7]",
        unit="s",
    )
    power: PowerConfig = field(default_factory=PowerConfig)

    def check_combinations(self) -> None:
        """Refuse u_min above u_max, a power curve that does not cover them, and a singular matrix B."""
        if not isinstance(self.dt, str):
            self.dt = float(self.dt)
        if self.u_min > self.u_max:
            raise ConfigError(
                f"robot.u_min = {self.u_min:g} m/s is above robot.u_max = {self.u_max:g} m/s: "
                "lower the first or raise the second"
            )
        self._check_power()
        self._check_errors()
        check_matrix("robot.a", self.a)
        check_matrix("robot.b", self.b)
        self._check_turns()
        (p, q), (r, s) = self.b
        if abs(p * s - q * r) < 1e-9:
            raise wrong_value("robot.b", "be invertible", self.b)

    def _check_errors(self) -> None:
        """Refuse expected errors without a standard deviation, and correlations that no errors have."""
        for name in ("airspeed", "heading", "clock"):
            if getattr(self, f"{name}_bias") and getattr(self, f"{name}_sd") is None:
                raise ConfigError(
                    f"robot.{name}_bias needs robot.{name}_sd, the standard deviation of what is left of the "
                    "error: set it, or leave out the bias"
                )
        pairs = "be three correlations: of airspeed and heading, airspeed and clock, heading and clock"
        if len(self.error_correlation) != 3:
            raise wrong_value("robot.error_correlation", pairs, self.error_correlation)
        if not are_pairs(self.start_error_covariance) or len(self.start_error_covariance) != 3:
            raise wrong_value(
                "robot.start_error_covariance", "be three pairs of numbers", self.start_error_covariance
            )
        r, s, t = self.error_correlation
        if 1.0 + 2.0 * r * s * t - r * r - s * s - t * t <= 0.0:
            wanted = "be the correlations of a covariance matrix"
            raise wrong_value("robot.error_correlation", wanted, self.error_correlation)

    def _check_turns(self) -> None:
        """Refuse a bank angle unless u_min > 0 and A and B are the identity, so that u is the airspeed."""
        if self.bank == 0.0:
            return
        if self.u_min == 0.0:
            raise ConfigError(
                "robot.bank needs robot.u_min > 0, as what stands still in the air does not bank: set it "
                "above the stall speed, or robot.bank=0"
            )
        identity = [[1.0, 0.0], [0.0, 1.0]]
        if self.a != identity or self.b != identity:
            raise ConfigError(
                "robot.bank needs robot.a and robot.b to be the identity, since u is then an airspeed: leave "
                "them out, or set robot.bank=0"
            )

    def _check_power(self) -> None:
        """Refuse a power curve that is not defined from u_min to u_max."""
        power = self.power
        if power.kind == "wing" and self.u_min == 0.0:
            raise ConfigError(
                "robot.power.kind=wing needs robot.u_min > 0, as a wing that stands still does not carry: "
                "set it above the stall speed"
            )
        if (
            power.kind == "table"
            and not power.points[0][0] <= self.u_min <= self.u_max <= power.points[-1][0]
        ):
            raise ConfigError(
                f"robot.power.points reach from {power.points[0][0]:g} to {power.points[-1][0]:g} m/s, and "
                f"the robot flies from robot.u_min = {self.u_min:g} to robot.u_max = {self.u_max:g} m/s: add "
                "points"
            )
