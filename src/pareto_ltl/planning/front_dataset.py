"""A front as a dataset of xarray: numbers and positions of all its paths, with units."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pareto_ltl.planning.plan_files import front_table
from pareto_ltl.planning.records import Front
from pareto_ltl.support.arrays import FloatArray

if TYPE_CHECKING:
    import xarray as xr

# by the ends of the columns of front.csv
UNITS = {"_m": "m", "_s": "s", "_j": "J", "_deg": "degree", "_rad": "rad"}


def front_dataset(front: Front) -> xr.Dataset:
    """The columns of ``front.csv`` on (``path``), and positions and times on (``path``, ``step``).

    Paths with fewer steps than the longest have NaN after their end.
    """
    import xarray as xr

    (index, *columns), rows = front_table(front)
    values = zip(*rows, strict=True) if rows else [()] * (1 + len(columns))
    numbers, *others = (np.array(column) for column in values)
    variables: dict[str, Any] = {
        name: (index, column, _units(name)) for name, column in zip(columns, others, strict=True)
    }
    lines = {
        "t": ("s", [path.t for path in front.paths]),
        "x": ("m", [path.x[:, 0] for path in front.paths]),
        "y": ("m", [path.x[:, 1] for path in front.paths]),
    }
    variables |= {
        name: ((index, "step"), _padded(of_paths), {"units": unit})
        for name, (unit, of_paths) in lines.items()
    }
    about = {"law": front.models.law, "fidelity": front.models.label, "hypervolume": front.hypervolume}
    return xr.Dataset(variables, {index: numbers}, about)


def _units(column: str) -> dict[str, str]:
    return next(({"units": unit} for end, unit in UNITS.items() if column.endswith(end)), {})


def _padded(lines: list[FloatArray]) -> FloatArray:
    longest = max(map(len, lines), default=0)
    return np.array([np.pad(line, (0, longest - len(line)), constant_values=np.nan) for line in lines])
