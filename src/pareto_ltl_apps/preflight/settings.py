"""Settings of the check before a flight."""

from __future__ import annotations

from dataclasses import dataclass

from pareto_ltl.extend import CheckedSettings, setting


@dataclass
class LimitsConfig(CheckedSettings, section="limits"):
    """Limits of your own for GO or NO-GO of pareto-ltl check (docs/check.md); null: not limited."""

    failure: float | None = setting(None, "largest failure rate", "(0, 1)")
    containment: float | None = setting(
        None, "largest probability per flight hour of leaving the border, or the given volume", "(0, 1)"
    )
    energy: float | None = setting(None, "largest share of robot.power.capacity that is used", "(0, 1]")
    takeoff_wind: float | None = setting(
        None, "largest wind at the start and the time of departure", "(0, 200]", unit="m/s"
    )
