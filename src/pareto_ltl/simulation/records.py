"""The record of simulated flights that stages exchange, and its file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pareto_ltl.planning.rates import FailureRate, counted_rate
from pareto_ltl.support.archives import stored
from pareto_ltl.support.arrays import BoolArray, FloatArray
from pareto_ltl.support.display import Displayed
from pareto_ltl.support.files import write_npz

FLIGHT_ARRAYS = ("x", "accepted", "collided", "off_map", "walled")


@dataclass(frozen=True, slots=True, repr=False)
class Deployment(Displayed):
    """Simulated flights of one plan under one wind law.

    Attributes
    ----------
    x : (n, T+1, 2) float
        Positions [m].
    accepted : (n,) bool
        Flights that complete the mission.
    collided, off_map : (n,) bool
        Flights that met an obstacle, and that left the map.
    walled : bool
        Whether leaving the map is a failure (``scene.border=wall``).
    """

    law: str
    x: FloatArray
    accepted: BoolArray
    collided: BoolArray
    off_map: BoolArray
    walled: bool = False

    @property
    def failed(self) -> BoolArray:
        """Flights that miss the mission, meet an obstacle or, where the border is a wall, leave the map."""
        failed: BoolArray = ~self.accepted | self.collided
        return failed | self.off_map if self.walled else failed

    @property
    def rate(self) -> FailureRate:
        """Share of the flights that fail, with its interval."""
        return counted_rate(self.law, int(self.failed.sum()), len(self.x))

    def facts(self) -> Mapping[str, str]:
        """Number of flights, failure rate with its interval, and why flights fail."""
        gone = int(self.off_map.sum())
        return {
            "flights": f"{len(self.x):,}",
            "fail": str(self.rate),
            "miss the mission": f"{int((~self.accepted).sum()):,}",
            "meet an obstacle": f"{int(self.collided.sum()):,}",
            "leave the map": f"{gone:,}" + ("" if self.walled or not gone else ", which is no failure"),
        }


def write_deployments(directory: Path, deployments: Mapping[str, Deployment]) -> None:
    """Write ``deployments.npz``: the flights under each wind law."""
    flights = deployments.items()
    arrays = {f"{law}/{n}": np.asarray(getattr(flown, n)) for law, flown in flights for n in FLIGHT_ARRAYS}
    write_npz(directory / "deployments.npz", arrays)


def read_deployments(place: Path | str) -> dict[str, Deployment]:
    """The flights of ``deployments.npz`` by wind law; ``place`` is the file or the directory that has it."""
    with stored(place, "deployments.npz", "deployments") as arrays:
        laws = sorted({name.partition("/")[0] for name in arrays})
        flights = {law: [arrays[f"{law}/{name}"] for name in FLIGHT_ARRAYS] for law in laws}
        return {law: Deployment(law, f[0], f[1], f[2], f[3], bool(f[4].all())) for law, f in flights.items()}
