"""Digests and numbers of reference runs, kept in ``golden.json`` and checked by ``test_golden.py``.

After a change that is meant to change results, write the file again and give the reason in the commit:

    python tests/golden.py
"""

from __future__ import annotations

import csv
import hashlib
import json
import os
import platform
import subprocess
import sys
import tempfile
import zlib
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

KEPT = Path(__file__).with_name("golden.json")
CASES = [(mission, seed) for mission in ("phi1", "phi2") for seed in (0, 1, 2)]
FILES = ("plan.json", "front.csv", "trees.npz")
COLUMNS = ("length_m", "mission_risk_paper", "mission_risk", "collision_risk", "mission_risk_ordered")
LIBRARIES = (
    "numpy",
    "scipy",
    "numba",
    "cvxpy-base",
    "clarabel",
    "moocore",
    "pyproj",
    "scikit-learn",
    "shapely",
)


def fingerprint() -> dict[str, str]:
    """Properties that affect the last bit of a result: processor, mathematics library, versions."""
    import llvmlite.binding as llvm

    machine = {
        "machine": platform.machine(),
        "processor": llvm.get_host_cpu_name(),  # kernels are compiled for it, BLAS chooses by it
        "cores": str(os.cpu_count()),
        "libm": " ".join(platform.libc_ver()),
        "python": platform.python_version(),
        "zlib": zlib.ZLIB_RUNTIME_VERSION,
    }
    return machine | {name: version(name) for name in LIBRARIES}


def run_case(mission: str, seed: int, folder: Path) -> Path:
    """Plan one mission with ``fidelity=paper`` through the command line; the results directory."""
    directory = folder / f"{mission}_{seed}"
    command = [
        sys.executable, "-m", "pareto_ltl", f"+experiment={mission}", f"seed={seed}", "fidelity=paper",
        "report=none", "deployment.runs=2", f"hydra.run.dir={directory}",
    ]  # fmt: skip
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise RuntimeError(f"{' '.join(command)} ended with {done.returncode}: {done.stderr}")
    return directory


def digests(directory: Path) -> dict[str, str]:
    """SHA-256 of each of :data:`FILES`."""
    return {name: hashlib.sha256((directory / name).read_bytes()).hexdigest() for name in FILES}


def numbers(directory: Path) -> dict[str, list[float]]:
    """Costs of the front, and sums over the plan and the trees, for machines that round differently."""
    rows = list(csv.DictReader((directory / "front.csv").read_text().splitlines()))
    plan = json.loads((directory / "plan.json").read_text())
    with np.load(directory / "trees.npz") as trees:
        names = sorted(key for key in trees.files if key.endswith("/x"))
        positions = [float(np.sum(trees[key])) for key in names]
        sizes = [float(len(trees[key])) for key in names]
        accepted = [float(len(trees["accepted"]))]
    found = {name: [float(row[name]) for row in rows] for name in COLUMNS}
    found |= {"plan_x": [float(np.sum(plan["x"]))], "plan_cov": [float(np.sum(plan["cov"]))]}
    found |= {"plan_u": [float(np.abs(plan["u"]).sum())]}
    return found | {"trees_x": positions, "trees_size": sizes, "accepted": accepted}


def reference() -> Mapping[str, Any]:
    """Content of ``golden.json``: the fingerprint of its machine, and each case's digests and numbers."""
    kept: Mapping[str, Any] = json.loads(KEPT.read_text())
    return kept


def main() -> None:
    """Run all cases and write ``golden.json``."""
    cases = {}
    with tempfile.TemporaryDirectory() as folder:
        for mission, seed in CASES:
            directory = run_case(mission, seed, Path(folder))
            cases[f"{mission}_{seed}"] = {"digests": digests(directory), "numbers": numbers(directory)}
            print(f"{mission} seed {seed}: {cases[f'{mission}_{seed}']['digests']['plan.json']}")
    KEPT.write_text(json.dumps({"fingerprint": fingerprint(), "cases": cases}, indent=1) + "\n")


if __name__ == "__main__":
    main()
