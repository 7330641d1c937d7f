"""Results on disk: one directory for each run, with documented files.

A file is written completely or not at all, and the same records give the same bytes (``support.files``).
``metrics.json`` is written last; its presence means that the run is complete.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pareto_ltl.planning.records import Forest, Front, Plan, Tree
from pareto_ltl.report.records import Study
from pareto_ltl.run import provenance
from pareto_ltl.run.file_shape import inside, shaped
from pareto_ltl.run.front_files import read_front, write_front
from pareto_ltl.run.plan_files import read_plan, write_plan
from pareto_ltl.run.records import (
    AUTOMATON,
    DECOMPOSITION,
    DEPLOYMENTS,
    FOREST,
    FRONT,
    PLAN,
    SCENE,
    WIND,
    RecordKey,
    Records,
    T,
)
from pareto_ltl.settings import Settings
from pareto_ltl.settings.building import read_settings_file
from pareto_ltl.simulation.records import Deployment
from pareto_ltl.support.archives import read_npz
from pareto_ltl.support.arrays import require_shape
from pareto_ltl.support.display import Displayed
from pareto_ltl.support.files import write_bytes, write_csv, write_json, write_npz
from pareto_ltl.support.reading import read_json
from pareto_ltl.support.schemas import read_document
from pareto_ltl.wind.records import WindField
from pareto_ltl.world.cells import Decomposition
from pareto_ltl.world.scene import Scene

if TYPE_CHECKING:
    from pareto_ltl.logic import Automaton

COLLISION_COLUMNS = "collision_columns"  # number of last columns of Tree.risk; missing if there are none
TREE_ARRAYS = ("x", "parent", "step", "q", "cell", "length", "risk", "swaps", "beta")


# --- scene, cells, automaton, wind -----------------------------------------------------------


def write_scene(directory: Path, scene: Scene) -> None:
    """Write ``scene.json``."""
    from pareto_ltl.world.scene_files import scene_to_dict as to_dict

    write_json(directory / "scene.json", to_dict(scene))


def read_scene(place: Path | str) -> Scene:
    """The map of ``scene.json``, a file or the directory that has it."""
    from pareto_ltl.world.scene_files import scene_from_dict as from_dict
    from pareto_ltl.world.scene_shapes import refuse_crossings

    path = inside(place, "scene.json")
    content = read_document(path, "scene")
    with shaped(path, "a scene"):
        scene = from_dict(content)
        refuse_crossings((*scene.region_outlines, *scene.obstacles, *scene.landmarks))
    return scene


def write_decomposition(directory: Path, decomposition: Decomposition) -> None:
    """Write ``cells.json``."""
    write_json(directory / "cells.json", asdict(decomposition))


def read_decomposition(place: Path | str) -> Decomposition:
    """The cells of ``cells.json``, a file or the directory that has it."""
    path = inside(place, "cells.json")
    content = read_document(path, "cells")
    with shaped(path, "a decomposition"):
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

    path = inside(place, "automaton.json")
    content = read_document(path, "automaton")
    with shaped(path, "an automaton"):
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


# --- forest ----------------------------------------------------------------------------------


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
    path = inside(place, "trees.npz")
    arrays = read_npz(path)
    with shaped(path, "a forest"):
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


# --- deployments -----------------------------------------------------------------------------

FLIGHT_ARRAYS = "x", "accepted", "collided", "off_map", "walled"


def write_deployments(directory: Path, deployments: Mapping[str, Deployment]) -> None:
    """Write ``deployments.npz``: the flights under each wind law."""
    flights = deployments.items()
    arrays = {f"{law}/{n}": np.asarray(getattr(flown, n)) for law, flown in flights for n in FLIGHT_ARRAYS}
    write_npz(directory / "deployments.npz", arrays)


def read_deployments(place: Path | str) -> dict[str, Deployment]:
    """The flights of ``deployments.npz`` by wind law; ``place`` is the file or the directory that has it."""
    path = inside(place, "deployments.npz")
    arrays = read_npz(path)
    with shaped(path, "deployments"):
        laws = sorted({name.partition("/")[0] for name in arrays})
        flights = {law: [arrays[f"{law}/{name}"] for name in FLIGHT_ARRAYS] for law in laws}
        return {law: Deployment(law, f[0], f[1], f[2], f[3], bool(f[4].all())) for law, f in flights.items()}


# --- evaluations -----------------------------------------------------------------------------


def write_study(directory: Path, study: Study) -> None:
    """Write every table as CSV, columns in the order of the first row, and the main ones as ``tables.md``."""
    for name, rows in study.tables.items():
        if rows:
            header = tuple(rows[0])
            write_csv(directory / f"{name}.csv", header, ([row[key] for key in header] for row in rows))
    write_bytes(directory / "tables.md", study.text.encode())


# --- the directory ---------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class RecordFiles:
    """The files of a record, the function that writes them into a directory, and the one that reads them."""

    names: tuple[str, ...]
    write: Callable[[Path, Any], None]
    read: Callable[[Path], Any]


RECORD_FILES: dict[RecordKey[Any], RecordFiles] = {
    SCENE: RecordFiles(("scene.json",), write_scene, read_scene),
    DECOMPOSITION: RecordFiles(("cells.json",), write_decomposition, read_decomposition),
    AUTOMATON: RecordFiles(("automaton.json",), write_automaton, read_automaton),
    WIND: RecordFiles(("wind.nc",), write_wind, read_wind),
    FOREST: RecordFiles(("trees.npz",), write_forest, read_forest),
    FRONT: RecordFiles(("front.csv", "front.npz"), write_front, read_front),
    PLAN: RecordFiles(("plan.json",), write_plan, read_plan),
    DEPLOYMENTS: RecordFiles(("deployments.npz",), write_deployments, read_deployments),
}


def save_record(directory: Path, key: RecordKey[T], record: T) -> None:
    """Write ``record`` into ``directory`` if it has files."""
    if key in RECORD_FILES:
        RECORD_FILES[key].write(directory, record)
    elif isinstance(record, Study):
        write_study(directory, record)


class RecordView(Displayed):
    """The records of a run as attributes, or as ``view[KEY]``; a subclass defines where they come from."""

    __slots__ = ()

    def __getitem__(self, key: RecordKey[T]) -> T:
        raise NotImplementedError

    @property
    def scene(self) -> Scene:
        """The map."""
        return self[SCENE]

    @property
    def decomposition(self) -> Decomposition:
        """The convex cells of the map."""
        return self[DECOMPOSITION]

    @property
    def automaton(self) -> Automaton:
        """The minimal automaton of the mission."""
        return self[AUTOMATON]

    @property
    def wind(self) -> WindField:
        """The wind that the plan was made for."""
        return self[WIND]

    @property
    def forest(self) -> Forest:
        """The search trees."""
        return self[FOREST]

    @property
    def front(self) -> Front:
        """The non-dominated paths."""
        return self[FRONT]

    @property
    def plan(self) -> Plan:
        """The path to fly."""
        return self[PLAN]

    @property
    def deployments(self) -> Mapping[str, Deployment]:
        """The simulated flights by wind law."""
        return self[DEPLOYMENTS]


@dataclass(frozen=True, slots=True, repr=False)
class Results(RecordView):
    """One results directory, read lazily: ``Results("outputs/phi1/...").plan.path.objectives``."""

    directory: Path

    def __init__(self, directory: Path | str) -> None:
        object.__setattr__(self, "directory", Path(directory))

    def __getitem__(self, key: RecordKey[T]) -> T:
        record: T = RECORD_FILES[key].read(self.directory)
        return record

    def records(self, keys: Iterable[RecordKey[Any]] = tuple(RECORD_FILES)) -> Records:
        """The records of ``keys`` whose files exist."""
        return Records(
            {
                key: self[key]
                for key in keys
                if all((self.directory / name).is_file() for name in RECORD_FILES[key].names)
            }
        )

    def facts(self) -> Mapping[str, str]:
        """Directory, and name, seed, fidelity and status of the run."""
        record = self.run if (self.directory / "run.json").is_file() else {}
        names = ("name", "seed", "fidelity", "status")
        return {"directory": str(self.directory)} | {name: str(record.get(name)) for name in names}

    def plot(self, **options: Any) -> Any:
        """The map with trees and plan, as a ``Drawing``."""
        from pareto_ltl.report.notebook import mission_drawing

        return mission_drawing(self.scene, self.decomposition, self.wind, self.forest, self.plan, **options)

    @property
    def settings(self) -> Settings:
        """The settings that the run was made with."""
        return read_settings_file(self.directory / "config_resolved.yaml")

    @property
    def done(self) -> bool:
        """Whether the run has ended with an answer: a plan, tables, or that no plan exists."""
        if not (self.directory / "run.json").is_file():
            return False
        record = self.run
        answered = record.get("status") in provenance.ANSWERS
        return answered and (not record.get("measured", True) or (self.directory / "metrics.json").is_file())

    @property
    def metrics(self) -> dict[str, float]:
        """The numbers of ``metrics.json``, NaN where it has null."""
        content = read_document(self.directory / "metrics.json", "metrics")
        return {name: math.nan if value is None else value for name, value in content.items()}

    @property
    def run(self) -> dict[str, Any]:
        """The content of ``run.json``: status, versions, times."""
        return read_document(self.directory / "run.json", "run")
