"""The origin of a result: ``run.json`` has enough to make it again and to check that it is the same."""

from __future__ import annotations

import os
import platform
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from careful_io.fingerprints import code_fingerprint, data_fingerprint, file_hashes
from careful_io.machine import cores
from careful_io.reading import inside
from pareto_ltl import __version__
from pareto_ltl.settings.wind import LAW_WORDS
from pareto_ltl.support.errors import ParetoLtlError
from pareto_ltl.support.resources import checkout

if TYPE_CHECKING:
    from pareto_ltl.settings import Settings
    from pareto_ltl.wind.area import Wanted

PACKAGES = (
    "clarabel", "cvxpy-base", "hydra-core", "moocore", "networkx", "numba", "numpy", "pyproj", "scikit-learn",
    "scipy", "shapely", "xarray",
)  # fmt: skip

NO_COMMIT = "(initial)"  # output of git if there is no commit yet


def config_hash(settings: Settings) -> str:
    """Fingerprint of the code and of all settings that a result can depend on."""
    content = asdict(settings)
    del content["planner"]["threads"]
    for section in settings.sections():
        if not section.result:
            del content[section.section]
    # The fingerprint of the source counts too: the version does not change during development.
    hashed = {"version": __version__, "code": code_fingerprint(), "settings": content}
    return data_fingerprint(hashed)


def begin(settings: Settings, argv: Sequence[str], overrides: Sequence[str] = ()) -> dict[str, Any]:
    """The content of ``run.json`` when a run starts."""
    return {
        "status": "running",
        "error": None,
        "argv": list(argv),
        "overrides": list(overrides),
        "folder": os.getcwd(),
        "host": platform.node(),
        "pid": os.getpid(),
        "threads": cores(),
        "name": settings.name,
        "seed": settings.seed,
        "fidelity": settings.fidelity.label,
        "stages": settings.pipelines.stages,
        "config_hash": config_hash(settings),
        "version": __version__,
        "code_hash": code_fingerprint(),
        "git": git_state(checkout()),
        "python": platform.python_version(),
        "packages": {name: _version(name) for name in PACKAGES},
        "started": now(),
    }


def write(directory: Path, record: Mapping[str, Any]) -> None:
    """Write ``record`` as ``run.json``."""
    from careful_io.files import write_json  # it loads NumPy, which an error of settings must not

    write_json(directory / "run.json", record)


def write_settings(directory: Path, settings: Settings) -> None:
    """Write every setting of the run as ``config_resolved.yaml``, from which it can be read back."""
    from careful_io.files import write_bytes

    write_bytes(directory / "config_resolved.yaml", settings.as_yaml().encode())


def git_state(root: Path | None) -> dict[str, Any] | None:
    """Commit of the git checkout at ``root`` and whether files differ from it; None outside a checkout."""
    if root is None or not (root / ".git").exists():
        return None
    status = _git(root, "status", "--porcelain=v2", "--branch")
    lines = [] if status is None else status.splitlines()
    oid = next((line.split()[-1] for line in lines if line.startswith("# branch.oid ")), NO_COMMIT)
    changed = any(not line.startswith("#") for line in lines)
    return None if oid == NO_COMMIT else {"commit": oid, "changed": changed}


def _git(root: Path, *words: str) -> str | None:
    try:
        # Without locks, which a process killed after 5 s would leave behind.
        command = ["git", "--no-optional-locks", "-C", str(root), *words]
        done = subprocess.run(command, capture_output=True, text=True, timeout=5, check=True)
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip()


def input_hashes(settings: Settings) -> dict[str, str]:
    """SHA-256 of each file that a run reads, by its path; empty if one cannot be read."""
    try:
        return file_hashes(input_files(settings))
    except (ParetoLtlError, OSError):  # the stage that reads them has reported it
        return {}


def input_files(settings: Settings) -> list[Path]:
    """The files that a run reads, for its records; raises ``DataError`` if the wind files are missing."""
    from pareto_ltl.world.map_formats import map_formats

    drawn = [settings.scene.file, *map(str, settings.scene.zones)] if settings.scene.file else []
    shown = [Path(name).expanduser() for name in drawn]
    named = [*shown, *(other for path in shown if path.is_file() for other in map_formats().linked(path))]
    if settings.mission.automaton:
        named.append(Path(settings.mission.automaton).expanduser())
    if settings.wind.forecast_error not in LAW_WORDS:
        named.append(Path(settings.wind.forecast_error).expanduser())
    maps = [path for path in named if path.is_file()]  # the stage that reads a missing one reports it
    if settings.selection.extra_paths:
        maps.append(inside(Path(settings.selection.extra_paths).expanduser(), "front.npz"))
    return [*maps, *wind_files(settings)]


def wind_files(settings: Settings) -> tuple[Path, ...]:
    """The files that the source of the wind reads; raises ``DataError`` if they are missing."""
    from pareto_ltl.wind.sources import wind_source

    return wind_source(settings.wind).files(settings.wind, wanted_wind(settings))


def wanted_wind(settings: Settings) -> Wanted:
    """Place and time at which the wind is needed; everything in pipelines without a map."""
    from pareto_ltl.wind.area import ALL_WIND, Wanted, neighbourhood

    scene, start, padding = settings.scene, settings.mission.start_time, settings.wind.padding
    if "scene" not in settings.pipelines.stages:
        return ALL_WIND
    return Wanted(neighbourhood(scene, padding), start)


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def now() -> str:
    """The time in UTC, as ``run.json`` has it."""
    return datetime.now(UTC).isoformat(timespec="milliseconds")
