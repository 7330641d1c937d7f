"""The table of formats, and how the files of a plan are written."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from pareto_ltl import Scene
from pareto_ltl.settings.outputs import EXPORT_FILES
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import DataError
from pareto_ltl.support.files import write_bytes
from pareto_ltl_apps.exports.branches import branch_cards
from pareto_ltl_apps.exports.exported import ExportedPlan
from pareto_ltl_apps.exports.geojson import corridor_geojson, operational_intent, plan_geojson
from pareto_ltl_apps.exports.mavlink import mavlink_script, plan_lua
from pareto_ltl_apps.exports.qgc import mission_plan
from pareto_ltl_apps.exports.tables import (
    card_of,
    dead_reckoning_csv,
    flight_card,
    table_of,
    trajectory_netcdf,
)
from pareto_ltl_apps.exports.xml_files import plan_fpl, plan_gpx, plan_kml

MAKERS: dict[str, Callable[[ExportedPlan], bytes]] = {
    "dead_reckoning": dead_reckoning_csv,
    "card": flight_card,
    "geojson": plan_geojson,
    "kml": plan_kml,
    "gpx": plan_gpx,
    "fpl": plan_fpl,
    "qgc": mission_plan,
    "mavlink": mavlink_script,
    "lua": plan_lua,
    "corridor": corridor_geojson,
    "netcdf": trajectory_netcdf,
    "f3548": operational_intent,
}
TIMED = ("netcdf", "f3548")  # formats that need times in UTC
OUTLINED = ("geojson", "kml", "corridor")  # formats with areas in degrees, which cannot contain a pole
POLE_MARGIN = 0.2  # of the size of the map: corridors may reach beyond it


def writable_formats(formats: Sequence[str], scene: Scene, t: FloatArray) -> tuple[tuple[str, ...], str]:
    """The ``formats`` that can be written for a plan with times ``t`` (T+1,) [s]; why not the others.

    The reason is empty if all of them can be written.
    """
    if scene.crs is None:
        return (), (
            f"{', '.join(formats)}: not written, since the map has no place on Earth; give scene.centre, or "
            "draw the map as GeoJSON"
        )
    causes: dict[str, tuple[str, ...]] = {}
    if scene.frame.utc(t) is None:
        causes["the plan has no times in UTC; set mission.start_time"] = TIMED
    if holds_pole(scene):
        causes["the map holds a pole, around which areas cannot be drawn in degrees"] = OUTLINED
    left, reasons = list(formats), []
    for cause, barred in causes.items():
        if names := [name for name in left if name in barred]:
            reasons.append(f"{', '.join(names)}: not written, since {cause}")
            left = [name for name in left if name not in barred]
    return tuple(left), "; ".join(reasons)


def holds_pole(scene: Scene) -> bool:
    """Whether a pole lies on the map or close to it."""
    assert scene.crs is not None
    margin = POLE_MARGIN * float((scene.bounds[1] - scene.bounds[0]).max())
    for latitude in (-90.0, 90.0):
        try:
            pole = scene.frame.to_plane(np.zeros(1), np.array([latitude]))[0]
        except DataError:  # opposite to the centre of the plane
            continue
        if ((pole > scene.bounds[0] - margin) & (pole < scene.bounds[1] + margin)).all():
            return True
    return False


def write_exports(exported: ExportedPlan, formats: Sequence[str], folder: Path) -> tuple[Path, ...]:
    """Write the files into ``folder``, which is made where it is missing; return their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = tuple(folder / EXPORT_FILES[name] for name in formats)
    for name, path in zip(formats, paths, strict=True):
        write_bytes(path, MAKERS[name](exported))
    return (*paths, *write_branches(exported, formats, folder))


def write_branches(exported: ExportedPlan, formats: Sequence[str], folder: Path) -> tuple[Path, ...]:
    """Write the tables and cards of the branches of a plan, with the tables and cards of the plan."""
    found = dict[str, bytes]()
    for one in exported.branches:
        if "dead_reckoning" in formats:
            found[f"branch_{one.name}.csv"] = table_of(one.log, one.first)
        if "card" in formats:
            found[f"branch_{one.name}_card.csv"] = card_of(one.log, one.first)
    if exported.branches and "card" in formats:
        plan, frame = exported.plan, exported.scene.frame
        found["branch_cards.html"] = branch_cards(exported.name, plan, frame, exported.branches)
    for name, content in found.items():
        write_bytes(folder / name, content)
    return tuple(folder / name for name in found)
