"""Maps that the desk opens: what a plan would read, with roles; what a plan would refuse is refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from map_files import DRAWN, GOAL, KML, START, collection, feature
from map_samples import AREA, ED269, OPENAIR, box
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl_apps.desk.folder import DeskFolder
from pareto_ltl_apps.desk.missions import read_map

OVER_A = [box(10.5, 60, 10.7, 60.3)]


def opened(tmp_path: Path, name: str, content: Any, role: str = "") -> dict[str, Any]:
    text = content if isinstance(content, str) else json.dumps(content)
    return read_map(DeskFolder.opened(tmp_path), name, text.encode(), role)


def test_a_feature_without_a_role_gets_the_one_that_is_asked_for_and_keeps_its_own(tmp_path):
    plain = {
        "type": "Feature",
        "properties": {"name": "Røst"},
        "geometry": {"type": "Polygon", "coordinates": AREA},
    }
    for role in ("region", "obstacle"):
        (found,) = opened(tmp_path, "the text", plain, role)["features"]
        assert found["properties"]["role"] == role
    (found,) = opened(tmp_path, "the text", feature("landmark", "Polygon", AREA), "obstacle")["features"]
    assert found["properties"]["role"] == "landmark"
    with pytest.raises(ConfigError, match=r"scene\.roles must"):
        opened(tmp_path, "the text", plain, "harbour")


def test_airspace_comes_with_its_role_and_its_limits(tmp_path):
    found = opened(tmp_path, "zones.txt", OPENAIR)
    roles = {(one["properties"]["role"], one["properties"]["ceiling"]) for one in found["features"]}
    assert roles == {("obstacle", "762 m"), ("obstacle", "1981.2 m STD"), ("obstacle", "UNL")}
    assert "they are airspace (OpenAir), and so obstacles" in found["warnings"][0]
    (zone, _) = opened(tmp_path, "uas.json", ED269)["features"]
    assert zone["properties"]["restriction"] == "PROHIBITED"


def test_what_may_be_an_obstacle_and_was_not_read_is_said(tmp_path):
    far = "<NetworkLink><name>zones</name><Link><href>https://example.org/z.kml</href></Link></NetworkLink>"
    found = opened(tmp_path, "m.kml", KML.format(START + GOAL + far))
    assert "not read, and it may be an obstacle: NetworkLink 'zones'" in found["warnings"][0]


def test_lengths_with_units_come_in_metres(tmp_path):
    mast = feature("obstacle", "Point", [10.5, 60.1], radius="500 ft")
    (*_, found) = opened(tmp_path, "m.geojson", collection(*DRAWN, mast))["features"]
    assert found["properties"]["buffer"] == pytest.approx(152.4)


def test_a_mission_in_the_file_is_returned_and_metres_become_degrees(tmp_path):
    crs = {"type": "name", "properties": {"name": "EPSG:32632"}}
    content = collection(feature("start", "Point", [500_000, 6_651_411])) | {
        "crs": crs,
        "mission": {"name": "x"},
    }
    found = opened(tmp_path, "m.geojson", content)
    assert found["mission"] == {"name": "x"}
    assert found["features"][0]["geometry"]["coordinates"] == pytest.approx([9.0, 60.0], abs=1e-4)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (
            collection(*DRAWN, feature("obstacle", "Polygon", [box(10.5, 60, 10.7, 60.3)])),
            "overlaps region 'a'",
        ),
        (collection(feature("obstacle", "LineString", [[10, 60], [10.1, 60]])), "is a LineString"),
        (
            collection(*DRAWN, feature("obstacle", "Polygon", AREA, buffer="wide")),
            "expected a number of metres",
        ),
        (collection(*DRAWN, feature("obstacle", "Polygon", [[*AREA[0][:2], *AREA[0][3:1:-1]]])), "crosses"),
        (collection(*DRAWN, feature("", "Polygon", AREA)), "feature 3 has role None"),
        ({"type": "Topology"}, "is TopoJSON"),
    ],
)
def test_what_a_plan_would_refuse_is_refused_with_the_name_of_the_file(tmp_path, content, words):
    with pytest.raises(DataError) as error:
        opened(tmp_path, "drawn.geojson", content)
    assert words in str(error.value)
    assert str(error.value).startswith("scene file drawn.geojson")
