"""Further paths that are judged with the paths of a run (``selection.extra_paths``), and their file.

The file is a ``front.npz``, of which only the positions are read, or one that :func:`write_extra_paths` made.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pareto_ltl.planning.evaluate import completing_path
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.records import PlannedPath
from pareto_ltl.run.file_shape import inside, shaped
from pareto_ltl.run.front_files import path_key
from pareto_ltl.support.archives import read_npz
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import InfeasibleError
from pareto_ltl.support.files import write_npz

LOG = logging.getLogger(__name__)
EXTRA_FILE = "extra_paths.npz"
ExtraPath = tuple[str, FloatArray]  # how it was made, and its positions (T+1, 2) [m]


def write_extra_paths(file: Path, paths: Sequence[ExtraPath]) -> None:
    """Write ``paths`` as ``path_000/x``, ``path_000/origin`` and so on."""
    arrays: dict[str, Any] = {}
    for number, (origin, x) in enumerate(paths):
        arrays |= {f"{path_key(number)}/x": x, f"{path_key(number)}/origin": np.array([origin], np.str_)}
    write_npz(file, arrays)


def read_extra_paths(place: Path | str) -> list[ExtraPath]:
    """The paths in a ``front.npz``, in the results directory that has one, or in an extra file.

    Raises
    ------
    DataError
        If the file cannot be read, or does not contain paths.
    """
    file = inside(Path(place).expanduser(), "front.npz")
    arrays = read_npz(file)
    with shaped(file, "paths of a front"):
        paths = []
        for number in range(sum(key.endswith("/x") for key in arrays)):
            key = path_key(number)
            x = np.ascontiguousarray(arrays[f"{key}/x"], float)
            if x.ndim != 2 or x.shape[1] != 2 or len(x) < 2 or not np.isfinite(x).all():
                raise ValueError(f"{key}/x must be finite positions of shape (T+1, 2), got {x.shape}")
            known = arrays.get(f"{key}/origin")
            paths.append((f"extra path {number}" if known is None else str(known.item()), x))
        return paths


def extra_paths(place: str | None, problem: Problem) -> tuple[PlannedPath, ...]:
    """The paths of the file ``place`` that can be flown in ``problem``; a WARNING names the others."""
    able = []
    for origin, x in [] if place is None else read_extra_paths(place):
        try:
            able.append(completing_path(problem, x, origin))
        except InfeasibleError as error:
            LOG.warning("%s of selection.extra_paths is left out: %s", origin, error)
    return tuple(able)
