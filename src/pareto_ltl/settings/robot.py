"""Settings of the robot."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from pareto_ltl.settings.checks import CheckedSettings, check_matrix, setting
from pareto_ltl.support.errors import ConfigError
from pareto_ltl.support.messages import shown_value


@dataclass
class RobotConfig(CheckedSettings):
    """The robot: x' = A x + dt B u + dt w, u_min ≤ ‖u‖ ≤ u_max."""

    section: ClassVar[str] = "robot"
    dt: Any = setting(
        "auto",
        "time step; auto: one that is short for the regions and passages of the map, and long enough for "
        "planner.max_steps (world/time_step.py)",
        unit="s",
        least=1e-3,
        most=1e6,
        words=("auto",),
    )
    u_max: float = setting(30.0, "largest airspeed", unit="m/s", least=1e-3, most=1e4)
    u_min: float = setting(
        0.0,
        "least airspeed, at most u_max",
        unit="m/s",
        least=0,
        most=1e4,
        remark="0: the robot can hover, or stop its motor and drift",
    )
    a: list[Any] = setting([[1.0, 0.0], [0.0, 1.0]], "matrix A of the dynamics (2 x 2)")
    b: list[Any] = setting([[1.0, 0.0], [0.0, 1.0]], "matrix B of the dynamics (2 x 2, invertible)")
    start_sd: float = setting(0.0, "standard deviation of the start position", unit="m", least=0, most=1e6)
    feedback: float = setting(
        0.0,
        "gain K: share of a deviation that position feedback takes back in one step",
        least=0,
        most=1,
        remark="0: open loop, 1: back on the path in one step",
    )
    effort_risk: float = setting(
        0.05,
        "probability that the feedback of a step asks for more than u_max, or less than u_min",
        above=0,
        below=1,
    )
    fix_sd: float = setting(
        100.0, "standard deviation of a position fix at a landmark", unit="m", above=0, most=1e6
    )
    fix_gain: float = setting(
        0.25, "share of a deviation known from a fix that is flown back in one step", least=0, most=1
    )
    fix_risk: float = setting(
        0.02, "largest probability of missing a landmark that a plan relies on", above=0, below=1
    )

    def check_combinations(self) -> None:
        if not isinstance(self.dt, str):
            self.dt = float(self.dt)
        if self.u_min > self.u_max:
            raise ConfigError(
                f"robot.u_min = {self.u_min:g} m/s is above robot.u_max = {self.u_max:g} m/s: "
                "lower the first or raise the second"
            )
        check_matrix("robot.a", self.a)
        check_matrix("robot.b", self.b)
        (p, q), (r, s) = self.b
        if abs(p * s - q * r) < 1e-9:
            raise ConfigError(f"robot.b must be invertible, got {shown_value(self.b)}")
