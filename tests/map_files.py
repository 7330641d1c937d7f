"""Helpers of the suites that read map files: small maps, and questions to a scene."""

from __future__ import annotations

import json
import zipfile

import numpy as np
import pytest
import shapely

from careful_io.messages import LONGEST_LINE
from map_samples import box
from pareto_ltl.settings import SceneConfig
from pareto_ltl.support.errors import DataError
from pareto_ltl.world.scene_settings import scene_from_settings

KML = '<?xml version="1.0"?><kml xmlns="http://www.opengis.net/kml/2.2"><Document>{}</Document></kml>'
START = "<Placemark><name>Start</name><Point><coordinates>10,60,0</coordinates></Point></Placemark>"


def kml_ring(west, south, east, north, tag="LinearRing"):
    corners = " ".join(f"{lon},{lat},0" for lon, lat in box(west, south, east, north))
    return f"<{tag}><coordinates>{corners}</coordinates></{tag}>"


def kml_polygon(*sides):
    return f"<Polygon><outerBoundaryIs>{kml_ring(*sides)}</outerBoundaryIs></Polygon>"


def folder(name, *places, more=""):
    inside = "".join(f"<Placemark><name>{title}</name>{shape}</Placemark>" for title, shape in places)
    return f"<Folder><name>{name}</name>{more}{inside}</Folder>"


GOAL = folder("Regions", ("a", kml_polygon(10.6, 60.1, 10.8, 60.2)))
WALL = folder("Obstacles", ("wall", kml_polygon(10.2, 59.95, 10.4, 60.3)))
IN_WALL, FREE = (10.3, 60.1), (10.5, 60.1)


def archive(path, **members):
    with zipfile.ZipFile(path, "w") as file:
        for name, content in members.items():
            file.writestr(name.replace("__", "/").replace("_kml", ".kml"), content)
    return path


def written(path, content):
    path.write_text(content if isinstance(content, str) else json.dumps(content), encoding="utf-8")
    return path


def feature(role, kind, coordinates, **properties):
    stated = {"role": role} if role else {}
    geometry = {"type": kind, "coordinates": coordinates}
    return {"type": "Feature", "properties": {**stated, **properties}, "geometry": geometry}


def collection(*features):
    return {"type": "FeatureCollection", "features": list(features)}


DRAWN = (
    feature("start", "Point", [10, 60]),
    feature("region", "Polygon", [box(10.6, 60.1, 10.8, 60.2)], name="a"),
)


def closed(scene, *places):
    area = shapely.union_all([shapely.Polygon(outline) for outline in scene.obstacles])
    points = scene.frame.to_plane(*np.array(places, float).T)
    return shapely.contains_xy(area, *points.T).tolist()


def refusal(path, **keys):
    with pytest.raises(DataError) as error:
        scene_from_settings(SceneConfig(file=str(path), **keys))
    text = str(error.value)
    assert "\n" not in text
    assert len(text) <= LONGEST_LINE
    return text.replace(str(path), "")
