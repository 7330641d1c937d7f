"""``pareto_ltl.beacons``: where a beacon would reduce the failure of a plan most; table and figure."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from careful_io.files import write_csv, write_text
from careful_io.texts import distance_text, probability_text
from pareto_ltl import Run, Scene
from pareto_ltl.extend import Planned, planned_run
from pareto_ltl.support.errors import ConfigError
from pareto_ltl_apps.flight.beacon_map import BeaconMap
from pareto_ltl_apps.view.settings import ReportConfig

STREAM = "beacons"
RADIUS = 0.02  # of the map's size: default radius
MOST = 3  # beacons that are placed


def beacons(
    planned: Planned, *, radius: float | None = None, number: int = 1,
    flights: int = 2000,
) -> BeaconMap:  # fmt: skip
    """The places where a beacon would reduce the failure of a plan most.

    Parameters
    ----------
    planned : Run or path
        What :func:`pareto_ltl.plan` returned, or a results directory.
    radius : float, optional
        Distance within which the robot measures its position, with ``robot.fix_sd`` [m]; default 2 % of the
        size of the map.
    number : int
        Beacons that are placed, one after the other, at most 3.
    flights : int
        Common flights that compare the places; 20,000 fresh ones judge the best.

    Raises
    ------
    ConfigError
        If a value cannot be used, or the robot takes no position fixes.
    """
    run = planned_run(planned)
    problem = run.problem
    size = float(np.ptp(problem.scene.bounds, axis=0).min())
    wide = RADIUS * size if radius is None else float(radius)
    if not 0.0 < wide < 0.25 * size:
        raise ConfigError(
            f"beacons: radius must be above 0 and below a quarter of the map, {0.25 * size:g} m, got {wide:g}"
        )
    if not 1 <= number <= MOST:
        raise ConfigError(f"beacons: number must be 1 to {MOST}, got {number}")
    if flights < 100:
        raise ConfigError(f"beacons: flights must be at least 100, got {flights}")
    seed = run.seeds(STREAM)
    return BeaconMap.of(problem, run.settings.robot, run.plan.path, wide, number, flights, seed)


def beacon_lines(run: Run, found: BeaconMap) -> list[str]:
    """The summary for the user: the plan of ``run`` as it is, and with one to three beacons."""
    scene, plan = run.scene, run.plan
    now = found.without
    lines = [
        f"without a further beacon {now.failures:,} of {now.runs:,} flights in {now.law} winds fail, "
        f"{probability_text(now.failure)}"
    ]
    for count, site in enumerate(found.sites, 1):
        gap, low, high = (100.0 * value for value in site.saved)
        hours = found.places.step[site.number] * plan.dt / 3600.0
        lines += [
            f"beacon {count} of {distance_text(found.radius)} at "
            f"{place_text(scene, found, site.number)}, "
            f"which the plan passes {hours:.3g} h after departure"
            f"{_beside(found.places.aside[site.number])}:",
            f"  {probability_text(site.rate.failure)} fail, {gap:+.2g} points [{low:+.2g}, {high:+.2g}]",
        ]
    return lines


def beacon_document(run: Run, found: BeaconMap) -> dict[str, Any]:
    """The same as :func:`beacon_lines` for programs: rates without and with each further beacon."""
    scene, places = run.scene, found.places
    sites = [
        {
            "place": place_text(scene, found, site.number),
            "x_m": places.at[site.number, 0],
            "y_m": places.at[site.number, 1],
            "step": places.step[site.number],
            "aside_m": places.aside[site.number],
            "failure": site.rate.failure,
            "saved": site.saved,
        }
        for site in found.sites
    ]
    rate = found.without
    return {
        "law": rate.law,
        "runs": rate.runs,
        "failure": rate.failure,
        "radius_m": found.radius,
        "beacons": sites,
    }


def _beside(aside: float) -> str:
    if aside == 0.0:
        return ""
    return f", {distance_text(abs(aside))} to the {'left' if aside > 0.0 else 'right'} of it"


def place_text(scene: Scene, found: BeaconMap, number: int) -> str:
    """A place as latitude and longitude, or on a map without a place on Earth in metres."""
    x, y = found.places.at[number]
    if scene.crs is None:
        return f"x {x:,.0f} m, y {y:,.0f} m"
    lon, lat = scene.frame.to_geographic(found.places.at[number])
    return f"{lat[0]:.4f}, {lon[0]:.4f}"


def write_beacons(run: Run, found: BeaconMap, folder: Path) -> None:
    """Write ``beacons.csv``, ``beacons.png`` and, with the summary, ``beacons.txt`` into ``folder``."""
    from pareto_ltl_apps.view.axes import save_figures
    from pareto_ltl_apps.view.plan_maps import beacons_figure

    folder.mkdir(parents=True, exist_ok=True)
    places, law = found.places, found.without.law
    header = ["x_m", "y_m", "step", "aside_m", "failure", "law", "runs"]
    rows = zip(
        *places.at.T.tolist(),
        places.step.tolist(),
        places.aside.tolist(),
        found.failure.tolist(),
        strict=True,
    )
    write_csv(folder / "beacons.csv", header, ((*row, law, found.flights) for row in rows))
    write_text(folder / "beacons.txt", "\n".join(beacon_lines(run, found)) + "\n")
    draw = partial(beacons_figure, run.scene, run.plan, found, run.settings.medium)
    save_figures(folder, run.settings[ReportConfig], {"beacons": draw})
