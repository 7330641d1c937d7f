"""Long work in parts: each part's result is a small file, written whole, and never worked out twice.

A part's file carries a key, the hash of everything its result depends on: settings, arguments, wind files
and the code. A later run with the same keys reads the files instead. What a killed run leaves half-written
never has the name of a result.
"""

from __future__ import annotations

import hashlib
import json
import os
import pickle
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from pareto_ltl.run.results import plain, read_json, write_json
from pareto_ltl.settings import EvaluationConfig, Settings, as_dict
from pareto_ltl.support.errors import DataError

FOLDER = "parts"
NO_MATTER = (
    "name",
    "report",
    "pipelines",
    "ingest",
    "evaluation",
    "compare",
    "convergence",
    "ablation",
    "hindcast",
)
NO_RESULT = ("report", "cli", "__main__.py")  # code that no result depends on

Progress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True)
class Part:
    """One independent piece of work.

    Attributes
    ----------
    name : str
        Names the file, for people.
    arguments : tuple
        Passed to the work function after the context.
    key : str
        Hash of all that the result depends on.
    """

    name: str
    arguments: tuple[Any, ...]
    key: str

    @property
    def file(self) -> str:
        return f"{self.name}-{self.key[:12]}.json"


def key(settings: Settings, *more: Any) -> str:
    """Hash of the settings that matter to a plan, of ``more``, of the wind files and of the code."""
    kept = {name: value for name, value in as_dict(settings).items() if name not in NO_MATTER}
    kept["planner"].pop("threads")
    content = [kept, plain(list(more)), inputs(tuple(sorted(_files(settings)))), edition()]
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _files(settings: Settings) -> list[Path]:
    from pareto_ltl.run.stages import input_files

    return input_files(settings)


@lru_cache
def inputs(files: tuple[Path, ...]) -> list[str]:
    """SHA-256 of each file; the content counts, not the name."""
    return [hashlib.sha256(file.read_bytes()).hexdigest() for file in files]


@lru_cache
def edition() -> str:
    """SHA-256 of the package's code, without what only shows results."""
    root = Path(__file__).parents[1]
    digest = hashlib.sha256()
    for source in sorted(root.rglob("*.py")):
        if source.relative_to(root).parts[0] not in NO_RESULT:
            digest.update(source.read_bytes())
    return digest.hexdigest()


# --- the folder ------------------------------------------------------------------------------


def folder(cfg: EvaluationConfig, directory: Path) -> Path:
    """Where parts are kept: in the results, or in those of the run to go on with."""
    if cfg.resume is None:
        place = directory / FOLDER
        place.mkdir(parents=True, exist_ok=True)
        return place
    place = Path(cfg.resume).expanduser() / FOLDER
    if not place.is_dir():
        raise DataError(
            f"evaluation.resume={cfg.resume}: there is no folder {FOLDER}/ in it; name the results directory "
            "of a run of compare, convergence, ablation or hindcast, or leave evaluation.resume out"
        )
    return place


def finished(part: Part, place: Path) -> dict[str, Any] | None:
    """The result of ``part`` if it is on disk; a damaged file is named, removed and None returned."""
    path = place / part.file
    if not path.exists():
        return None
    try:
        content = read_json(path)
        if content.get("key") != part.key or not isinstance(content.get("result"), dict):
            raise DataError(f"{path}: expected the result of {part.name}, found something else")
    except DataError as error:
        reason = str(error).removeprefix(f"{path}: ").split("; run the plan")[0]
        print(f"pareto-ltl: {path} is damaged ({reason}); it is made again", file=sys.stderr)
        path.unlink()
        return None
    return dict(content["result"])


def sweep(place: Path) -> None:
    """Remove the drafts of processes that are no more."""
    for draft in place.glob(".*.json"):
        owner = draft.name.split(".")[1]
        if owner.isdigit() and not _alive(int(owner)):
            draft.unlink(missing_ok=True)


def _alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return True


# --- the work --------------------------------------------------------------------------------


def work(
    cfg: EvaluationConfig,
    directory: Path,
    function: Callable[..., Mapping[str, Any]],
    context: Any,
    parts: Sequence[Part],
    progress: Progress | None = None,
) -> list[dict[str, Any]]:
    """Results of ``function(context, *part.arguments)`` for all parts, in their order.

    Results are read back from disk even when they are new, so that a run that went on has the bytes of one
    that was never stopped.
    """
    place = folder(cfg, directory)
    sweep(place)
    distinct = {part.key: part for part in parts}
    done = {k: result for k, part in distinct.items() if (result := finished(part, place)) is not None}
    todo = [part for k, part in distinct.items() if k not in done]
    count = len(done)
    try:
        for _ in _perform(cfg, place, function, context, todo):
            count += 1
            if progress is not None:
                progress(count, len(distinct))
    except KeyboardInterrupt:
        kept = f"{count} of {len(distinct)} parts are kept"
        print(f"pareto-ltl: {kept}; evaluation.resume={place.parent} goes on with them", file=sys.stderr)
        raise
    for part in todo:
        result = finished(part, place)
        if result is None:
            raise DataError(f"{place / part.file}: could not be read back; is another run using this folder?")
        done[part.key] = result
    return [done[part.key] for part in parts]


def processes(cfg: EvaluationConfig, parts: int) -> int:
    """Not more than there is to do."""
    from joblib import cpu_count  # heeds affinity and the limits of containers

    return max(1, min(cfg.jobs or int(cpu_count()), parts))


def _perform(
    cfg: EvaluationConfig,
    place: Path,
    function: Callable[..., Mapping[str, Any]],
    context: Any,
    todo: Sequence[Part],
) -> Iterator[None]:
    jobs = processes(cfg, len(todo))
    if jobs == 1:
        for part in todo:
            _keep(place, part, function(context, *part.arguments))
            yield
        return
    from joblib import Parallel, delayed

    with tempfile.TemporaryDirectory() as scratch:
        shared = Path(scratch) / "context.pickle"
        shared.write_bytes(pickle.dumps(context))
        pool = Parallel(n_jobs=jobs, return_as="generator_unordered", batch_size=1, pre_dispatch="2*n_jobs")
        for _ in pool(delayed(_remotely)(place, shared, function, part) for part in todo):
            yield


def _remotely(place: Path, shared: Path, function: Callable[..., Mapping[str, Any]], part: Part) -> None:
    _keep(place, part, function(_context(shared), *part.arguments))


@lru_cache(maxsize=1)
def _context(shared: Path) -> Any:
    """What all parts have in common, loaded once a process."""
    return pickle.loads(shared.read_bytes())


def _keep(place: Path, part: Part, result: Mapping[str, Any]) -> None:
    write_json(place / part.file, {"key": part.key, "part": part.name, "result": result})
