"""Settings of plans that branch."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from pareto_ltl.extend import CheckedSettings, setting
from pareto_ltl.support.errors import ConfigError

if TYPE_CHECKING:
    from pareto_ltl import Settings


@dataclass
class BranchConfig(CheckedSettings, section="branch"):
    """A plan that branches at a position fix (docs/branching.md)."""

    leaves: int = setting(
        1,
        "largest number of branches, one table to fly for each cell of measured positions; 1: no branch",
        "[1, 4]",
    )
    at: list[float] = setting(
        [],
        "times after departure at which a position fix can be taken, of which the plan branches at the best "
        "one, or one after another with branch.fixes=2; none: at the landmarks of the map",
        "(0, 1e4]",
        unit="h",
    )
    fixes: int = setting(
        1,
        "largest number of fixes, one after another, at which the plan branches: each branch of the first "
        "one may branch again",
        "[1, 2]",
    )
    fit_trunk: bool = setting(
        True,
        "whether the plan may be another path of the front, or a bent one, if that fails less with branches",
    )
    fix_sd: float = setting(
        500.0,
        "standard deviation of a fix at a time of branch.at in each direction; at landmarks robot.fix_sd",
        "(0, 1e6]",
        unit="m",
    )
    available: float = setting(
        1.0, "probability that the fix can be taken; without it the plan goes on", "(0, 1]"
    )
    rejoin: bool = setting(
        True,
        "whether the robot also flies off its measured distance from the planned position, for some steps "
        "after the fix, and goes on against the drift that it tells of",
    )

    def complete(self, settings: Settings) -> None:
        """Refuse branches of a robot that always knows its position, and models that do not see them."""
        if self.leaves == 1:
            if self.fixes > 1:
                raise ConfigError(
                    f"branch.fixes = {self.fixes} has no effect with branch.leaves = 1: "
                    "set branch.leaves to 2, 3 or 4, or branch.fixes=1"
                )
            return
        if settings.robot.feedback_time is not None:
            raise ConfigError(
                f"branch.leaves = {self.leaves}: a robot with robot.feedback_time always knows its "
                "position and needs no branches; set robot.feedback_time=null or branch.leaves=1"
            )
        needs = {"law": "coherent", "judge": "flights", "refine": "sampled"}
        for name, value in needs.items():
            if (found := getattr(settings.fidelity, name)) != value:
                raise ConfigError(
                    f"branch.leaves = {self.leaves} needs fidelity.{name}={value}, got {found}: take "
                    "fidelity=full, or branch.leaves=1"
                )
