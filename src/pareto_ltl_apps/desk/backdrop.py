"""A map of the user under the drawing: areas, lines and points, or an image.

Of PMTiles, the highest zoom that a page can draw, as shapes or as one image.
"""

from __future__ import annotations

import io
import math
import zlib
from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from careful_io.messages import shown_text, shown_value
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import DataError, NotFoundError
from pareto_ltl_apps.desk import geotiff
from pareto_ltl_apps.desk.folder import MAPS, DeskFolder
from pareto_ltl_apps.formats.map_file import MapFile
from pareto_ltl_apps.formats.map_formats import SUFFIXES, read_map_file

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

MAX_CORNERS = 200_000  # that a page draws within a frame or two
DIGITS = 5  # of a degree: 1 m
FORMS = {"Polygon": "area", "LineString": "line", "LinearRing": "line", "Point": "point"}
TILE_SUFFIXES = (".pmtiles",)


def keep_backdrop(folder: DeskFolder, name: str, content: bytes) -> dict[str, Any]:
    """Copy a file into the folder; :func:`backdrop` of it; DataError if it is empty."""
    suffix = Path(name).suffix.lower()
    known = (*SUFFIXES, *geotiff.SUFFIXES, *TILE_SUFFIXES)
    return backdrop(folder, Path(folder.keep_map(content, suffix if suffix in known else ".geojson")).name)


def backdrop(folder: DeskFolder, name: str) -> dict[str, Any]:
    """The file ``name`` in the folder of maps: ``name``, ``shapes`` [deg] and ``image`` (or None)."""
    path = folder.inside(f"{MAPS}/{Path(name).name}")
    if not path.is_file():
        raise NotFoundError(f"there is no map {shown_value(name)}")
    if path.suffix in geotiff.SUFFIXES:
        return {"name": name, "shapes": [], "image": geotiff.shown_image(path)}
    if path.suffix in TILE_SUFFIXES:
        return {"name": name, **shown_tiles(path)}
    return {"name": name, "shapes": _all_shapes(path, name), "image": None}


def _all_shapes(path: Path, name: str) -> list[dict[str, Any]]:
    """Name, kind (area, line, point) and lines [deg] of all shapes of a file."""
    read = read_map_file(path)
    features = read.features if isinstance(read, MapFile) else []
    shapes = [shape for feature in features for shape in _shapes(name, feature)]
    if not shapes:
        raise DataError(f"{name} has no areas, lines or points; give GeoJSON, KML, PMTiles or GeoTIFF")
    if (count := sum(len(line) for shape in shapes for line in shape["lines"])) > MAX_CORNERS:
        raise DataError(f"{name} has {count:,} corners, at most {MAX_CORNERS:,} are drawn: simplify it")
    return shapes


def _shapes(where: str, feature: Any) -> Iterator[dict[str, Any]]:
    from shapely import get_parts
    from shapely.errors import ShapelyError
    from shapely.geometry import shape

    given = feature.get("geometry") if isinstance(feature, dict) else None
    if given is None:
        return
    reported = feature.get("properties")
    title = reported.get("name") or reported.get("title") if isinstance(reported, dict) else None
    try:
        parts = [part for many in get_parts([shape(given)]) for part in get_parts([many])]
        for part in parts:
            found = [_degrees(line.coords) for line in _outlines(part) if not line.is_empty]
            if found:
                yield {"name": str(title or "")[:80], "kind": FORMS[part.geom_type], "lines": found}
    except (ShapelyError, ValueError, TypeError, KeyError, AttributeError, IndexError) as error:
        raise DataError(
            f"{where}: a geometry cannot be read ({shown_text(str(error))}); expected GeoJSON in degrees"
        ) from None


def _outlines(part: Any) -> list[Any]:
    """The lines of a shape: of an area, its outline and its holes."""
    return [part.exterior, *part.interiors] if part.geom_type == "Polygon" else [part]


def _degrees(corners: Any) -> list[list[float]]:
    places: NDArray[np.float64] = np.array(corners, float)[:, :2]
    if not np.isfinite(places).all() or (np.abs(places) > (360.0, 90.0)).any():
        raise ValueError("a longitude or latitude is out of range")
    return [[float(lon), float(lat)] for lon, lat in places.round(DIGITS)]


# --- PMTiles ---------------------------------------------------------------------------------

MAX_TILES = 256  # of a zoom of vector tiles that is read
MAX_SIDE = 8  # tiles along a side of an image: 2,048 pixels
LARGEST_TILE = 20_000_000  # bytes, unpacked
MAX_TILE_CORNERS = 150_000  # of a zoom of vector tiles
KINDS = ("kind", "class", "type")  # properties that distinguish areas of one layer


class Tiles(NamedTuple):
    """Square tiles of one zoom: columns ``west`` to ``east``, rows ``north`` to ``south``, both included."""

    zoom: int
    west: int
    north: int
    east: int
    south: int

    @property
    def size(self) -> tuple[int, int]:
        """Columns and rows."""
        return self.east - self.west + 1, self.south - self.north + 1

    def degrees(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Longitudes and latitudes (n, 2) [deg] of places in tiles from the world's north-west corner."""
        side = 2.0**self.zoom
        return np.column_stack(
            [360.0 * x / side - 180.0, np.degrees(np.arctan(np.sinh(math.pi * (1.0 - 2.0 * y / side))))]
        )


def shown_tiles(path: Path) -> dict[str, Any]:
    """``shapes`` [deg] of vector tiles, or the ``image`` of raster tiles, as for a backdrop.

    Raises
    ------
    DataError
        If the file is no PMTiles archive, or none of its tiles can be read.
    """
    from google.protobuf.message import DecodeError
    from pmtiles.reader import MemorySource, Reader
    from pmtiles.tile import Compression, MagicNumberNotFound, SpecVersionUnsupported, TileType
    from shapely.errors import GEOSException

    refused = (MagicNumberNotFound, SpecVersionUnsupported, DecodeError, GEOSException, zlib.error)
    wrong = (OSError, ValueError, TypeError, LookupError, AssertionError, EOFError, OverflowError)
    try:
        reader = Reader(MemorySource(path.read_bytes()))
        header = reader.header()
        archive = _Archive(path.name, reader, header["tile_compression"] == Compression.GZIP)
        if header["tile_compression"] not in (Compression.NONE, Compression.GZIP):
            raise DataError(f"{path.name}: tiles compressed by gzip or not at all are read, others are not")
        if header["tile_type"] == TileType.MVT:
            return {"shapes": archive.shapes(header), "image": None}
        return {"shapes": [], "image": archive.image(header)}
    except (*refused, *wrong) as error:
        raise DataError(f"{path.name}: the tiles cannot be read ({error}); give PMTiles, version 3") from None


class _Archive(NamedTuple):
    name: str
    reader: Any
    packed: bool

    def shapes(self, header: dict[str, Any]) -> list[dict[str, Any]]:
        """Shapes of the closest zoom that a page can draw."""
        for tiles in _zooms(header, lambda size: size[0] * size[1] <= MAX_TILES):
            found = self._shapes_of(tiles)
            if found and sum(len(line) for one in found for line in one["lines"]) <= MAX_TILE_CORNERS:
                return found
        raise DataError(
            f"{self.name} has no zoom with at most {MAX_TILES} tiles and {MAX_TILE_CORNERS:,} corners: "
            "extract a part of it"
        )

    def _shapes_of(self, tiles: Tiles) -> list[dict[str, Any]]:
        """Areas, lines and points; shapes of one name, number or kind are joined across tiles."""
        from mapbox_vector_tile import decode
        from shapely import get_parts, make_valid
        from shapely.geometry import shape

        found: dict[tuple[str, ...], list[BaseGeometry]] = defaultdict(list)
        for column, row, content in self._contents(tiles):
            for layer, part in decode(content, default_options={"y_coord_down": True}).items():
                side = float(part["extent"])
                for feature in part["features"]:
                    for one in get_parts([make_valid(shape(feature["geometry"]))]):
                        key = (layer, *_identity(feature), one.geom_type)
                        found[key] += [_moved(inside, side, column, row) for inside in _inside(one, side)]
        return [one for key, parts in found.items() for one in _joined(tiles, key, parts)]

    def image(self, header: dict[str, Any]) -> dict[str, Any]:
        """The tiles of the closest zoom that fits, as one image."""
        from PIL import Image

        for tiles in _zooms(header, lambda size: max(size) <= MAX_SIDE):
            drawn = {
                (column, row): Image.open(io.BytesIO(content), formats=["PNG", "JPEG", "WEBP"])
                for column, row, content in self._contents(tiles)
            }
            if not drawn:
                continue
            side = min(max(one.width for one in drawn.values()), 512)
            whole = Image.new("RGBA", (side * tiles.size[0], side * tiles.size[1]))
            for (column, row), one in drawn.items():
                place = side * (column - tiles.west), side * (row - tiles.north)
                whole.paste(one.convert("RGBA").resize((side, side)), place)
            ends = np.array([[tiles.west, tiles.east + 1.0], [tiles.south + 1.0, tiles.north]])
            (west, south), (east, north) = tiles.degrees(*ends).tolist()
            return {"href": geotiff.png_address(whole), "box": [west, south, east, north]}
        raise DataError(f"{self.name} has no tile in the area that it names")

    def _contents(self, tiles: Tiles) -> Iterator[tuple[int, int, bytes]]:
        for column in range(tiles.west, tiles.east + 1):
            for row in range(tiles.north, tiles.south + 1):
                content = self.reader.get(tiles.zoom, column, row)
                if content:
                    yield column, row, self._unpacked(content)

    def _unpacked(self, content: bytes) -> bytes:
        if not self.packed:
            return content
        unpacking = zlib.decompressobj(zlib.MAX_WBITS | 16)
        unpacked = unpacking.decompress(content, LARGEST_TILE)
        if unpacking.unconsumed_tail:
            raise DataError(f"{self.name} has a tile of more than {LARGEST_TILE:,} bytes")
        return unpacked


def _zooms(header: dict[str, Any], fits: Callable[[tuple[int, int]], bool]) -> Iterator[Tiles]:
    """The tiles of each zoom with few enough of them, the closest first."""
    for zoom in range(min(header["max_zoom"], 24), header["min_zoom"] - 1, -1):
        side = 1 << zoom
        west, south, east, north = (
            header[key] / 1e7 for key in ("min_lon_e7", "min_lat_e7", "max_lon_e7", "max_lat_e7")
        )
        x = [side * (lon + 180.0) / 360.0 for lon in (west, east)]
        y = [
            side * (0.5 - math.asinh(math.tan(math.radians(lat))) / (2.0 * math.pi)) for lat in (north, south)
        ]
        (left, right), (top, bottom) = ([min(max(int(at), 0), side - 1) for at in ends] for ends in (x, y))
        tiles = Tiles(zoom, left, top, right, bottom)
        if min(tiles.size) > 0 and fits(tiles.size):
            yield tiles


def _identity(feature: dict[str, Any]) -> tuple[str, ...]:
    """What parts of one thing in several tiles have in common: name, number and kind."""
    reported = feature["properties"]
    kind = next((reported[key] for key in KINDS if key in reported), "")
    return str(reported.get("name") or ""), str(feature.get("id") or ""), str(kind)


def _inside(one: BaseGeometry, side: float) -> list[BaseGeometry]:
    """What ``one`` has inside of its tile, which tiles exceed by a little."""
    from shapely import clip_by_rect, get_coordinates, get_parts

    if one.geom_type == "Point":
        at = get_coordinates(one)
        return [one] if ((at >= 0.0) & (at < side)).all() else []
    return [part for part in get_parts([clip_by_rect(one, 0.0, 0.0, side, side)]) if not part.is_empty]


def _moved(one: BaseGeometry, side: float, column: int, row: int) -> BaseGeometry:
    """``one`` in tiles from the north-west corner of the world instead of units of its tile."""
    from shapely import transform

    return transform(one, lambda at: at / side + (column, row))


def _joined(tiles: Tiles, key: tuple[str, ...], parts: list[BaseGeometry]) -> Iterator[dict[str, Any]]:
    """Shapes of one thing in degrees, its areas without the edges of tiles."""
    from shapely import get_coordinates, get_parts, line_merge, union_all

    _, name, _, _, form = key
    whole = union_all(parts)
    for one in get_parts([line_merge(whole) if form == "LineString" else whole]):
        kind = FORMS.get(one.geom_type)
        if kind is not None:
            lines = [tiles.degrees(*get_coordinates(line).T).round(6).tolist() for line in _outlines(one)]
            yield {"name": name[:80], "kind": kind, "lines": lines}
