"""Results on disk: one directory a run, files that others may rely on.

Every file appears whole or not at all (written beside its place, then moved), and the same records
give the same bytes: archives carry a fixed date, JSON keeps its order and prints the shortest digits
that read back to the same number. ``metrics.json`` comes last; its presence means that the run is done.
"""

from __future__ import annotations

import csv
import io
import json
import math
import os
import zipfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pareto_ltl.planning.records import Acceptance, Forest, Front, Objectives, Plan, PlannedPath, Tree
from pareto_ltl.simulation.records import Deployment
from pareto_ltl.studies.records import Study
from pareto_ltl.support.errors import DataError
from pareto_ltl.wind.records import WindField
from pareto_ltl.world.cells import Decomposition
from pareto_ltl.world.scene import Scene

if TYPE_CHECKING:
    from pareto_ltl.logic import Automaton

PLAN_SCHEMA = "pareto_ltl.plan/1"
EPOCH = (1980, 1, 1, 0, 0, 0)  # the earliest date a zip archive can carry
TREE_ARRAYS = ("x", "parent", "step", "q", "cell", "length", "risk", "swaps", "beta")

# --- files that appear whole -----------------------------------------------------------------


@contextmanager
def whole(path: Path) -> Iterator[Path]:
    """A place to write to; it becomes ``path`` when the block ends well, and vanishes when it does not."""
    draft = path.with_name(f".{os.getpid()}.{path.name}")
    try:
        yield draft
        os.replace(draft, path)
    finally:
        draft.unlink(missing_ok=True)


def write_bytes(path: Path, data: bytes) -> None:
    with whole(path) as draft, draft.open("wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """One line a key, in the order given; NaN and infinity become null."""
    lines = [
        f" {json.dumps(key)}: {json.dumps(plain(value), allow_nan=False)}" for key, value in content.items()
    ]
    write_bytes(path, ("{\n" + ",\n".join(lines) + "\n}\n").encode())


def plain(value: Any) -> Any:
    """Arrays, records, sets and odd numbers as what JSON knows."""
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, frozenset | set):
        return sorted(plain(item) for item in value)
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return value


def write_npz(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """``numpy.savez`` whose bytes depend on the arrays alone: names sorted, one date for all."""
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w") as zipped:
        for name in sorted(arrays):
            content = io.BytesIO()
            np.lib.format.write_array(content, np.ascontiguousarray(arrays[name]), allow_pickle=False)
            entry = zipfile.ZipInfo(f"{name}.npy", EPOCH)
            entry.external_attr = 0o644 << 16
            zipped.writestr(entry, content.getvalue(), zipfile.ZIP_DEFLATED, compresslevel=1)
    write_bytes(path, archive.getvalue())


def write_csv(path: Path, header: Iterable[str], rows: Iterable[Iterable[Any]]) -> None:
    text = io.StringIO(newline="")
    table = csv.writer(text, lineterminator="\n")
    table.writerow(header)
    table.writerows([plain(cell) for cell in row] for row in rows)
    write_bytes(path, text.getvalue().encode())


def read_json(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror}); is this a results directory?") from error
    except ValueError as error:
        raise DataError(f"{path}: not JSON ({error}); run the plan again") from error
    if not isinstance(content, dict):
        raise DataError(f"{path}: expected a JSON object, found {type(content).__name__}; run the plan again")
    return content


def read_npz(path: Path) -> dict[str, NDArray[Any]]:
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files}
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error}); is this a results directory?") from error
    except (ValueError, zipfile.BadZipFile, EOFError) as error:
        raise DataError(f"{path}: not an archive of arrays ({error}); run the plan again") from error


@contextmanager
def _shaped(path: Path, what: str) -> Iterator[None]:
    try:
        yield
    except (KeyError, TypeError, ValueError, AttributeError, IndexError) as error:
        reason = f"{error} is missing" if isinstance(error, KeyError) else str(error)
        raise DataError(f"{path}: not {what} ({reason}); run the plan again") from error


def _inside(place: Path | str, name: str) -> Path:
    """``place`` itself when it is a file, else the file ``name`` in it."""
    place = Path(place)
    return place / name if place.is_dir() else place


# --- scene, cells, automaton, wind -----------------------------------------------------------


def write_scene(directory: Path, scene: Scene) -> None:
    from pareto_ltl.world.scene_files import to_dict

    write_json(directory / "scene.json", to_dict(scene))


def read_scene(place: Path | str) -> Scene:
    from pareto_ltl.world.scene_files import from_dict

    path = _inside(place, "scene.json")
    content = read_json(path)
    with _shaped(path, "a scene"):
        return from_dict(content)


def write_decomposition(directory: Path, decomposition: Decomposition) -> None:
    write_json(directory / "cells.json", asdict(decomposition))


def read_decomposition(place: Path | str) -> Decomposition:
    path = _inside(place, "cells.json")
    content = read_json(path)
    with _shaped(path, "a decomposition"):
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
    from pareto_ltl.logic.hoa import dumps

    content = {
        "formula": automaton.formula,
        "atoms": automaton.atoms,
        "letters": automaton.letters,
        "initial": automaton.initial,
        "accepting": automaton.accepting,
        "delta": automaton.delta,  # delta[state][letter]
        "d_A": automaton.distance,  # null where acceptance is out of reach
    }
    write_json(directory / "automaton.json", content)
    write_bytes(directory / "automaton.hoa", dumps(automaton).encode())


def write_wind(directory: Path, wind: WindField) -> None:
    """With the scene beside it, where there is one, the file's clock and projection are named too."""
    from pareto_ltl.wind.field import to_netcdf

    scene = read_scene(directory) if (directory / "scene.json").is_file() else None
    to_netcdf(wind, directory / "wind.nc", scene)


def read_wind(place: Path | str) -> WindField:
    from pareto_ltl.wind.field import from_netcdf

    return from_netcdf(_inside(place, "wind.nc"))


# --- forest and front ------------------------------------------------------------------------


def write_forest(directory: Path, forest: Forest) -> None:
    arrays: dict[str, NDArray[Any]] = {"accepted": forest.accepted}
    for number, tree in enumerate(forest.trees):
        arrays |= {f"tree_{number:03d}/{name}": getattr(tree, name) for name in TREE_ARRAYS}
        causes = sorted(tree.reach)
        arrays[f"tree_{number:03d}/causes"] = np.array(causes, dtype=np.str_)
        arrays[f"tree_{number:03d}/counts"] = np.array([tree.reach[cause] for cause in causes], float)
    write_npz(directory / "trees.npz", arrays)


def read_forest(place: Path | str) -> Forest:
    """The forest without its times (NaN): an archive must not depend on how fast the machine was."""
    path = _inside(place, "trees.npz")
    arrays = read_npz(path)
    with _shaped(path, "a forest"):
        names = sorted({key.partition("/")[0] for key in arrays if "/" in key})
        return Forest(tuple(_tree(arrays, name) for name in names), arrays["accepted"], math.nan)


def _tree(arrays: Mapping[str, NDArray[Any]], name: str) -> Tree:
    counts = zip(arrays[f"{name}/causes"].tolist(), arrays[f"{name}/counts"].tolist(), strict=True)
    return Tree(**{key: arrays[f"{name}/{key}"] for key in TREE_ARRAYS}, seconds=math.nan, reach=dict(counts))


FRONT_HEADER = (
    "path",
    "length_m",
    "mission_risk_paper",
    "mission_risk",
    "collision_risk",
    "mission_risk_ordered",
    "steps",
    "duration_s",
    "failure_estimate",
    "origin",
)


def write_front(directory: Path, front: Front) -> None:
    estimates = front.estimates or (math.nan,) * len(front.paths)
    rows = [
        (number, *_costs(path.objectives), len(path.u), path.t[-1] - path.t[0], estimate, path.origin)
        for number, (path, estimate) in enumerate(zip(front.paths, estimates, strict=True))
    ]
    write_csv(directory / "front.csv", FRONT_HEADER, rows)


def _costs(objectives: Objectives) -> tuple[float, ...]:
    o = objectives
    return o.length, o.mission_risk_paper, o.mission_risk, o.collision_risk, o.mission_risk_ordered


def read_front(place: Path | str) -> list[tuple[Objectives, str]]:
    """Objectives and origin of every path of the front."""
    path = _inside(place, "front.csv")
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror}); is this a results directory?") from error
    with _shaped(path, "a front"):
        return [
            (Objectives(*(float(row[name]) for name in FRONT_HEADER[1:6])), row["origin"])
            for row in csv.DictReader(text.splitlines())
        ]


# --- plan and deployment ---------------------------------------------------------------------


def write_plan(directory: Path, plan: Plan) -> None:
    path = plan.path
    content = {
        "schema": PLAN_SCHEMA,
        "formula": plan.formula,
        "atoms": plan.atoms,
        "dt": plan.dt,
        "u_max": plan.u_max,
        "epsilon": plan.epsilon,
        "fidelity": plan.fidelity,
        "objectives": asdict(path.objectives),
        "selection": {"rule": plan.rule, "weights": plan.weights},
        "acceptance": None if plan.acceptance is None else asdict(plan.acceptance),
        "origin": path.origin,
        "fixes": path.fixes,
        "t": path.t,
        "x": path.x,
        "cov": path.cov,
        "q": path.q,
        "label": path.label,
        "u": path.u,
    }
    write_json(directory / "plan.json", content)
    header = ("step", "t_s", "x_m", "y_m", "u_x_m_s", "u_y_m_s", "cov_xx", "cov_xy", "cov_yy", "q", "label")
    write_csv(directory / "plan.csv", header, (_plan_row(path, step) for step in range(len(path.t))))


def _plan_row(path: PlannedPath, step: int) -> tuple[Any, ...]:
    control = path.u[step] if step < len(path.u) else ("", "")  # nothing is flown from the last position
    (xx, xy), (_, yy) = path.cov[step]
    return (
        step,
        path.t[step],
        *path.x[step],
        *control,
        xx,
        xy,
        yy,
        path.q[step],
        " ".join(sorted(path.label[step])),
    )


def read_plan(place: Path | str) -> Plan:
    """The plan in a results directory, or in a file of the same form."""
    path = _inside(place, "plan.json")
    content = read_json(path)
    if content.get("schema") != PLAN_SCHEMA:
        raise DataError(
            f"{path}: expected a plan of schema {PLAN_SCHEMA!r}, found {content.get('schema')!r}; "
            "read it with the version of pareto-ltl that wrote it"
        )
    with _shaped(path, "a plan"):
        return Plan(
            path=_flight(content),
            formula=content["formula"],
            atoms=tuple(content["atoms"]),
            dt=content["dt"],
            u_max=content["u_max"],
            epsilon=content["epsilon"],
            fidelity=content["fidelity"],
            rule=content["selection"]["rule"],
            weights=tuple(content["selection"]["weights"]),
            acceptance=Acceptance(**content["acceptance"]) if content.get("acceptance") else None,
        )


def _flight(content: Mapping[str, Any]) -> PlannedPath:
    objectives = {
        key: math.nan if value is None else float(value) for key, value in content["objectives"].items()
    }
    flight = PlannedPath(
        t=np.array(content["t"], float),
        x=np.array(content["x"], float),
        cov=np.array(content["cov"], float),
        q=np.array(content["q"], np.int64),
        label=tuple(frozenset(names) for names in content["label"]),
        u=np.array(content["u"], float).reshape(-1, 2),
        objectives=Objectives(**objectives),
        origin=content["origin"],
        fixes=tuple(content.get("fixes", ())),
    )
    steps = len(flight.t)
    shapes = {"x": (steps, 2), "cov": (steps, 2, 2), "q": (steps,), "u": (steps - 1, 2)}
    for name, shape in shapes.items():
        if getattr(flight, name).shape != shape:
            raise ValueError(f"{name} must have shape {shape}, got {getattr(flight, name).shape}")
    if len(flight.label) != steps:
        raise ValueError(f"label must have {steps} entries, got {len(flight.label)}")
    return flight


def write_deployments(directory: Path, deployments: Mapping[str, Deployment]) -> None:
    arrays = {
        f"{law}/{name}": getattr(deployment, name)
        for law, deployment in deployments.items()
        for name in ("x", "accepted", "collided")
    }
    write_npz(directory / "deployments.npz", arrays)


def read_deployments(place: Path | str) -> dict[str, Deployment]:
    path = _inside(place, "deployments.npz")
    arrays = read_npz(path)
    with _shaped(path, "deployments"):
        laws = sorted({name.partition("/")[0] for name in arrays})
        return {
            law: Deployment(law, *(arrays[f"{law}/{name}"] for name in ("x", "accepted", "collided")))
            for law in laws
        }


# --- evaluations -----------------------------------------------------------------------------


def write_study(directory: Path, study: Study) -> None:
    """Every table as CSV, columns in the order of the first row, and the main ones as ``tables.md``."""
    for name, rows in study.tables.items():
        if rows:
            header = tuple(rows[0])
            write_csv(directory / f"{name}.csv", header, ([row[key] for key in header] for row in rows))
    write_bytes(directory / "tables.md", study.text.encode())


# --- the directory ---------------------------------------------------------------------------

WRITERS: dict[str, Callable[[Path, Any], None]] = {
    "scene": write_scene,
    "wind": write_wind,
    "decomposition": write_decomposition,
    "automaton": write_automaton,
    "forest": write_forest,
    "front": write_front,
    "plan": write_plan,
    "deployment": write_deployments,
    "comparison": write_study,
    "convergence": write_study,
    "ablation": write_study,
    "hindcast": write_study,
}


@dataclass(frozen=True, slots=True)
class Results:
    """One results directory, read lazily: ``Results("outputs/phi1/...").plan.path.objectives``."""

    directory: Path

    def __init__(self, directory: Path | str) -> None:
        object.__setattr__(self, "directory", Path(directory))

    def save(self, name: str, record: Any) -> None:
        """Write what stage ``name`` made, where it has a place on disk."""
        if name in WRITERS:
            WRITERS[name](self.directory, record)

    @property
    def done(self) -> bool:
        return (self.directory / "metrics.json").is_file()

    @property
    def metrics(self) -> dict[str, float]:
        content = read_json(self.directory / "metrics.json")
        return {name: math.nan if value is None else value for name, value in content.items()}

    @property
    def run(self) -> dict[str, Any]:
        return read_json(self.directory / "run.json")

    @property
    def scene(self) -> Scene:
        return read_scene(self.directory)

    @property
    def wind(self) -> WindField:
        return read_wind(self.directory)

    @property
    def decomposition(self) -> Decomposition:
        return read_decomposition(self.directory)

    @property
    def forest(self) -> Forest:
        return read_forest(self.directory)

    @property
    def front(self) -> list[tuple[Objectives, str]]:
        return read_front(self.directory)

    @property
    def plan(self) -> Plan:
        return read_plan(self.directory)

    @property
    def deployments(self) -> dict[str, Deployment]:
        return read_deployments(self.directory)
