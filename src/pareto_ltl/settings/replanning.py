"""Settings of pipelines=replanning: flights that plan again at position fixes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from pareto_ltl.settings.checks import CheckedSettings, setting


@dataclass
class ReplanningConfig(CheckedSettings):
    """Flights of pipelines=replanning, with and without a new plan at each fix (docs/replanning.md)."""

    section: ClassVar[str] = "replanning"
    flights: int = setting(100, "number of true winds in which the plan is flown", least=1, most=1e6)
    every: float | None = setting(
        None, "time between two fixes; null: fixes at the landmarks that the plan relies on, else every 6 h",
        unit="h", above=0, most=1e4,
    )  # fmt: skip
    fix_sd: float = setting(
        500.0, "standard deviation of a fix in each direction", unit="m", above=0, most=1e6
    )
