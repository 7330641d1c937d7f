"""GeoTIFF below a drawing: read with Pillow, placed with pyproj, drawn in the Mercator plane of the page."""

from __future__ import annotations

import base64
import io
import math
import warnings
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import DataError

if TYPE_CHECKING:
    from PIL.Image import Image

SUFFIXES = (".tif", ".tiff")
MAX_PIXELS = 100_000_000  # of a file
MAX_SIDE = 2048  # pixels of what the page gets
MAX_LATITUDE = 85.0  # of the Mercator plane of the page [deg]
EDGE_POINTS = 21  # on each edge of a file, to find its extent
CONTRAST = (2.0, 98.0)  # percentiles that become black and white in files of heights or depths
SCALE, TIES, MATRIX, KEYS, NO_DATA = 33550, 33922, 34264, 34735, 42113  # tags of TIFF files
RASTER_TYPE, GEOGRAPHIC, PROJECTED = 1025, 2048, 3072  # keys inside of KEYS
PIXEL_IS_POINT = 2
UNREADABLE = (OSError, ValueError, TypeError, KeyError, IndexError, SyntaxError)  # of Pillow, for bad files
NOT_PLACED = "it has no place on the Earth that can be read (an EPSG code, with a scale or a matrix)"


@lru_cache(maxsize=2)
def shown_image(path: Path) -> dict[str, Any]:
    """The image of a file: ``href`` (PNG as a data address) and ``box`` (west, south, east, north) [deg].

    Its rows are equally spaced in the Mercator plane. Pixels outside of the file, and those without data, are
    transparent. Files with one band of numbers, e.g. heights, become shades of grey.

    Raises
    ------
    DataError
        If the file is no TIFF, too large, or has no place on the Earth.
    """
    from PIL import Image

    try:
        # Pillow warns about tags that it cannot read.
        with warnings.catch_warnings(action="ignore"), Image.open(path, formats=["TIFF"]) as image:
            if image.width * image.height > MAX_PIXELS:
                raise DataError(f"{path.name} has more than {MAX_PIXELS:,} pixels: make it smaller")
            tags = dict(image.tag_v2)  # type: ignore[attr-defined]
            colours = _colours(image, tags.get(NO_DATA))
        return _placed(path.name, colours, _pixel_matrix(path.name, tags), _code(path.name, tags))
    except (*UNREADABLE, Image.DecompressionBombError) as error:
        raise DataError(f"{path.name}: the image cannot be read ({error}); give a GeoTIFF") from None


def _colours(image: Image, no_data: Any) -> NDArray[np.uint8]:
    """Red, green, blue and opacity of each pixel, (rows, columns, 4)."""
    if image.mode in ("1", "L", "LA", "P", "PA", "RGB", "RGBA", "CMYK", "YCbCr"):
        return np.asarray(image.convert("RGBA"))
    values = np.asarray(image, float)
    known = np.isfinite(values) & (values != (float(str(no_data).strip("\0 ")) if no_data else math.nan))
    low, high = np.percentile(values[known], CONTRAST) if known.any() else (0.0, 1.0)
    grey = np.clip((np.where(known, values, low) - low) / max(high - low, 1e-12), 0.0, 1.0) * 255.0
    return np.dstack([*[grey] * 3, np.where(known, 255.0, 0.0)]).astype(np.uint8)


def _pixel_matrix(name: str, tags: Mapping[int, Any]) -> FloatArray:
    """The matrix (2, 3) from column and row to the coordinates of the file."""
    if MATRIX in tags:
        matrix = np.array(tags[MATRIX], float).reshape(4, 4)[:2, [0, 1, 3]]
    elif SCALE in tags and TIES in tags:
        (dx, dy, *_), (column, row, _, x, y, *_) = tags[SCALE], tags[TIES]
        matrix = np.array([[dx, 0.0, x - column * dx], [0.0, -dy, y + row * dy]])
    else:
        raise DataError(f"{name}: {NOT_PLACED}")
    if _keys(tags).get(RASTER_TYPE) == PIXEL_IS_POINT:
        matrix[:, 2] -= matrix[:, :2] @ [0.5, 0.5]
    return matrix


def _keys(tags: Mapping[int, Any]) -> dict[int, int]:
    found = tags.get(KEYS, ())
    return {found[k]: found[k + 3] for k in range(4, len(found) - 3, 4) if found[k + 1] == 0}


def _code(name: str, tags: Mapping[int, Any]) -> int:
    """The EPSG code of the coordinates of the file."""
    keys = _keys(tags)
    code = keys.get(PROJECTED) or keys.get(GEOGRAPHIC)
    if code is None or code == 32767:
        raise DataError(f"{name}: {NOT_PLACED}")
    return int(code)


def _placed(name: str, colours: NDArray[np.uint8], matrix: FloatArray, code: int) -> dict[str, Any]:
    """The image in the Mercator plane; each of its pixels has the colour of the nearest one of the file."""
    from PIL import Image
    from pyproj import Transformer
    from pyproj.enums import TransformDirection
    from pyproj.exceptions import ProjError

    try:
        to_degrees = Transformer.from_crs(code, 4326, always_xy=True)
    except ProjError:
        raise DataError(f"{name}: EPSG:{code} is not known") from None
    rows, columns = colours.shape[:2]
    u, v = np.meshgrid(np.linspace(0, columns, EDGE_POINTS), np.linspace(0, rows, EDGE_POINTS))
    lon, lat = to_degrees.transform(*np.einsum("ij,jhw->ihw", matrix, np.array([u, v, np.ones_like(u)])))
    if not (np.isfinite(lon) & np.isfinite(lat)).all() or not np.ptp(lon) > 0.0 or not np.ptp(lat) > 0.0:
        raise DataError(f"{name}: {NOT_PLACED}")
    west, east = float(lon.min()), float(lon.max())
    south, north = (float(at) for at in np.clip((lat.min(), lat.max()), -MAX_LATITUDE, MAX_LATITUDE))
    x, y = _grid(west, south, east, north, min(MAX_SIDE, max(rows, columns)))
    place = np.array(to_degrees.transform(*np.meshgrid(x, y), direction=TransformDirection.INVERSE))
    back = np.linalg.inv(matrix[:, :2])
    column, row = np.floor(np.einsum("ij,jhw->ihw", back, place - matrix[:, 2, None, None]))
    held = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
    shown = np.zeros((*held.shape, 4), np.uint8)
    shown[held] = colours[row[held].astype(int), column[held].astype(int)]
    return {"href": png_address(Image.fromarray(shown)), "box": [west, south, east, north]}


def png_address(image: Image) -> str:
    """``image`` as a data address."""
    stream = io.BytesIO()
    image.save(stream, "PNG")
    return f"data:image/png;base64,{base64.b64encode(stream.getvalue()).decode()}"


def _grid(west: float, south: float, east: float, north: float, side: int) -> tuple[FloatArray, FloatArray]:
    """Longitudes, and latitudes from north to south [deg], of squares in the plane, ``side`` at most."""
    low, high = (math.asinh(math.tan(math.radians(at))) for at in (south, north))
    across = math.radians(east - west)
    scale = side / max(across, high - low)
    width, height = max(1, round(across * scale)), max(1, round((high - low) * scale))
    x = west + (np.arange(width) + 0.5) / width * (east - west)
    y = high - (np.arange(height) + 0.5) / height * (high - low)
    return x, np.degrees(np.arctan(np.sinh(y)))
