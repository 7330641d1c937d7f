"""KML maps are the GeoJSON maps with the same features."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path

import pytest

from pareto_ltl.settings import SceneConfig
from pareto_ltl.support.errors import DataError
from pareto_ltl.world.scene import Scene
from pareto_ltl.world.scene_files import scene_to_dict
from pareto_ltl.world.scene_settings import scene_from_settings

RING = "5.2,60.2,0 5.4,60.2,0 5.4,60.4,0 5.2,60.4,0 5.2,60.2,0"
HOLE = "5.28,60.28 5.32,60.28 5.32,60.32 5.28,60.32 5.28,60.28"
PLACES = f"""
<Document><name>fjord</name>
 <Placemark><name>Start</name><Point><coordinates>5.0,60.0</coordinates></Point></Placemark>
 <Folder><name>Regions</name>
  <Placemark><name>a</name><TimeSpan><begin>2018-10-09T01:00:00Z</begin><end>2018-10-09T07:00:00Z</end></TimeSpan>
   <MultiGeometry><Polygon><outerBoundaryIs><LinearRing><coordinates>{RING}</coordinates></LinearRing>
   </outerBoundaryIs><innerBoundaryIs><LinearRing><coordinates>{HOLE}</coordinates></LinearRing></innerBoundaryIs>
   </Polygon></MultiGeometry></Placemark>
 </Folder>
 <Folder><name>no-fly</name><Folder><name>obstacle</name>
  <Placemark><name>mast</name><ExtendedData><Data name="buffer"><value>300</value></Data></ExtendedData>
   <Point><coordinates>5.1,60.3,0</coordinates></Point></Placemark>
  <Placemark><name>cable</name><ExtendedData>
   <SchemaData><SimpleData name="Buffer">100</SimpleData></SchemaData></ExtendedData>
   <LineString><coordinates>5.1,60.35 5.15,60.4</coordinates></LineString></Placemark>
 </Folder></Folder>
 <Placemark><name>light</name><ExtendedData><Data name="role"><value>landmark</value></Data></ExtendedData>
   <Polygon><outerBoundaryIs><LinearRing><coordinates>5.1,60.1 5.15,60.1 5.15,60.15</coordinates></LinearRing>
   </outerBoundaryIs></Polygon></Placemark>
</Document>"""


def document(inside: str, head: str = '<?xml version="1.0" encoding="UTF-8"?>') -> str:
    return f'{head}<kml xmlns="http://www.opengis.net/kml/2.2">{inside}</kml>'


def corners(text: str) -> list[list[float]]:
    return [[float(v) for v in corner.split(",")[:2]] for corner in text.split()]


def feature(role: str, kind: str, coordinates: object, **properties: object) -> dict[str, object]:
    shape = {"type": kind, "coordinates": coordinates}
    return {"type": "Feature", "properties": {"role": role, **properties}, "geometry": shape}


SAME = [
    feature("start", "Point", [5.0, 60.0]),
    feature("region", "Polygon", [corners(RING), corners(HOLE)], name="a",
            **{"from": "2018-10-09T01:00:00Z", "until": "2018-10-09T07:00:00Z"}),
    feature("obstacle", "Point", [5.1, 60.3], name="mast", buffer=300),
    feature("obstacle", "LineString", corners("5.1,60.35 5.15,60.4"), name="cable", buffer=100),
    feature("landmark", "Polygon", [corners("5.1,60.1 5.15,60.1 5.15,60.15")], name="light"),
]  # fmt: skip


def scene_of(path: Path, content: str | bytes) -> Scene:
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return scene_from_settings(SceneConfig(file=str(path)), "2018-10-09T00:00:00Z")


def test_a_kml_map_is_the_geojson_map_with_the_same_features(tmp_path: Path) -> None:
    other = scene_of(tmp_path / "m.json", json.dumps({"type": "FeatureCollection", "features": SAME}))
    found = scene_of(tmp_path / "m.kml", document(PLACES))
    assert scene_to_dict(found) == scene_to_dict(other)
    assert found.windows["a"].end == 25_200.0
    prefixed = document(PLACES).replace("<", "<k:").replace("<k:/", "</k:").replace("<k:?", "<?")
    prefixed = prefixed.replace("xmlns=", "xmlns:k=")
    assert scene_to_dict(scene_of(tmp_path / "p.kml", prefixed)) == scene_to_dict(other)
    utf16 = document(PLACES, '<?xml version="1.0" encoding="UTF-16"?>').encode("utf-16")
    assert scene_to_dict(scene_of(tmp_path / "u.KML", utf16)) == scene_to_dict(other)


def test_a_kmz_archive_holds_a_kml_map(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "m.kmz", "w") as archive:
        archive.writestr("files/icon.png", b"")
        archive.writestr("doc.kml", document(PLACES))
    scene = scene_from_settings(SceneConfig(file=str(tmp_path / "m.kmz")), "2018-10-09T00:00:00Z")
    assert set(scene.regions) == {"a"}


BOMB = '<!DOCTYPE kml [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>'
POINT = "<Point><coordinates>5,60</coordinates></Point>"


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (document(PLACES, BOMB), "has a document type (DOCTYPE), which no map needs"),
        (document(PLACES, BOMB).encode("utf-16"), "has a document type (DOCTYPE)"),
        ("", "is not XML as KML is written (no element found"),
        (document(PLACES)[:-9], "is not XML as KML is written"),
        ("<gpx/>", "is a GPX file, which has no areas; convert it with ogr2ogr"),
        ("<svg/>", "has the root element 'svg'; expected kml"),
        (document(""), "has no features"),
        (document("<Folder>" * 100 + "</Folder>" * 100), "nested too deeply"),
        (document(f"<Placemark><name>home</name>{POINT}</Placemark>"), "'home' has no role; put it into"),
        (document("<Placemark><name>start</name></Placemark>"), "Placemark 'start' has no Point, LineString"),
        (
            document("<Placemark><name>start</name><Point><coordinates>a,b</coordinates></Point></Placemark>"),
            "its coordinates are no numbers",
        ),
        (document("<Placemark><name>start</name><Point/></Placemark>"), "has no start"),
        (document(f"<Folder><name>Landmarks</name><Placemark>{POINT}</Placemark></Folder>"), "is a Point"),
        ('<?xml version="1.0" encoding="klingon"?><kml/>', "is not XML as KML is written"),
    ],
)  # fmt: skip
def test_a_bad_kml_map_is_refused_in_one_line(tmp_path: Path, content: str | bytes, words: str) -> None:
    with pytest.raises(DataError) as error:
        scene_of(tmp_path / "m.kml", content)
    assert words in str(error.value)
    assert "\n" not in str(error.value)


def test_an_archive_without_a_map_is_refused(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "m.kmz", "w") as archive:
        archive.writestr("readme.txt", b"")
    for content, words in ((None, "there is no KML file in it"), (b"PK", "not a KMZ archive")):
        if content is not None:
            (tmp_path / "m.kmz").write_bytes(content)
        with pytest.raises(DataError, match=words):
            scene_from_settings(SceneConfig(file=str(tmp_path / "m.kmz")))


def test_one_message_names_all_faults_of_a_kml_map(tmp_path: Path) -> None:
    lost = "<Placemark><name>lost</name><Point><coordinates>5,60</coordinates></Point></Placemark>"
    flat = "<Placemark><name>Border</name><Point><coordinates>5,60</coordinates></Point></Placemark>"
    with pytest.raises(DataError) as error:
        scene_of(tmp_path / "map.kml", document(PLACES + lost + flat))
    text = str(error.value)
    assert "map.kml has 2 faults: (1) Placemark 'lost' has no role" in text
    assert "(2) " in text.partition("lost")[2]
    assert "border" in text.partition("(2) ")[2]


@pytest.mark.parametrize("tag", ["Placemark", "kml:Placemark"])
def test_too_many_placemarks_are_refused_before_they_are_parsed(tmp_path: Path, tag: str) -> None:
    path = tmp_path / "many.kml"
    path.write_text(f"<kml:kml>{f'<{tag}></{tag}>' * 50_001}, which is no XML")
    with pytest.raises(DataError, match=r"has more than 50,000 features"):
        scene_from_settings(SceneConfig(file=str(path)), None)
