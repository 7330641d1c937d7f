"""PMTiles below a drawing: shapes and pixels lie where their tiles put them; bad files are one line."""

from __future__ import annotations

import base64
import gzip
import io
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mapbox_vector_tile import encode
from PIL import Image
from pmtiles.tile import Compression, TileType, zxy_to_tileid
from pmtiles.writer import Writer

from pareto_ltl.support.errors import DataError
from pareto_ltl_apps.desk.backdrop import LARGEST_TILE, backdrop, shown_tiles
from pareto_ltl_apps.desk.folder import MAPS, DeskFolder

EXTENT = 4096
Place = tuple[int, int, int]  # zoom, column, row


def archive(
    path: Path, tiles: Mapping[Place, bytes], kind: TileType = TileType.MVT,
    bounds: tuple[float, float, float, float] = (-180.0, -85.0, 180.0, 85.0),
    compression: Compression = Compression.GZIP,
) -> Path:  # fmt: skip
    with path.open("wb") as file:
        writer = Writer(file)
        for place in sorted(tiles, key=lambda at: zxy_to_tileid(*at)):
            content = tiles[place]
            packed = gzip.compress(content, mtime=0) if compression is Compression.GZIP else content
            writer.write_tile(zxy_to_tileid(*place), packed)
        names = ("min_lon_e7", "min_lat_e7", "max_lon_e7", "max_lat_e7")
        header = {name: round(1e7 * at) for name, at in zip(names, bounds, strict=True)}
        writer.finalize({"tile_type": kind, "tile_compression": compression, **header}, {})
    return path


def tile(*features: tuple[str, dict[str, Any]], layer: str = "land") -> bytes:
    """A vector tile of shapes in well-known text, y downwards."""
    rows = [{"geometry": text, "properties": told} for text, told in features]
    content: bytes = encode({"name": layer, "features": rows}, default_options={"y_coord_down": True})
    return content


def degrees(zoom: int, column: float, row: float) -> tuple[float, float]:
    """The place of a tile's corner, by the formula of the Mercator projection."""
    n = 2**zoom
    latitude = 2.0 * math.atan(math.exp(math.pi * (1.0 - 2.0 * row / n))) - math.pi / 2.0
    return column / n * 360.0 - 180.0, math.degrees(latitude)


def test_an_area_in_two_tiles_is_one_shape_without_their_edge(tmp_path: Path) -> None:
    low, high, lake = 1024, 3072, {"name": "Päijänne"}
    # Each tile draws a little beyond its edge, as tiles do.
    left = tile((f"POLYGON(({low} {low}, 4200 {low}, 4200 {high}, {low} {high}, {low} {low}))", lake))
    right = tile((f"POLYGON((-100 {low}, {high} {low}, {high} {high}, -100 {high}, -100 {low}))", lake))
    path = archive(tmp_path / "lakes.pmtiles", {(4, 3, 5): left, (4, 4, 5): right})
    found = shown_tiles(path)
    assert found["image"] is None
    (shape,) = found["shapes"]
    assert (shape["name"], shape["kind"]) == ("Päijänne", "area")
    (ring,) = shape["lines"]
    corners = [degrees(4, x, y) for x in (3.25, 4.75) for y in (5.25, 5.75)]
    assert np.array(ring).min(axis=0) == pytest.approx(np.min(corners, axis=0), abs=1e-5)
    assert np.array(ring).max(axis=0) == pytest.approx(np.max(corners, axis=0), abs=1e-5)
    seam = degrees(4, 4.0, 5.0)[0]
    edges = [degrees(4, 0, y)[1] for y in (5.25, 5.75)]
    for lon, lat in ring:
        assert abs(lon - seam) > 1e-6 or min(abs(lat - edge) for edge in edges) < 1e-5


def test_lines_and_points_keep_their_places_and_unlike_areas_are_not_joined(tmp_path: Path) -> None:
    square = "POLYGON((0 0, 1000 0, 1000 1000, 0 1000, 0 0))"
    content = tile(
        ("LINESTRING(0 2048, 4096 2048)", {}),
        ("POINT(2048 1024)", {"name": "EFKU"}),
        (square, {"kind": "wood"}),
        (square.replace("1000", "2000"), {"kind": "park"}),
    )
    found = shown_tiles(archive(tmp_path / "map.pmtiles", {(0, 0, 0): content}))["shapes"]
    assert sorted(shape["kind"] for shape in found) == ["area", "area", "line", "point"]
    (line,) = (shape["lines"][0] for shape in found if shape["kind"] == "line")
    assert sorted(line) == [pytest.approx([-180.0, 0.0]), pytest.approx([180.0, 0.0])]
    (point,) = (shape for shape in found if shape["kind"] == "point")
    assert point["name"] == "EFKU"
    assert point["lines"][0][0] == pytest.approx(degrees(0, 0.5, 0.25), abs=1e-5)


def test_the_closest_zoom_that_can_be_drawn_is_shown(tmp_path: Path) -> None:
    def square(side: int) -> bytes:
        return tile((f"POLYGON((0 0, {side} 0, {side} {side}, 0 {side}, 0 0))", {}))

    tiles = {(2, 1, 1): square(100), (6, 20, 20): square(200), (12, 1300, 1300): square(300)}
    shapes = shown_tiles(archive(tmp_path / "a.pmtiles", tiles))["shapes"]
    assert np.ptp(np.array(shapes[0]["lines"][0])[:, 0]) == pytest.approx(360 / 4 * 100 / EXTENT, rel=1e-3)
    small = (*degrees(6, 20.0, 21.0), *degrees(6, 21.0, 20.0))
    shapes = shown_tiles(archive(tmp_path / "b.pmtiles", tiles, bounds=small))["shapes"]
    assert np.ptp(np.array(shapes[0]["lines"][0])[:, 0]) == pytest.approx(360 / 64 * 200 / EXTENT, rel=1e-3)


@pytest.mark.parametrize(("kind", "form"), [(TileType.PNG, "PNG"), (TileType.WEBP, "WEBP")])
def test_images_are_put_together_as_their_tiles_lie(tmp_path: Path, kind: TileType, form: str) -> None:
    def plain(colour: tuple[int, int, int]) -> bytes:
        stream = io.BytesIO()
        Image.new("RGB", (256, 256), colour).save(stream, form)
        return stream.getvalue()

    west, north = degrees(5, 7, 11)
    east, south = degrees(5, 9, 12)
    inside = (west + 0.1, south + 0.1, east - 0.1, north - 0.1)
    tiles = {(5, 7, 11): plain((255, 0, 0)), (5, 8, 11): plain((0, 0, 255))}
    path = archive(tmp_path / "chart.pmtiles", tiles, kind, inside, Compression.NONE)
    found = shown_tiles(path)
    assert found["shapes"] == []
    assert found["image"]["box"] == pytest.approx([west, south, east, north])
    _, _, data = found["image"]["href"].partition(",")
    pixels = np.asarray(Image.open(io.BytesIO(base64.b64decode(data))).convert("RGB"))
    assert pixels.shape == (256, 512, 3)
    red, blue = pixels[100, 100].tolist(), pixels[100, 400].tolist()
    assert red == pytest.approx([255, 0, 0], abs=8)
    assert blue == pytest.approx([0, 0, 255], abs=8)


def test_the_desk_takes_tiles_below_the_drawing(tmp_path: Path) -> None:
    (tmp_path / MAPS).mkdir()
    archive(tmp_path / MAPS / "a.pmtiles", {(0, 0, 0): tile(("POINT(0 0)", {"name": "pole"}))})
    assert backdrop(DeskFolder(tmp_path), "a.pmtiles")["shapes"][0]["name"] == "pole"


@pytest.mark.parametrize("seed", range(40))
def test_damaged_files_are_one_line(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    path = archive(tmp_path / "map.pmtiles", {(1, 0, 0): tile(("POINT(5 5)", {})), (1, 1, 0): b"no tile"})
    content = bytearray(path.read_bytes())
    if seed % 2:
        content = content[: rng.integers(len(content))]
    else:
        for k in rng.integers(7, len(content), 5):
            content[k] = rng.integers(256)
    path.write_bytes(bytes(content))
    try:
        shown_tiles(path)
    except DataError as error:
        assert "map.pmtiles" in str(error)
        assert "\n" not in str(error)


def test_a_tile_that_unpacks_to_too_much_is_refused(tmp_path: Path) -> None:
    path = archive(tmp_path / "bomb.pmtiles", {(0, 0, 0): bytes(LARGEST_TILE + 1)})
    with pytest.raises(DataError, match=r"bomb\.pmtiles has a tile of more than"):
        shown_tiles(path)
