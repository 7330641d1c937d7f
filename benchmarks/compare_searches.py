"""Make the fronts of results again, and judge the fronts of several versions of the search.

``front NAME FOLDER ...`` makes the front of each results directory once more with the code at hand, from its
map, wind and trees, and writes its paths and the CPU seconds of the stage to ``FOLDER/NAME.npz``. With
another version on ``PYTHONPATH`` this gives its fronts. ``judge NAME,NAME FOLDER ...`` flies the paths of all
of them in the same fresh winds; folders of one mission, ``name-seed``, are judged together. The columns are,
for each version, the CPU seconds of each seed, the hypervolume of each seed over that of all fronts of the
mission (logarithms of failure and length), and the failure at equal length over the first version's, of the
same seed.
"""

from __future__ import annotations

import argparse
import time
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path

import moocore
import numpy as np
from numpy.random import SeedSequence

from compare_fronts import ratios_at_equal_length
from pareto_ltl import load_results
from pareto_ltl.extend import which_fail
from pareto_ltl.planning.evaluate import evaluate_path
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.records import PlannedPath
from pareto_ltl.run.front_stage import Search, make_front
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.budget import Budget

JUDGING = SeedSequence(31)
LEAST = 1e-4  # failure rates below count as this one
BEYOND = 1.5  # the corner's length over the longest path


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("task", choices=["front", "judge"])
    parser.add_argument("names", help="of versions, with commas between them")
    parser.add_argument("results", nargs="+", type=Path, help="results directories with trees")
    parser.add_argument("--runs", type=int, default=20_000, help="flights that judge each path")
    parser.add_argument("--set", nargs="*", default=[], help="settings of the search: refine.points=8")
    return parser.parse_args()


def main() -> None:
    asked = arguments()
    if asked.task == "front":
        for folder in asked.results:
            remake(folder, asked.names, asked.set)
        return
    groups = defaultdict(list)
    for folder in asked.results:
        groups[folder.resolve().name.rpartition("-")[0]].append(folder)
    table = [judged(name, folders, asked.names.split(","), asked.runs) for name, folders in groups.items()]
    means = {name: np.mean([row[name] for row in table], axis=0) for name in asked.names.split(",")}
    for name, (cpu, volume, worst, ratio) in means.items():
        print(
            f"mean {name:12} {cpu:6.2f} CPU s, volume {volume:.4f}, worst seed {worst:.4f}, ratio {ratio:.3f}"
        )


def remake(folder: Path, name: str, words: Sequence[str]) -> None:
    """Write the front of ``folder`` as the code at hand makes it."""
    run = load_results(folder)
    settings, problem, forest = run.settings, run.problem, run.forest
    for word in words:
        place, value = word.split("=")
        section, field = place.split(".")
        part = getattr(settings, section)
        setattr(part, field, type(getattr(part, field))(value))
    begun = time.process_time()
    front = make_front(Search(settings, problem, forest, Budget()))
    seconds = time.process_time() - begun
    paths = {f"x{k}": path.x for k, path in enumerate(front.paths)}
    np.savez(folder / f"{name}.npz", seconds=seconds, **paths)
    print(f"{folder.name:12} {name}: {len(paths)} paths, {seconds:.2f} CPU s", flush=True)


def front_paths(problem: Problem, file: Path) -> tuple[list[PlannedPath], float]:
    """The paths of a front, and the CPU seconds that it took."""
    with np.load(file) as data:
        number = len(data.files) - 1
        paths = [evaluate_path(problem, data[f"x{k}"], "", tight=False) for k in range(number)]
        return paths, float(data["seconds"])


def log_volume(rows: FloatArray, corner: FloatArray) -> float:
    """Hypervolume of (failure, length [m]) in logarithms, below failure 1 and the length of ``corner``."""
    return float(moocore.hypervolume(np.log(rows), ref=np.log(corner)))


def judged(
    mission: str, folders: Sequence[Path], names: Sequence[str], runs: int
) -> dict[str, tuple[float, float, float, float]]:
    """CPU seconds, mean and worst hypervolume, failure at equal length, by version; prints a line each."""
    problem = load_results(folders[0]).problem
    found = {
        (name, folder): front_paths(problem, folder / f"{name}.npz") for name in names for folder in folders
    }
    failed = which_fail(problem, [p for paths, _ in found.values() for p in paths], runs, JUDGING).mean(
        axis=1
    )
    rows, at = {}, 0
    for key, (paths, _) in found.items():
        lengths = [path.objectives.length for path in paths]
        rows[key] = np.column_stack([np.maximum(failed[at : at + len(paths)], LEAST), lengths])
        at += len(paths)
    union = np.concatenate(list(rows.values()))
    corner = np.array([1.0, BEYOND * union[:, 1].max()])
    whole = log_volume(union, corner)
    result = {}
    for name in names:
        cpu = [found[name, folder][1] for folder in folders]
        volumes = [log_volume(rows[name, folder], corner) / whole for folder in folders]
        ratios = [
            float(np.exp(np.log(ratios_at_equal_length(rows[name, f], rows[names[0], f])[0]).mean()))
            for f in folders
        ]
        least = [f"{100 * rows[name, f][:, 0].min():.3g}" for f in folders]
        print(
            f"{mission:8} {name:12} CPU {np.round(cpu, 1)} volume {np.round(volumes, 3)} ratio "
            f"{np.round(ratios, 3)} least {least} % paths {[len(rows[name, f]) for f in folders]}",
            flush=True,
        )
        result[name] = (np.mean(cpu), np.mean(volumes), min(volumes), np.exp(np.mean(np.log(ratios))))
    return result


if __name__ == "__main__":
    main()
