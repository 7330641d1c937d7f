"""Type aliases of arrays, and a check of shapes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
Float32Array = NDArray[np.float32]
Int32Array = NDArray[np.int32]
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


def rotate_vectors(vectors: FloatArray, angle: FloatArray) -> FloatArray:
    """``vectors`` (N, 2) rotated counter-clockwise by ``angle`` (N,) [rad]."""
    cos, sin = np.cos(angle), np.sin(angle)
    x, y = vectors[..., 0], vectors[..., 1]
    return np.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)


def square_matrices(cov3: FloatArray) -> FloatArray:
    """Covariances (T+1, 2, 2) from rows (xx, xy, yy)."""
    return cov3[:, [0, 1, 1, 2]].reshape(-1, 2, 2)


def length_of(x: FloatArray) -> float:
    """Length of the line through ``x`` (N, 2), in the unit of ``x``."""
    return float(np.linalg.norm(np.diff(x, axis=0), axis=1).sum())
