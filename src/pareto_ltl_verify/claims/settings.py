"""Claims about settings that stand in no other file: what the records show of them.

The other settings of a plan are compared where the values that follow from them are derived; those that guide
the search, or that other commands read, leave nothing in the files (docs/verify.md).
"""

from __future__ import annotations

import fnmatch
import math
import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from pareto_ltl_verify.arrays import FloatArray
from pareto_ltl_verify.claims import Claim, Verdict, no_fault
from pareto_ltl_verify.evidence import Evidence

FEWEST_CELLS, MAX_CELLS = 20, 500  # of the lattice of the wind along the longer side of the map
FEWEST_MODE_CELLS, MAX_MODE_CELLS = 10, 24  # of the lattice of its modes
# Laws that are no files.
LAW_WORDS = "auto", "none", "gfs", "icon_eu", "ecmwf_class", "hourly_fine", "currents", "gfs_one_part"
SAME_PLACE = 1e-6  # of the spacing of a lattice
SLOW = 60.0  # [s] that a search takes beyond a limit of its time: the tree that is growing is finished


def named_files(result: Evidence) -> Verdict:
    """Files that the settings name are among the inputs of the run."""
    inputs = [_whole(result, name) for name in result.run["inputs"]]
    settings = result.settings
    named = {
        "scene.file": settings["scene"]["file"],
        "mission.automaton": settings["mission"]["automaton"],
        "selection.extra_paths": settings["selection"].get("extra_paths"),
        "wind.forecast_error": settings["wind"]["forecast_error"],
        "wind.path": settings["wind"]["path"] if result.source_row.reads_path else None,
    }
    missing = (
        f"{key}={text} is no input of the run"
        for key, text in named.items()
        if text and str(text) not in LAW_WORDS and not _is_among(_whole(result, str(text)), inputs)
    )
    return no_fault(f"{len(inputs)} inputs", missing if inputs else ())


def _whole(result: Evidence, name: str) -> str:
    """A path of the run from the root of the file system; it was relative to the folder of the run."""
    return os.path.normpath(Path(result.run.get("folder") or "/", Path(name).expanduser()))


def _is_among(path: str, inputs: list[str]) -> bool:
    """Whether ``path`` is one of the inputs, a folder with some of them, or a pattern of their names."""
    return any(
        one == path or one.startswith(f"{path}{os.sep}") or fnmatch.fnmatch(one, path) for one in inputs
    )


def lattices(result: Evidence) -> Verdict | None:
    """Both lattices, for the wind and for the modes, follow from wind.padding, spacing and modes_spacing."""
    wind, settings = result.wind, result.settings["wind"]
    if wind.fit is None:
        return None
    low, high = np.array(result.scene["bounds"], float)
    side = float((high - low).max())
    padding = min(float(settings["padding"]), side)
    step = max(min(float(settings["spacing"]), side / FEWEST_CELLS), (side + 2.0 * padding) / MAX_CELLS)
    nodes = {"wind": (wind.x, wind.y, step, np.maximum(1, _cells(high - low + 2.0 * padding, step)))}
    if wind.modes is not None:
        coarse = min(max(float(settings["modes_spacing"]), side / MAX_MODE_CELLS), side / FEWEST_MODE_CELLS)
        nodes["modes"] = (wind.modes.x, wind.modes.y, coarse, _cells(high - low, coarse) + 2)
    middle = 0.5 * (low + high)
    faults = (
        f"the lattice of the {name} along {'xy'[axis]}"
        for name, (x, y, spacing, cells) in nodes.items()
        for axis, stated in enumerate((x, y))
        if not _is_lattice(stated, middle[axis], spacing, int(cells[axis]))
    )
    return no_fault(" and ".join(nodes), faults)


def _cells(extent: FloatArray, spacing: float) -> FloatArray:
    return np.asarray(np.ceil(extent / spacing - 1e-9), float)


def _is_lattice(stated: FloatArray, middle: float, spacing: float, cells: int) -> bool:
    wanted = middle + spacing * (np.arange(cells + 1) - 0.5 * cells)
    return stated.shape == wanted.shape and bool(np.abs(stated - wanted).max() <= SAME_PLACE * spacing)


def limits(result: Evidence) -> Verdict:
    """The records keep the limits of the settings: readings, states of the automaton, steps, time."""
    return no_fault("limits of the settings", _broken_limits(result))


def _broken_limits(result: Evidence) -> Iterator[str]:
    settings, run = result.settings, result.run
    if result.has("automaton.json") and len(result.automaton["delta"]) > settings["logic"]["max_states"]:
        yield f"logic.max_states={settings['logic']['max_states']}"
    if result.has("wind.nc") and (fit := result.wind.fit) is not None:
        most, fastest = settings["wind"]["max_points"], settings["wind"]["max_speed"]
        if max(map(len, fit.points)) > most:
            yield f"wind.max_points={most}"
        if max(float(np.hypot(*winds.T).max(initial=0.0)) for winds in fit.winds) > fastest * (1 + 1e-9):
            yield f"wind.max_speed={fastest:g}"
    spent = run["seconds"].get("forest", 0.0)
    if spent > (settings["planner"]["max_seconds"] or math.inf) + SLOW:
        yield f"planner.max_seconds={settings['planner']['max_seconds']:g}"


CLAIMS = (
    Claim("settings: files that they name", (), named_files),
    Claim("settings: lattices of the wind", ("wind.nc", "scene.json"), lattices),
    Claim("settings: limits", (), limits),
)
