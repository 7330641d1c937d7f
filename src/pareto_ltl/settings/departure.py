"""Settings of pipelines=departure: which starts are planned and compared."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from pareto_ltl.settings.checks import CheckedSettings, check_time, setting
from pareto_ltl.support.errors import ConfigError
from pareto_ltl.support.messages import shown_value

KEEP = ("all", "recommended")


@dataclass
class DepartureConfig(CheckedSettings):
    """Starts that pipelines=departure plans and compares (docs/departure.md)."""

    section: ClassVar[str] = "departure"
    starts: list[Any] = setting([], "departure times, ISO 8601 UTC; empty: set by first, last and every")
    first: str | None = setting(None, "earliest start; null: mission.start_time, else the first wind time")
    last: str | None = setting(None, "latest start; null: the last wind time")
    every: float | None = setting(
        None, "time between two starts; null: every wind time", unit="h", above=0, most=1e5
    )
    arrive_by: str | None = setting(
        None, "latest arrival; if set, the latest starts that arrive by this time are planned"
    )
    most: int = setting(
        8, "with arrive_by: number of starts to find that arrive in time", least=1, most=10_000
    )
    flights: int = setting(
        10_000,
        "fresh flights of each path of the front of each start, used to compare the starts",
        least=100,
        most=1e8,
    )
    seeds: int = setting(
        3,
        "seeds with which a start is planned if it may be the best; 1: the spread between seeds is not known",
        least=1,
        most=10,
    )
    quick: bool = setting(
        True,
        "whether starts are compared with a coarser refinement; the recommended start is then planned "
        "in full",
    )
    keep: str = setting("all", "starts whose results directories are written to starts/", choices=KEEP)

    def check_combinations(self) -> None:
        """Refuse values that are not times, and starts that are given both as a list and as a range."""
        for key in ("first", "last", "arrive_by"):
            check_time(f"departure.{key}", getattr(self, key))
        for time in self.starts:
            if not isinstance(time, str):
                raise ConfigError(
                    f"departure.starts must be a list of ISO 8601 times, got {shown_value(time)} in it"
                )
            check_time("departure.starts", time)
        if self.starts and (self.first or self.last or self.every):
            raise ConfigError(
                "departure.starts lists the starts itself: leave out departure.first, last and every"
            )
