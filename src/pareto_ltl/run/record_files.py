"""Files of map, cells, automaton, wind, trees, flights and studies: for each a writer and its reader.

A file is written completely or not at all, and the same records give the same bytes (``support.files``).
``run/stages.py`` names these functions in the row of the stage that makes the record.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pareto_ltl.planning.records import Forest, Tree
from pareto_ltl.simulation.records import Deployment
from pareto_ltl.support.archives import read_npz
from pareto_ltl.support.arrays import require_shape
from pareto_ltl.support.files import write_bytes, write_csv, write_json, write_npz
from pareto_ltl.support.reading import inside, read_json, shaped
from pareto_ltl.support.schemas import read_document
from pareto_ltl.world.cells import Decomposition

if TYPE_CHECKING:
    from pareto_ltl.logic import Automaton
    from pareto_ltl.report.records import Study
    from pareto_ltl.wind.records import WindField
    from pareto_ltl.world.scene import Scene

COLLISION_COLUMNS = "collision_columns"  # number of last columns of Tree.risk; missing if there are none
TREE_ARRAYS = ("x", "parent", "step", "q", "cell", "length", "risk", "swaps", "beta")
FLIGHT_ARRAYS = ("x", "accepted", "collided", "off_map", "walled")


@contextmanager
def stored(
    place: Path | str, name: str, what: str, schema: str | Mapping[str, str] | None = None
) -> Iterator[Any]:
    """The content of the file ``name`` in ``place``, or of the file ``place``, to be made into ``what``.

    A JSON file is checked against ``schema`` (as :func:`read_document`); without one it is an archive of
    arrays. An error in the block becomes a DataError that names the file.
    """
    path = inside(place, name)
    content = read_npz(path) if schema is None else read_document(path, schema)
    with shaped(path, what):
        yield content


# --- scene, cells, automaton, wind -----------------------------------------------------------


def write_scene(directory: Path, scene: Scene) -> None:
    """Write ``scene.json``."""
    from pareto_ltl.world.scene_files import scene_to_dict as to_dict

    write_json(directory / "scene.json", to_dict(scene))


def read_scene(place: Path | str) -> Scene:
    """The map of ``scene.json``, a file or the directory that has it."""
    from pareto_ltl.world.scene_files import scene_from_dict as from_dict
    from pareto_ltl.world.scene_shapes import refuse_crossings

    with stored(place, "scene.json", "a scene", "scene") as content:
        scene = from_dict(content)
        refuse_crossings((*scene.region_outlines, *scene.obstacles, *scene.landmarks))
        return scene


def write_cells(directory: Path, decomposition: Decomposition) -> None:
    """Write ``cells.json``."""
    write_json(directory / "cells.json", asdict(decomposition))


def read_cells(place: Path | str) -> Decomposition:
    """The cells of ``cells.json``, a file or the directory that has it."""
    with stored(place, "cells.json", "a decomposition", "cells") as content:
        return Decomposition(
            cells=_polygons(content["cells"]),
            labels=tuple(frozenset(label) for label in content["labels"]),
            doors=np.array(content["doors"], np.int64).reshape(-1, 2),
            obstacles=_polygons(content["obstacles"]),
            regions={name: _polygons(parts) for name, parts in content["regions"].items()},
        )


def _polygons(lists: list[Any]) -> tuple[NDArray[np.float64], ...]:
    return tuple(np.array(polygon, float) for polygon in lists)


def write_automaton(directory: Path, automaton: Automaton) -> None:
    """Write ``automaton.json`` and ``automaton.hoa``."""
    from pareto_ltl.logic.hoa import hoa_text as dumps

    content = {
        "formula": automaton.formula,
        "atoms": automaton.atoms,
        "letters": automaton.letters,
        "initial": automaton.initial,
        "accepting": automaton.accepting,
        "delta": automaton.delta,  # delta[state][letter]
        "d_A": automaton.distance,  # null where acceptance is out of reach
    }
    if automaton.windows:
        content["windows"] = {name: window.as_dict() for name, window in automaton.windows.items()}
        content["forbidden"] = automaton.forbidden
    write_json(directory / "automaton.json", content)
    write_bytes(directory / "automaton.hoa", dumps(automaton).encode())


def read_automaton(place: Path | str) -> Automaton:
    """The automaton of ``automaton.json``, a file or the directory that has it."""
    from pareto_ltl.logic import Automaton
    from pareto_ltl.world.windows import Window

    with stored(place, "automaton.json", "an automaton", "automaton") as content:
        return Automaton(
            delta=np.array(content["delta"], np.int32),
            letters=tuple(frozenset(letter) for letter in content["letters"]),
            initial=content["initial"],
            accepting=np.array(content["accepting"], bool),
            distance=np.array([math.inf if d is None else d for d in content["d_A"]], float),
            atoms=tuple(content["atoms"]),
            formula=content["formula"],
            windows={name: Window.from_dict(w) for name, w in content.get("windows", {}).items()},
            forbidden=tuple(content.get("forbidden", ())),
        )


def write_wind(directory: Path, wind: WindField) -> None:
    """Write ``wind.nc``; if ``scene.json`` is in ``directory``, with its time zero and projection."""
    from pareto_ltl.wind.netcdf import write_netcdf as to_netcdf
    from pareto_ltl.world.scene_files import scene_from_dict as from_dict

    path = directory / "scene.json"  # written by this run: a check against its schema would take 0.2 s
    scene = from_dict(read_json(path)) if path.is_file() else None
    to_netcdf(wind, directory / "wind.nc", scene)


def read_wind(place: Path | str) -> WindField:
    """The wind field of ``wind.nc``, a file or the directory that has it."""
    from pareto_ltl.wind.netcdf import read_netcdf as from_netcdf

    return from_netcdf(inside(place, "wind.nc"))


# --- trees, flights --------------------------------------------------------------------------


def write_forest(directory: Path, forest: Forest) -> None:
    """Write ``trees.npz``."""
    arrays: dict[str, NDArray[Any]] = {"accepted": forest.accepted}
    columns = {tree.risk.shape[1] for tree in forest.trees}
    if collision := max(columns, default=forest.mission_columns) - forest.mission_columns:
        arrays[COLLISION_COLUMNS] = np.array(collision)  # write_npz stores it with shape (1,)
    for number, tree in enumerate(forest.trees):
        arrays |= {f"tree_{number:03d}/{name}": getattr(tree, name) for name in TREE_ARRAYS}
        causes = sorted(tree.reach)
        arrays[f"tree_{number:03d}/causes"] = np.array(causes, dtype=np.str_)
        arrays[f"tree_{number:03d}/counts"] = np.array([tree.reach[cause] for cause in causes], float)
    write_npz(directory / "trees.npz", arrays)


def read_forest(place: Path | str) -> Forest:
    """The forest, without times (NaN): an archive must not depend on the speed of the machine."""
    with stored(place, "trees.npz", "a forest") as arrays:
        names = sorted({key.partition("/")[0] for key in arrays if "/" in key})
        trees = tuple(_tree(arrays, name) for name in names)
        columns = trees[0].risk.shape[1] - int(np.asarray(arrays.get(COLLISION_COLUMNS, 0)).item())
        return Forest(trees, arrays["accepted"], math.nan, columns)


def _tree(arrays: Mapping[str, NDArray[Any]], name: str) -> Tree:
    counts = zip(arrays[f"{name}/causes"].tolist(), arrays[f"{name}/counts"].tolist(), strict=True)
    tree = Tree(**{key: arrays[f"{name}/{key}"] for key in TREE_ARRAYS}, seconds=math.nan, reach=dict(counts))
    size = len(tree.parent)
    require_shape(f"{name}/x", tree.x, size, 2)
    require_shape(f"{name}/risk", tree.risk, size, None)
    for key in ("step", "q", "cell", "length"):
        require_shape(f"{name}/{key}", getattr(tree, key), size)
    if (tree.parent >= np.arange(size)).any() or (tree.parent < -1).any():
        raise ValueError(f"a vertex of {name} does not come after its parent")
    return tree


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


# --- studies ---------------------------------------------------------------------------------


def write_study(directory: Path, study: Study) -> None:
    """Write every table as CSV, columns in the order of the first row, and the main ones as ``tables.md``."""
    for name, rows in study.tables.items():
        if rows:
            header = tuple(rows[0])
            write_csv(directory / f"{name}.csv", header, ([row[key] for key in header] for row in rows))
    write_bytes(directory / "tables.md", study.text.encode())
