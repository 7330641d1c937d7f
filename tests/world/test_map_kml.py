"""KML and KMZ maps: links, what is said not to be read, times of folders, closed lines, maps in archives."""

from __future__ import annotations

import io
import logging
import zipfile

import numpy as np
import pytest

import pareto_ltl
from map_files import (
    FREE,
    GOAL,
    IN_WALL,
    KML,
    START,
    WALL,
    archive,
    closed,
    folder,
    kml_polygon,
    kml_ring,
    refusal,
    written,
)
from pareto_ltl.settings import SceneConfig
from pareto_ltl.world.scene_settings import scene_from_settings
from pareto_ltl_apps.formats.map_formats import linked_files


def link(href, name="zones"):
    return f"<NetworkLink><name>{name}</name><Link><href>{href}</href></Link></NetworkLink>"


def test_links_inside_an_archive_and_beside_a_file_are_read(tmp_path):
    zones = KML.format(WALL)
    inside = archive(
        tmp_path / "m.kmz", doc_kml=KML.format(START + GOAL + link("files/zones.kml")), files__zones_kml=zones
    )
    assert closed(pareto_ltl.read_map(inside), IN_WALL, FREE) == [True, False]
    (tmp_path / "my zones.kml").write_text(zones)
    beside = written(tmp_path / "m.kml", KML.format(START + GOAL + link("my%20zones.kml#x")))
    assert closed(pareto_ltl.read_map(beside), IN_WALL, FREE) == [True, False]
    out = archive(tmp_path / "n.kmz", doc_kml=KML.format(START + GOAL + link("../my%20zones.kml")))
    assert closed(pareto_ltl.read_map(out), IN_WALL) == [True]
    packed = archive(tmp_path / "zones.kmz", doc_kml=zones)
    chained = written(tmp_path / "c.kml", KML.format(START + GOAL + link(packed.name)))
    assert closed(pareto_ltl.read_map(chained), IN_WALL) == [True]


def test_the_files_that_a_map_is_made_of_are_named_and_the_links_of_one_that_may_not_be_read_are_not(
    tmp_path,
):
    (tmp_path / "b.kml").write_text(KML.format(link("sub/c.kml")))
    (tmp_path / "sub").mkdir()
    archive(tmp_path / "sub" / "c.kml", doc_kml=KML.format(WALL))
    links = link("b.kml") + link("b.kml", "twice") + link("none.kml") + link("https://example.org/z.kml")
    path = written(tmp_path / "m.kml", KML.format(START + GOAL + links))
    inside = archive(tmp_path / "m.kmz", doc_kml=KML.format(START + GOAL + link("../b.kml") + link("z.kml")))
    both = (tmp_path / "b.kml", tmp_path / "sub" / "c.kml")
    assert linked_files(path) == linked_files(inside) == both
    assert linked_files(path, lambda other: other.name != "b.kml") == both[:1]
    assert linked_files(written(tmp_path / "m.geojson", "{}")) == linked_files(tmp_path / "none.kml") == ()


def test_a_folder_of_links_gives_its_role_to_what_they_hold(tmp_path):
    bare = KML.format(f"<Placemark><name>x</name>{kml_polygon(10.2, 59.95, 10.4, 60.3)}</Placemark>")
    (tmp_path / "zones.kml").write_text(bare)
    path = written(tmp_path / "m.kml", KML.format(START + GOAL + link("zones.kml", "No-fly zones")))
    assert closed(pareto_ltl.read_map(path), IN_WALL) == [True]


def test_links_in_a_circle_end(tmp_path):
    (tmp_path / "b.kml").write_text(KML.format(WALL + link("a.kml")))
    path = written(tmp_path / "a.kml", KML.format(START + GOAL + link("b.kml") + link("b.kml")))
    assert len(pareto_ltl.read_map(path).obstacles) == 1


@pytest.mark.parametrize("href", ["missing.kml", "../outside.kml", "/etc/passwd", "a%00b.kml"])
def test_a_link_to_a_file_that_is_not_there_is_refused(tmp_path, href):
    (tmp_path / "maps").mkdir()
    (tmp_path / "outside.kml").write_text(KML.format(WALL))
    path = written(tmp_path / "maps" / "m.kml", KML.format(START + GOAL + link(href)))
    assert "NetworkLink 'zones' links to" in refusal(path)


def test_a_link_of_the_file_system_leads_to_no_other_folder(tmp_path):
    (tmp_path / "maps").mkdir()
    (tmp_path / "secret.kml").write_text(KML.format(WALL))
    (tmp_path / "maps" / "zones.kml").symlink_to(tmp_path / "secret.kml")
    path = written(tmp_path / "maps" / "m.kml", KML.format(START + GOAL + link("zones.kml")))
    assert "which is not in the folder of the map" in refusal(path)


OVERLAY = "<GroundOverlay><name>chart</name><Icon><href>x.png</href></Icon></GroundOverlay>"
TRACK = (
    "<Placemark><name>cable</name><gx:Track xmlns:gx='g'><gx:coord>1 2 3</gx:coord></gx:Track></Placemark>"
)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (link("https://example.org/zones.kml"), "NetworkLink 'zones' to https://example.org/zones.kml"),
        (OVERLAY, "GroundOverlay 'chart'"),
        (f"<Folder><name>Obstacles</name>{TRACK}</Folder>", "the Track of Placemark 'cable'"),
        ("<Strange/>", "the element Strange"),
    ],
)
def test_what_may_be_an_obstacle_and_is_not_read_is_a_warning(tmp_path, caplog, content, words):
    path = written(tmp_path / "m.kml", KML.format(START + GOAL + content))
    with caplog.at_level(logging.INFO):
        pareto_ltl.read_map(path)
    (warning,) = [record for record in caplog.records if record.levelno == logging.WARNING]
    assert "not read, and it may be an obstacle" in warning.getMessage()
    assert words in warning.getMessage()


def test_one_line_lists_what_cannot_be_an_obstacle(tmp_path, caplog):
    high = kml_polygon(10.2, 59.95, 10.4, 60.3).replace(
        "<Polygon>", "<Polygon><altitudeMode>absolute</altitudeMode>"
    )
    label = f"<MultiGeometry><Point><coordinates>10.3,60.1</coordinates></Point>{high}</MultiGeometry>"
    content = START + GOAL + "<Style/><Style/><LookAt/>" + folder("Obstacles", ("R-44", label))
    with caplog.at_level(logging.INFO):
        scene = pareto_ltl.read_map(written(tmp_path / "m.kml", KML.format(content)))
    assert closed(scene, IN_WALL) == [True]
    (line,) = [record for record in caplog.records if "not read" in record.getMessage()]
    assert line.levelno == logging.INFO
    for words in (
        "Style (2 times)",
        "LookAt",
        "altitudes (altitudeMode absolute)",
        "a label point in obstacle R-44",
    ):
        assert words in line.getMessage()


def test_a_point_beside_an_area_may_be_a_tower(tmp_path, caplog):
    point = "<Point><coordinates>10.5,60.1</coordinates></Point>"
    far = f"<MultiGeometry>{point}{kml_polygon(10.2, 59.95, 10.4, 60.3)}"
    content = START + GOAL + folder("Obstacles", ("R-44", far + "</MultiGeometry>"))
    pareto_ltl.read_map(written(tmp_path / "m.kml", KML.format(content)))
    assert "a point outside of obstacle R-44: a tower needs the property buffer" in caplog.text


def test_a_time_span_of_a_folder_is_that_of_its_places(tmp_path):
    span = "<TimeSpan><begin>2026-01-01T06:00:00Z</begin><end>2026-01-01T09:00:00Z</end></TimeSpan>"
    own = "<TimeSpan><begin>1h</begin></TimeSpan>" + kml_polygon(10.45, 60.1, 10.5, 60.2)
    timed = folder("Obstacles", ("drill", kml_polygon(10.2, 59.95, 10.4, 60.3)), ("later", own), more=span)
    path = written(tmp_path / "m.kml", KML.format(START + GOAL + timed))
    scene = scene_from_settings(SceneConfig(file=str(path)), "2026-01-01T00:00:00Z")
    spans = {name: (window.begin, window.end) for name, window in scene.windows.items()}
    assert spans == {"obstacle_drill_3": (21600.0, 32400.0), "obstacle_later_4": (3600.0, np.inf)}
    assert set(scene.forbidden) == set(spans)


@pytest.mark.parametrize(
    "shape",
    [
        kml_ring(10.2, 59.95, 10.4, 60.3),
        kml_ring(10.2, 59.95, 10.4, 60.3, "LineString"),
        f"<MultiGeometry>{kml_ring(10.2, 59.95, 10.4, 60.3)}</MultiGeometry>",
    ],
)
def test_a_closed_line_is_an_area(tmp_path, shape):
    path = written(tmp_path / "m.kml", KML.format(START + GOAL + folder("Obstacles", ("x", shape))))
    assert closed(pareto_ltl.read_map(path), IN_WALL, FREE) == [True, False]


def test_an_open_line_still_needs_a_buffer(tmp_path):
    line = "<LineString><coordinates>10.2,60 10.3,60 10.3,60.1</coordinates></LineString>"
    path = written(tmp_path / "m.kml", KML.format(START + GOAL + folder("Obstacles", ("x", line))))
    assert "obstacle x is a LineString; expected a Polygon, or the property buffer" in refusal(path)


@pytest.mark.parametrize(
    "others",
    [
        {"files__legend_kml": KML.format("<Placemark><name>legend</name><Point/></Placemark>")},
        {"a_kml": KML.format("<Placemark><name>overlay</name></Placemark>"), "b_kml": "no XML"},
    ],
)
def test_the_map_of_an_archive_is_the_file_with_roles(tmp_path, caplog, others):
    path = archive(tmp_path / "m.kmz", **others, mission_kml=KML.format(START + GOAL))
    scene = pareto_ltl.read_map(path)
    assert (sorted(scene.regions), scene.obstacles) == (["a"], ())
    assert "in the archive, to which the map has no link" in caplog.text


def test_all_faults_of_a_map_are_in_one_message(tmp_path):
    path = written(
        tmp_path / "m.kml",
        KML.format(
            START + GOAL + link("missing.kml") + "<Placemark><name>x</name></Placemark>"
            + folder("Obstacles", ("line", "<LineString><coordinates>1,2 3,4</coordinates></LineString>"))
        ),
    )  # fmt: skip
    text = refusal(path)
    assert "has 3 faults" in text
    for words in ("missing.kml", "Placemark 'x' has no Point", "obstacle line is a LineString"):
        assert words in text


def test_an_archive_may_have_any_name(tmp_path):
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as file:
        file.writestr("doc.kml", KML.format(START + GOAL + WALL))
    (tmp_path / "map.zip").write_bytes(buffer.getvalue())
    assert closed(pareto_ltl.read_map(tmp_path / "map.zip"), IN_WALL) == [True]
