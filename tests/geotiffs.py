"""GeoTIFF files for tests, written with Pillow."""

from __future__ import annotations

import io
from typing import Any

from PIL import Image, TiffImagePlugin

UTM, WGS84 = 32615, 4326


def geotiff(
    values: Any, code: int | None, origin: tuple[float, float], pixel: float,
    no_data: float | None = None, point: bool = False, **options: Any,
) -> bytes:  # fmt: skip
    """A GeoTIFF whose north-west corner (its first pixel, with ``point``) lies at ``origin``."""
    tags = TiffImagePlugin.ImageFileDirectory_v2()
    tags.tagtype |= {33550: 12, 33922: 12, 34735: 3, 42113: 2}
    tags[33550] = (pixel, pixel, 0.0)
    tags[33922] = (0.0, 0.0, 0.0, *origin, 0.0)
    if code is not None:
        key = 2048 if code == WGS84 else 3072
        tags[34735] = (1, 1, 0, 2, 1025, 0, 1, 2 if point else 1, key, 0, 1, code)
    if no_data is not None:
        tags[42113] = str(no_data)
    stream = io.BytesIO()
    Image.fromarray(values).save(stream, "TIFF", tiffinfo=tags, **options)
    return stream.getvalue()
