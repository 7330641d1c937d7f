"""Colours as seen by people without one kind of cone cells, and the distances between these colours.

The matrices are taken from Machado, Oliveira and Fernandes (doi:10.1109/TVCG.2009.113) for severity 1,
applied to linear RGB; distances are Euclidean in CIELAB under D65.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import Any

import numpy as np
from matplotlib.colors import to_rgb
from numpy.typing import NDArray

Array = NDArray[np.float64]

VISIONS: dict[str, Array] = {
    "normal": np.eye(3),
    "protanopia": np.array(
        [
            [0.152286, 1.052583, -0.204868],
            [0.114503, 0.786281, 0.099216],
            [-0.003882, -0.048116, 1.051998],
        ]
    ),
    "deuteranopia": np.array(
        [
            [0.367322, 0.860646, -0.227968],
            [0.280085, 0.672501, 0.047413],
            [-0.011820, 0.042940, 0.968881],
        ]
    ),
}
TO_XYZ = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
)
WHITE = TO_XYZ.sum(axis=1)


def lab(colours: Any, vision: str = "normal") -> Array:
    """CIELAB (n, 3) of sRGB colours (n, 3) as somebody with ``vision`` sees them."""
    rgb = np.asarray(colours, float)
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    xyz = np.clip(linear @ VISIONS[vision].T, 0.0, 1.0) @ TO_XYZ.T / WHITE
    f = np.where(xyz > (6 / 29) ** 3, np.cbrt(xyz), xyz / (3 * (6 / 29) ** 2) + 4 / 29)
    return np.column_stack([116 * f[:, 1] - 16, 500 * (f[:, 0] - f[:, 1]), 200 * (f[:, 1] - f[:, 2])])


def least_distance(colours: Sequence[Any], vision: str) -> float:
    """Smallest distance between two of ``colours``; 2.3 is just noticeable side by side."""
    seen = lab([to_rgb(colour) for colour in colours], vision)
    return min(float(np.linalg.norm(one - other)) for one, other in combinations(seen, 2))
