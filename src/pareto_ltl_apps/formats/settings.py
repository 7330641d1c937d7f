"""Settings of wind tables."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from careful_io.messages import wrong_value
from declared_settings import are_pairs
from pareto_ltl.extend import CheckedSettings, check_time, setting


def check_outline(key: str, value: Any) -> None:
    """Raise :class:`ConfigError` unless ``value`` is a list of pairs of finite numbers."""
    if not are_pairs(value):
        raise wrong_value(key, "be a list of [longitude, latitude] in degrees", value)


@dataclass
class IngestConfig(CheckedSettings, section="ingest"):
    """The table of readings that pipelines=ingest writes."""

    out: str = setting("wind_table.csv", "file that is written")
    points: int = setting(120, "readings at each time, by farthest-point sampling", "[3, 1e6]")
    area: list[Any] = setting([], "outline of the area, corners [longitude, latitude]", unit="deg")
    first: str | None = setting(None, "first time, ISO 8601 UTC; null: from the beginning")
    last: str | None = setting(None, "last time, ISO 8601 UTC; null: to the end")

    def check_combinations(self) -> None:
        """Refuse an output file that is not CSV, an invalid outline, and values that are not times."""
        if not self.out.lower().endswith(".csv"):
            raise wrong_value("ingest.out", "end in .csv (its origin goes to .json)", self.out)
        check_outline("ingest.area", self.area)
        check_time("ingest.first", self.first)
        check_time("ingest.last", self.last)
