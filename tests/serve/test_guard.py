"""What the desk refuses: other machines, other pages, and everything outside of its folder."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from desk import DirectClient
from pareto_ltl.serve.app import ROUTES, Operation, desk_app
from pareto_ltl.serve.folder import DeskFolder
from pareto_ltl.support.errors import ConfigError, DataError

TOKEN, PORT = "a-token-of-this-test", 8123
HERE = f"http://127.0.0.1:{PORT}"
BEARER = {"Authorization": f"Bearer {TOKEN}"}


@pytest.fixture
def client(tmp_path: Path) -> DirectClient:
    """A client of the application, without its worker."""
    return DirectClient(desk_app(DeskFolder.opened(tmp_path / "desk"), TOKEN, PORT), HERE)


@pytest.mark.parametrize("row", ROUTES, ids=lambda row: f"{row.method} {row.path}")
def test_every_operation_needs_the_token(client: DirectClient, row: Operation) -> None:
    path = re.sub(r"\{\w+\}", "20260101-000000-abcd", row.path)
    method = row.method
    assert client.request(method, path).status_code == 401
    assert client.request(method, path, headers={"Authorization": "Bearer wrong"}).status_code == 401
    assert client.request(method, f"{path}?token={TOKEN}").status_code == 401  # only the page has it there


def test_the_page_needs_the_token_of_its_address(client: DirectClient) -> None:
    assert client.get("/").status_code == 401
    assert client.get("/?token=wrong").status_code == 401
    answer = client.get(f"/?token={TOKEN}")
    assert answer.status_code == 200
    assert TOKEN not in answer.text


@pytest.mark.parametrize(
    ("header", "value", "status"),
    [
        ("host", "evil.example", 421),
        ("host", f"evil.example:{PORT}", 421),
        ("host", "127.0.0.1:9", 421),
        ("origin", "http://evil.example", 403),
        ("origin", "null", 403),
        ("origin", f"http://127.0.0.1:{PORT + 1}", 403),
        ("sec-fetch-site", "cross-site", 403),
        ("sec-fetch-site", "same-site", 403),
    ],
)
def test_requests_of_other_pages_and_hosts_are_refused(
    client: DirectClient, header: str, value: str, status: int
) -> None:
    for method, path in (("GET", "/api/plans"), ("POST", "/api/plans"), ("GET", f"/?token={TOKEN}")):
        assert client.request(method, path, headers={**BEARER, header: value}).status_code == status


def test_requests_of_the_page_itself_are_accepted(client: DirectClient) -> None:
    own = {**BEARER, "origin": HERE, "sec-fetch-site": "same-origin"}
    assert client.get("/api/plans", headers=own).json() == {"plans": []}


def test_a_form_of_another_site_cannot_start_a_plan(client: DirectClient) -> None:
    body = '{"overrides": ["+experiment=hop"]}'
    answer = client.post("/api/plans", content=body, headers={**BEARER, "content-type": "text/plain"})
    assert answer.status_code == 400
    assert "Content-Type" in answer.json()["error"]


@pytest.mark.parametrize("path", [f"/?token={TOKEN}", "/desk/main.js", "/api/plans", "/nothing"])
def test_every_answer_has_a_strict_policy(client: DirectClient, path: str) -> None:
    answer = client.get(path, headers=BEARER)
    policy = answer.headers["content-security-policy"]
    assert policy.startswith("default-src 'none'")
    assert "unsafe" not in policy
    assert answer.headers["x-content-type-options"] == "nosniff"
    assert answer.headers["referrer-policy"] == "no-referrer"
    assert "access-control-allow-origin" not in answer.headers


@pytest.mark.parametrize(
    "word",
    [
        "scene.file=/etc/passwd", "scene.file=../outside.geojson",
        "scene.file=maps/../../outside.geojson",
        "scene.file='../outside.geojson'", "wind.path=~/winds", "wind.path=[/etc/passwd]",
        "wind.path=link/file",
        "+experiment=../../outside", "hydra.run.dir=/tmp/elsewhere", "+hydra.run.dir=elsewhere",
        "hydra/launcher=joblib", "pipelines=compare", "pipelines.stages=[readings]", "--config-dir=/tmp",
        "-cd", "compare",
        "wind.base_url=http://evil.example", "mission.formula=${oc.env:HOME}", "name=../outside",
    ],
)  # fmt: skip
def test_settings_that_lead_out_of_the_folder_are_refused(
    client: DirectClient, tmp_path: Path, word: str
) -> None:
    (tmp_path / "desk" / "link").symlink_to(tmp_path)
    answer = client.post("/api/plans", json={"overrides": [word]}, headers=BEARER)
    assert answer.status_code == 400, answer.text
    assert "Traceback" not in answer.text


def test_settings_inside_the_folder_are_accepted(tmp_path: Path) -> None:
    folder = DeskFolder.opened(tmp_path)
    folder.check_words(
        ["+experiment=phi2", "scene.file=maps/a.geojson", "mission.start_time=2018-10-09T06:00:00Z"]
    )
    folder.check_words(["mission.formula='F(a & F[0,6h] b)'", "wind.path=winds/my.csv", "planner.trees=1"])


@pytest.mark.parametrize("name", ["..", "../outside", "20260101-000000-abcd/..", "a\0b", "", "%2e%2e"])
def test_no_name_of_a_plan_leads_out_of_the_folder(tmp_path: Path, name: str) -> None:
    with pytest.raises(DataError, match="there is no plan"):
        DeskFolder.opened(tmp_path).plan_place(name)


@pytest.mark.parametrize("name", ["../x.csv", "/etc/x.csv", "..", ".hidden", "a/b.csv", "", "x" * 200])
def test_no_name_of_a_wind_leads_out_of_the_folder(tmp_path: Path, name: str) -> None:
    with pytest.raises(DataError, match="is not a file name"):
        DeskFolder.opened(tmp_path).keep_wind(name, b"")


@pytest.mark.parametrize("text", ["../x", "/etc/passwd", "~root", "a\0b", "maps/../../x"])
def test_paths_outside_of_the_folder_are_refused(tmp_path: Path, text: str) -> None:
    with pytest.raises(ConfigError, match="outside of the folder"):
        DeskFolder.opened(tmp_path / "desk").inside(text)


def test_only_files_of_the_page_are_served(client: DirectClient) -> None:
    for name in ("..%2fapp.py", "%2e%2e/app.py", "app.py", "__init__.py", "..%2f..%2f__init__.py"):
        assert client.get(f"/desk/{name}").status_code in (401, 404)


def test_bodies_have_a_limit(client: DirectClient) -> None:
    headers = {**BEARER, "content-length": "99999999999"}
    assert client.post("/api/maps", content=b"x", headers=headers).status_code == 413


def test_any_geojson_or_kml_can_lie_under_the_drawing(client: DirectClient) -> None:
    line = {"type": "MultiLineString", "coordinates": [[[1, 2, 9], [3, 4, 9]], [[5, 6, 9], [7, 8, 9]]]}
    area = {
        "type": "Polygon",
        "coordinates": [[[0, 0], [4, 0], [4, 4], [0, 0]], [[1, 1], [2, 1], [2, 2], [1, 1]]],
    }
    features = [
        {"type": "Feature", "properties": {"name": "<b>Rhône</b>"}, "geometry": line},
        {
            "type": "Feature",
            "properties": None,
            "geometry": {"type": "GeometryCollection", "geometries": [area]},
        },
        {"type": "Feature", "properties": {}, "geometry": None},
    ]
    content = json.dumps({"type": "FeatureCollection", "features": features})
    kept = client.post("/api/backdrops?name=my map.json", content=content, headers=BEARER).json()
    assert [(shape["kind"], len(shape["lines"])) for shape in kept["shapes"]] == [
        ("line", 1), ("line", 1), ("area", 2),
    ]  # fmt: skip
    assert kept["shapes"][0] == {"name": "<b>Rhône</b>", "kind": "line", "lines": [[[1, 2], [3, 4]]]}
    again = client.get(f"/api/backdrops/{kept['name']}", headers=BEARER).json()
    assert again["shapes"] == kept["shapes"]
    place = "<kml><Placemark><name>A</name><Point><coordinates>7,47</coordinates></Point></Placemark></kml>"
    kml = client.post("/api/backdrops?name=a.kml", content=place, headers=BEARER).json()
    assert kml["shapes"] == [{"name": "A", "kind": "point", "lines": [[[7, 47]]]}]


@pytest.mark.parametrize(
    "content",
    [
        b"", b"{}", b"[]", b"null", b"\x89PNG", b'{"type": "Polygon"}',
        b'{"type": "Polygon", "coordinates": [[[1]]]}',
        b'{"type": "Point", "coordinates": [NaN, 1]}', b'{"type": "Point", "coordinates": [1e9, 1]}',
        b'{"type": "LineString", "coordinates": "x"}', b'{"features": [1, {"geometry": 3}]}',
    ],
)  # fmt: skip
@pytest.mark.parametrize("name", ["a.geojson", "a.kml", "a.kmz", "../../a.geojson"])
def test_what_is_no_map_cannot_lie_under_the_drawing(
    client: DirectClient, content: bytes, name: str, tmp_path: Path
) -> None:
    answer = client.post(f"/api/backdrops?name={name}", content=content, headers=BEARER)
    assert answer.status_code == 400, answer.text
    assert "\n" not in answer.json()["error"]
    assert [path for path in tmp_path.iterdir() if path.name != "desk"] == []


def test_names_stay_text(client: DirectClient) -> None:
    answer = client.get("/api/plans/<script>alert(1)", headers=BEARER)
    assert answer.headers["content-type"].startswith("application/json")
