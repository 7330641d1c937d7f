"""Which formats can be written for a plan, and how its files are written."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from careful_io.files import write_bytes
from pareto_ltl import Scene
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import DataError
from pareto_ltl_apps.exports.branches import branch_cards
from pareto_ltl_apps.exports.exported import ExportedPlan
from pareto_ltl_apps.exports.kinds import ExportFormat, format_named
from pareto_ltl_apps.exports.tables import card_of, table_of

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
    causes: dict[str, Callable[[ExportFormat], bool]] = {}
    if scene.frame.utc(t) is None:
        causes["the plan has no times in UTC; set mission.start_time"] = lambda one: one.timed
    if holds_pole(scene):
        causes["the map holds a pole, around which areas cannot be drawn in degrees"] = lambda one: one.areas
    left, reasons = list(formats), []
    for cause, barred in causes.items():
        if names := [name for name in left if barred(format_named(name))]:
            reasons.append(f"{', '.join(names)}: not written, since {cause}")
            left = [name for name in left if name not in names]
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
    kinds = tuple(map(format_named, formats))
    paths = tuple(folder / kind.file for kind in kinds)
    for kind, path in zip(kinds, paths, strict=True):
        write_bytes(path, kind.content(exported))
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
