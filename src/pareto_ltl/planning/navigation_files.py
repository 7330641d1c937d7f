"""The navigation of a path in ``plan.json``, and numbers that are null where they are not finite."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from flight_quantities.frames import Navigation
from pareto_ltl.support.arrays import FloatArray


def read_navigation(content: Mapping[str, Any]) -> Navigation | None:
    """The navigation in ``content``; None in files of schema ``pareto_ltl.plan/1``."""
    if content.get("airspeed") is None:
        return None
    steps, times, columns = len(content["u"]), content["time_utc"], dict[str, FloatArray]()
    for key, size in (("airspeed", steps), ("lat", steps + 1), ("lon", steps + 1), ("heading_true", steps)):
        if content[key] is not None:
            columns[key] = np.array([number_or_nan(value) for value in content[key]], float)
            if len(columns[key]) != size:
                raise ValueError(f"{key} must have {size} entries, got {len(columns[key])}")
    return Navigation(**columns, time_utc=None if times is None else tuple(times), crs=content["crs"])


def number_or_nan(value: float | None) -> float:
    """The number, NaN for null."""
    return math.nan if value is None else float(value)
