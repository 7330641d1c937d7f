"""Settings of pipelines=replanning: flights that plan again at position fixes and with newer forecasts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from pareto_ltl.settings.checks import CheckedSettings, setting


@dataclass
class ReplanningConfig(CheckedSettings):
    """Flights of pipelines=replanning, with and without new plans on the way (docs/replanning.md)."""

    section: ClassVar[str] = "replanning"
    flights: int = setting(100, "number of true winds in which the plan is flown", least=1, most=1e6)
    fixes: list[int] = setting(
        [1, 2, 4], "numbers of fixes, evenly spaced over the plan: a row for each", least=1, most=1000,
        distinct=True,
    )  # fmt: skip
    every: float | None = setting(
        None, "time between two fixes, for one row instead of replanning.fixes; null: the rows of "
        "replanning.fixes, and one with fixes at the landmarks that the plan relies on", unit="h",
        above=0, most=1e4,
    )  # fmt: skip
    fix_sd: float = setting(
        500.0, "standard deviation of a fix in each direction", unit="m", above=0, most=1e6
    )
    forecasts: float | None = setting(
        None, "time between two newer forecasts, for two further rows, with them alone and with the last "
        "fixes; null: no such rows", unit="h",
        above=0, most=1e4,
    )  # fmt: skip
