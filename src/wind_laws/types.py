"""Type aliases of arrays, and a check of shapes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


def require_shape(name: str, array: NDArray[Any], *shape: int | None) -> None:
    """Raise ``ValueError`` if ``array`` does not have ``shape``, in which None allows any length."""
    wanted = (
        tuple(array.shape[i] if s is None else s for i, s in enumerate(shape))
        if array.ndim == len(shape)
        else shape
    )
    if array.shape != wanted:
        raise ValueError(f"{name} must have shape {shape}, got {array.shape}")
