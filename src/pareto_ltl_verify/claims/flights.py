"""Claims about the simulated flights: they are judged a second time, and new flights are simulated."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from pareto_ltl.support.arrays import BoolArray
from pareto_ltl_verify.claims.verdict import Claim, Verdict, close, likely, no_fault, same, within
from pareto_ltl_verify.evidence import LAWS, Evidence
from pareto_ltl_verify.flights import (
    RARE,
    Verdicts,
    failures,
    misjudged,
    rates,
    same_distribution,
    same_rate,
    winds_as_drawn,
)
from pareto_ltl_verify.laws import Independent

LOOKS = 4  # steps at which positions of old and new flights are compared
METRICS = {
    "runs": "runs_{}", "failure": "failure_{}", "low": "failure_{}_low", "high": "failure_{}_high",
    "mission": "mission_failure_{}", "collision": "collision_{}",
    "off_map": "off_map_{}",
}  # fmt: skip


def flown(law: str, judge: Callable[[Evidence, str], Verdict | None], result: Evidence) -> Verdict | None:
    """Verdict of ``judge`` on the flights under a wind law; None if there are none."""
    return judge(result, law) if f"{law}/x" in result.flights else None


def flown_laws(result: Evidence) -> Verdict:
    """There are deployment.runs flights under every law of deployment.laws, each as long as the plan."""
    settings = result.settings["deployment"]
    shape = (settings["runs"], len(result.u) + 1, 2)
    faults = [f"no flights under {law}" for law in settings["laws"] if f"{law}/x" not in result.flights]
    shapes = {name: array.shape for name, array in result.flights.items()}
    faults += [f"{name} {shapes[name]}" for name in shapes if name.endswith("/x") and shapes[name] != shape]
    faults += [
        f"{name} {shapes[name]}"
        for name in shapes
        if not name.endswith("/x") and shapes[name] != ((1,) if name.endswith("/walled") else shape[:1])
    ]
    faults += [
        name
        for name in shapes
        if name.endswith("/walled") and bool(result.flights[name].all()) != result.ground.walled
    ]
    faults += [name for name in shapes if name.partition("/")[0] not in settings["laws"]]
    return no_fault(f"{settings['runs']} flights, {', '.join(settings['laws'])}", faults)


def _flags(result: Evidence, law: str) -> tuple[BoolArray, BoolArray, BoolArray]:
    """Which flights the results call accepted, collided and off the map."""
    accepted, collided, off_map = (
        result.flights[f"{law}/{name}"] for name in ("accepted", "collided", "off_map")
    )
    return accepted, collided, off_map


def counts(result: Evidence, law: str) -> Verdict:
    """The rates and the interval in the metrics follow from the flights."""
    computed = rates(*_flags(result, law), result.ground.walled)
    stated = {key: float(result.metrics[name.format(law)]) for key, name in METRICS.items()}
    faults = [
        f"{key} {stated[key]} is {computed[key]:.6g}"
        for key in computed
        if not close(stated[key], computed[key], 1e-9, 1e-12)
    ]
    return no_fault(f"{computed['failure']:.4g} of {computed['runs']:.0f} fail", faults)


def judged_again(result: Evidence, law: str) -> Verdict:
    """Every flight's verdict follows from its positions: labels, obstacles on segments, the border."""
    stated = Verdicts(result.flights[f"{law}/x"], *_flags(result, law))
    wrong = misjudged(result.ground, stated, 1e-3 * result.grain)
    return Verdict(f"{len(stated.x)} flights", f"{wrong} judged otherwise", wrong == 0)


def starts(result: Evidence, law: str) -> Verdict:
    """Flights begin about the start of the map."""
    gap = np.abs(result.flights[f"{law}/x"][:, 0] - result.start).max()
    return within("the start", float(gap), 8 * result.robot.start_sd + result.grain, " m")


def drawn_winds(result: Evidence, law: str) -> Verdict | None:
    """Under the independent law, the winds of open-loop flights are N(μ, Σ_w) at the robots' positions."""
    model, robot = result.law(law), result.robot
    guided = robot.feedback > 0 or result.simulator(law).guide is not None
    if guided or not isinstance(model, Independent):
        return None
    return likely("drawn from wind.nc", winds_as_drawn(model, result.flights[f"{law}/x"], result.u), RARE)


def new_positions(result: Evidence, law: str) -> Verdict:
    """Positions are distributed like the positions of new flights."""
    old, new = result.flights[f"{law}/x"], result.new_flights[law]
    steps = np.unique(np.linspace(1, old.shape[1] - 1, LOOKS).astype(int))
    return likely(
        f"{len(old)} flights", same_distribution(old[:, steps], new[:, steps], 2e-3 * result.grain), RARE
    )


def new_rate(result: Evidence, law: str) -> Verdict:
    """The failure rate agrees with new flights with other random numbers."""
    failed = failures(*_flags(result, law), result.ground.walled)
    again = result.ground.failed(result.new_flights[law])
    chance = same_rate(int(failed.sum()), len(failed), int(again.sum()), len(again))
    return Verdict(
        f"{failed.mean():.4g}", f"{again.mean():.4g} of {len(again)}, chance {chance:.1g}", chance >= RARE
    )


def reported_laws(result: Evidence) -> Verdict:
    """The metrics have rates for the wind laws that were simulated and for no other."""
    reported = sorted(law for law in LAWS if f"failure_{law}" in result.metrics)
    return same(reported, sorted({name.partition("/")[0] for name in result.flights}))


FILES = ("deployments.npz", "plan.json", "scene.json", "cells.json", "automaton.json", "wind.nc")
CLAIMS = (
    Claim("flights: laws and numbers", FILES, flown_laws),
    Claim("flights: laws of the metrics", ("deployments.npz",), reported_laws),
    *(
        Claim(f"{law}: {name}", FILES, partial(flown, law, judge))
        for law in LAWS
        for name, judge in (
            ("rates and interval", counts),
            ("verdicts of the flights", judged_again),
            ("start of the flights", starts),
            ("winds of the flights", drawn_winds),
            ("positions of the flights", new_positions),
            ("failure rate of new flights", new_rate),
        )
    ),
)
