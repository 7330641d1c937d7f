"""GeoTIFF below a drawing: pixels lie where pyproj puts them; bad files are one line."""

from __future__ import annotations

import base64
import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from pyproj import Transformer

from geotiffs import UTM, WGS84, geotiff
from pareto_ltl.support.errors import DataError
from pareto_ltl_apps.desk.geotiff import shown_image


def shown(tmp_path: Path, content: bytes) -> tuple[Any, list[float]]:
    path = tmp_path / "map.tif"
    path.write_bytes(content)
    found = shown_image(path)
    head, _, data = found["href"].partition(",")
    assert head == "data:image/png;base64"
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(data)))), found["box"]


def place_of(mark: Any, box: list[float]) -> tuple[float, float]:
    """Longitude and latitude [deg] of the middle of the pixels of ``mark``, in the Mercator plane."""
    rows, columns = np.nonzero(mark)
    west, south, east, north = box
    low, high = (np.arcsinh(np.tan(np.radians(at))) for at in (south, north))
    across = west + (columns.mean() + 0.5) / mark.shape[1] * (east - west)
    up = high - (rows.mean() + 0.5) / mark.shape[0] * (high - low)
    return float(across), float(np.degrees(np.arctan(np.sinh(up))))


@pytest.mark.parametrize("options", [{}, {"compression": "tiff_lzw"}, {"compression": "tiff_deflate"}])
@pytest.mark.parametrize("point", [False, True])
def test_a_pixel_lies_where_the_projection_puts_it(
    tmp_path: Path, options: dict[str, str], point: bool
) -> None:
    values = np.zeros((300, 400, 3), np.uint8)
    values[220:223, 310:313] = (255, 0, 0)
    image, box = shown(
        tmp_path, geotiff(values, UTM, (200_000.0, 4_600_000.0), 500.0, None, point, **options)
    )
    half = 0.0 if point else 0.5
    to_degrees = Transformer.from_crs(f"EPSG:{UTM}", "EPSG:4326", always_xy=True)
    wanted = to_degrees.transform(200_000 + 500 * (311 + half), 4_600_000 - 500 * (221 + half))
    assert place_of((image[..., 0] == 255) & (image[..., 1] == 0), box) == pytest.approx(wanted, abs=0.003)
    assert image[0, 0, 3] == 0  # outside of the turned file


def test_heights_become_shades_and_gaps_are_transparent(tmp_path: Path) -> None:
    values = np.tile(np.linspace(-300.0, 900.0, 200, dtype=np.float32), (100, 1))
    values[:20, :20] = -9999.0
    image, box = shown(tmp_path, geotiff(values, WGS84, (-98.0, 42.0), 0.05, -9999.0))
    assert box == pytest.approx([-98.0, 37.0, -88.0, 42.0])
    assert image[2, 2, 3] == 0
    assert image[-2, 2, 3] == 255
    grey = image[image.shape[0] // 2, :, 0].astype(int)
    assert (np.diff(grey) >= 0).all()
    assert (grey[0], grey[-1]) == (0, 255)


PLAIN = np.zeros((4, 4), np.uint8)


@pytest.mark.parametrize(
    "content",
    [
        b"", b"II*\0", b"not an image", geotiff(PLAIN, None, (0.0, 0.0), 1.0),
        geotiff(PLAIN, 32767, (0.0, 0.0), 1.0), geotiff(PLAIN, 1, (0.0, 0.0), 1.0),
        geotiff(PLAIN, WGS84, (0.0, 0.0), 0.0), geotiff(PLAIN, WGS84, (0.0, 0.0), 1.0)[:60],
        geotiff(PLAIN, UTM, (1e12, 1e12), 1.0),
    ],
)  # fmt: skip
def test_what_is_no_geotiff_is_one_line(tmp_path: Path, content: bytes) -> None:
    with pytest.raises(DataError, match=r"map\.tif") as caught:
        shown(tmp_path, content)
    assert "\n" not in str(caught.value)
