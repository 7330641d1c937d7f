"""What the desk refuses: other machines, other pages, and everything outside of its folder."""

from __future__ import annotations

import json
import re
from pathlib import Path

import httpx
import pytest

from desk import DirectClient
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl_apps.desk.app import ROUTES, Operation, desk_app
from pareto_ltl_apps.desk.backdrop import backdrop
from pareto_ltl_apps.desk.folder import DeskFolder
from pareto_ltl_apps.desk.server import SINGLE

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
    assert client.get("/", headers=BEARER).status_code == 200
    answer = client.get(f"/?token={TOKEN}")
    assert (answer.status_code, answer.headers["location"]) == (303, "/")
    assert TOKEN not in answer.text + answer.headers["set-cookie"]


def cookie_of(answer: httpx.Response) -> dict[str, str]:
    """The header with the cookie of an answer, which must be one of the strict kind."""
    value, *attributes = answer.headers["set-cookie"].split("; ")
    assert set(attributes) == {"Path=/", "HttpOnly", "SameSite=Strict"}
    return {"cookie": value}


def test_a_browser_gets_a_cookie_and_a_clean_address(client: DirectClient) -> None:
    cookie = cookie_of(client.get(f"/?token={TOKEN}"))
    assert client.get("/", headers=cookie).status_code == 200
    again = client.get(f"/?token={TOKEN}", headers=cookie)  # the token leaves the address
    assert (again.status_code, again.headers["location"]) == (303, "/")
    assert "set-cookie" not in again.headers
    assert client.get("/api/plans", headers=cookie).json() == {"plans": []}
    other = {"cookie": cookie["cookie"].replace(str(PORT), str(PORT + 1))}
    assert client.get("/api/plans", headers=other).status_code == 401
    assert client.get("/api/plans", headers={"cookie": cookie["cookie"][:-1]}).status_code == 401
    assert client.get("/api/plans", headers={**cookie, "authorization": "Bearer wrong"}).status_code == 401


def test_a_cookie_changes_nothing_unless_the_page_says_so(client: DirectClient) -> None:
    cookie = cookie_of(client.get(f"/?token={TOKEN}"))
    body = {"overrides": ["planner.trees=wrong"]}
    assert client.post("/api/plans", json=body, headers=cookie).status_code == 401
    for origin, status in ((HERE, 400), ("null", 403), ("http://evil.example", 403)):
        answer = client.post("/api/plans", json=body, headers={**cookie, "origin": origin})
        assert answer.status_code == status
    same_site = {**cookie, "origin": HERE, "sec-fetch-site": "same-site"}  # another port of this machine
    assert client.post("/api/plans", json=body, headers=same_site).status_code == 403


def test_the_address_of_the_browser_works_once(client: DirectClient) -> None:
    once = client.app.sessions.one_time()
    assert once not in (TOKEN, "")
    assert client.get("/api/plans", headers={"Authorization": f"Bearer {once}"}).status_code == 401
    assert client.request("HEAD", f"/?token={once}").status_code == 401  # it is not used up
    first = client.get(f"/?token={once}")
    cookie = cookie_of(first)
    assert client.get("/", headers=cookie).status_code == 200
    reopened = client.get(f"/?token={once}", headers=cookie)  # by the same browser
    assert reopened.status_code == 303
    assert client.get("/api/plans", headers=cookie).status_code == 200


def test_who_was_faster_than_the_browser_is_shut_out(
    client: DirectClient, caplog: pytest.LogCaptureFixture
) -> None:
    once = client.app.sessions.one_time()
    stolen = cookie_of(client.get(f"/?token={once}"))
    browser = client.get(f"/?token={once}")
    assert browser.status_code == 401
    assert "another user of this machine" in browser.text
    assert "\n" not in browser.text.strip()
    assert "another user of this machine" in caplog.text
    assert once not in browser.text + caplog.text
    assert client.get("/api/plans", headers=stolen).status_code == 401
    assert client.get(f"/?token={once}").status_code == 401
    assert client.get("/", headers=cookie_of(client.get(f"/?token={TOKEN}"))).status_code == 200


def test_the_address_of_the_browser_is_for_a_short_time(
    client: DirectClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    late, used = client.app.sessions, client.app.sessions.one_time()
    cookie = cookie_of(client.get(f"/?token={used}"))
    monkeypatch.setattr(late, "until", 0.0)
    assert client.get(f"/?token={used}").status_code == 401
    assert client.get("/", headers=cookie).status_code == 200  # nobody can end a session later
    once = late.one_time()
    monkeypatch.setattr(late, "until", 0.0)
    refused = client.get(f"/?token={once}")
    assert refused.status_code == 401
    assert "first line" in refused.text


@pytest.mark.parametrize("name", SINGLE)
def test_a_header_that_decides_occurs_once(client: DirectClient, name: str) -> None:
    value = {"host": HERE[7:], "origin": HERE, "authorization": BEARER["Authorization"]}.get(name, "0")
    pairs = [("authorization", BEARER["Authorization"]), (name, value), (name, value)]
    given = [*pairs[name == "authorization" :], *([("host", HERE[7:])] if name != "host" else [])]
    answer = client.get("/api/plans", headers=given)
    assert answer.status_code == 400, answer.text
    assert answer.json()["error"] == f"the header {name} occurs twice"


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b'{"formula": "\\ud800"}', "surrogate"), (b'{"\\udfff": 1}', "surrogate"),
        (b'{"formula": NaN}', "finite"), (b'{"formula": [1, -Infinity]}', "finite"),
        (b'{"formula": 1e999}', "finite"), (b'{"formula": "a", "formula": "b"}', "twice"),
        (b"[" * 5000, "nested"), (b'{"formula": ' + b"9" * 5000 + b"}", "digits"),
        (b"\xff", "UTF-8"), (b"", "JSON"), (b"{", "JSON"), (b"[]", "object"), (b'"text"', "object"),
        (b"null", "object"), (b'{"other": 1}', "object"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("path", ["/api/formula", "/api/plans", "/api/mission"])
def test_a_body_that_is_no_plain_json_is_refused_in_one_line(
    client: DirectClient, path: str, content: bytes, said: str
) -> None:
    if path != "/api/formula":
        content = content.replace(b"formula", b"mission" if path == "/api/mission" else b"map")
    method = "PUT" if path == "/api/mission" else "POST"
    answer = client.request(
        method, path, content=content, headers={**BEARER, "content-type": "application/json"}
    )
    assert answer.status_code == 400, answer.text
    assert said in answer.json()["error"]
    assert "\n" not in answer.json()["error"]
    answer.text.encode()


@pytest.mark.parametrize(
    "kind",
    ["", "text/plain", "application/x-www-form-urlencoded", "multipart/form-data", "application/jsonp"],
)
def test_json_is_declared_as_json(client: DirectClient, kind: str) -> None:
    answer = client.post("/api/plans", content=b"{}", headers={**BEARER, "content-type": kind})
    assert answer.status_code == 400
    assert "Content-Type" in answer.json()["error"]


@pytest.mark.parametrize(
    "path", ["/api/plans/20260101-000000-abcd", "/api/examples/x", "/api/backdrops/x.kml"]
)
def test_what_is_not_there_is_404(client: DirectClient, path: str) -> None:
    assert client.get(path, headers=BEARER).status_code == 404


def test_the_text_of_an_error_does_not_decide_its_status(
    client: DirectClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> None:
        raise DataError("there is no wind in this file")

    monkeypatch.setattr("pareto_ltl_apps.desk.missions.example_map", broken)
    assert client.get("/api/examples/hop", headers=BEARER).status_code == 400


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


@pytest.mark.parametrize("path", ["/", f"/?token={TOKEN}", "/desk/main.js", "/api/plans", "/nothing"])
def test_every_answer_has_a_strict_policy(client: DirectClient, path: str) -> None:
    answer = client.get(path, headers=BEARER)
    policy = answer.headers["content-security-policy"]
    assert policy.startswith("default-src 'none'")
    assert "unsafe" not in policy
    assert answer.headers["x-content-type-options"] == "nosniff"
    assert answer.headers["referrer-policy"] == "no-referrer"
    assert "access-control-allow-origin" not in answer.headers


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


def test_a_name_that_no_system_takes_is_one_short_line(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="a name of more than 255 bytes") as caught:
        DeskFolder.opened(tmp_path / "desk").inside("maps/" + "a" * 100_000)
    assert len(str(caught.value)) < 300


@pytest.mark.parametrize("kind", ["Qoint", "", "Polygon "])
def test_a_geometry_of_no_kind_is_one_line(tmp_path: Path, kind: str) -> None:
    folder = DeskFolder.opened(tmp_path / "desk")
    feature = {"type": "Feature", "properties": {}, "geometry": {"type": kind, "coordinates": [5.0, 60.0]}}
    content = json.dumps({"type": "FeatureCollection", "features": [feature]}).encode()
    with pytest.raises(DataError, match="a geometry cannot be read"):
        backdrop(folder, Path(folder.keep_map(content)).name)


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
