"""The page of a result: its numbers agree with the files, it loads nothing, and no text in it is markup."""

from __future__ import annotations

import csv
import html
import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pareto_ltl
from pareto_ltl.extend import Frame
from pareto_ltl.logic.automaton import translate
from pareto_ltl.run.plan_run import Run
from pareto_ltl.support.errors import InfeasibleError
from pareto_ltl_apps.cli.commands import run_command_line
from pareto_ltl_apps.view.components import MODULES, bundled, component
from pareto_ltl_apps.view.page.content import SCRIPTS, Content, json_for_script, page_bytes, page_content
from pareto_ltl_apps.view.page.ground import MAX_CORNERS, rounded, shown_map, shown_wind
from pareto_ltl_apps.view.page.machine import told_clocks
from pareto_ltl_apps.view.page.points import MAX_LEGS, told_points
from pareto_ltl_apps.view.records import Origin, ShownRun
from quick_plan import QUICK_SEARCH

HOSTILE = "</script><img src=x onerror=alert(1)>&\"'\u2028"
MILLION = 1_000_000
WALLED_OFF = {
    "bounds": [[0, 0], [1e6, 1e6]],
    "start": [1e5, 1e5],
    "regions": {"a": [[8e5, 8e5], [9e5, 8e5], [9e5, 9e5], [8e5, 9e5]]},
    "obstacles": [[[0, 4e5], [1e6, 4e5], [1e6, 5e5], [0, 5e5]]],
}


class Tags(HTMLParser):
    """The tags of a page, their attributes and the text of its scripts."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs)))


def data_of(text: str) -> Any:
    """The numbers that the page holds."""
    found = re.findall(r'<script type="application/json" id="page-data">(.*?)</script>', text, re.DOTALL)
    assert len(found) == 1
    return json.loads(found[0])


@pytest.fixture(scope="session")
def content(shown: ShownRun) -> Content:
    return page_content(shown)


@pytest.fixture(scope="session")
def text(page_result: Path) -> str:
    return (page_result / "report.html").read_text(encoding="utf-8")


# --- numbers ----------------------------------------------------------------------------------


def test_the_points_are_the_rows_of_the_front(text: str, page_result: Path) -> None:
    with (page_result / "front.csv").open() as file:
        rows = list(csv.DictReader(file))
    points = data_of(text)["points"]
    assert len(points) == len(rows)
    columns = (
        "failure", "failure_low", "failure_high", "length_m", "mission_risk", "collision_risk", "duration_s",
    )  # fmt: skip
    for point, row in zip(points, rows, strict=True):
        assert all(point[name] == float(row[name]) for name in columns)
        assert (point["runs"], point["law"]) == (int(row["runs"]), row["law"])


def test_the_chosen_point_and_its_promise_are_those_of_the_plan(text: str, page_result: Path) -> None:
    plan, data = Run.open(page_result).plan, data_of(text)
    assert plan.promise is not None
    shown = data["paths"][str(data["chosen"])]
    crs = Run.open(page_result).scene.crs
    assert crs is not None
    assert np.abs(Frame(crs).to_plane(*np.array(shown["line"]).T) - plan.path.x).max() <= 1.0
    assert shown["q"] == plan.path.q.tolist()
    assert shown["utc"] == list(plan.navigation.time_utc or ()) if plan.navigation else False
    for name in ("law", "failure", "low", "high", "runs"):
        assert data["promise"][name] == getattr(plan.promise.rate, name)


def test_failures_along_the_way_end_at_the_failures_of_the_flights(text: str, page_result: Path) -> None:
    data, flights = data_of(text), Run.open(page_result).deployments
    risk = data["paths"][str(data["chosen"])]["risk"]
    flown = flights[risk["law"]]
    counts = np.array(risk["failed"])
    assert risk["runs"] == len(flown.x)
    assert counts[:, -1].sum() == flown.failed.sum()
    assert (np.diff(counts, axis=1) >= 0).all()
    assert data["flights"]["failures"] == flown.failed.sum()
    drawn = len(data["flights"]["at"])
    assert [step >= 0 for step in data["flights"]["failed"]] == flown.failed[:drawn].tolist()


def test_all_points_are_flown_in_the_winds_of_the_chosen_one(shown: ShownRun, content: Content) -> None:
    without = page_content(replace(shown, deployments={}))
    key = str(content.data["chosen"])
    assert without.data["paths"][key]["risk"] == content.data["paths"][key]["risk"]


def test_every_probability_at_the_top_names_its_wind_law(content: Content) -> None:
    for fact in content.texts["facts"]:
        if "%" in fact["value"]:
            assert "winds" in fact["note"]
    assert all(row["law"] for row in content.texts["verdicts"])


def test_the_wind_of_the_page_is_that_of_the_record(shown: ShownRun) -> None:
    wind, crs = shown_wind(shown.scene, shown.wind, 0.0), shown.scene.crs
    assert crs is not None
    lon, lat = np.array(wind["at"]).T
    nodes = (Frame(crs).to_plane(lon, lat) - shown.wind.origin) / shown.wind.spacing
    assert np.abs(nodes - nodes.round()).max() < 1e-3
    i, j = nodes.round().astype(int).T
    mean = shown.wind.mean[0, i, j]
    speed = np.hypot(*mean.T)
    assert np.hypot(*np.array(wind["uv"][0]).T) == pytest.approx(speed, abs=0.01)
    # Arrows stand on a map with north at the top: a second with the wind leads in their direction.
    ahead = np.column_stack(Frame(crs).to_geographic(nodes * shown.wind.spacing + shown.wind.origin + mean))
    east = (ahead[:, 0] - lon) * np.cos(np.deg2rad(lat))
    turned = np.arctan2(east, ahead[:, 1] - lat) - np.arctan2(*np.array(wind["uv"][0]).T)
    fast = speed > 2.0
    assert fast.any()
    assert np.abs((turned[fast] + np.pi) % (2 * np.pi) - np.pi).max() < np.deg2rad(1.0)
    sd = np.sqrt((shown.wind.latent_var[0] + shown.wind.gust_var[0]).mean(axis=-1))[i, j]
    assert wind["sd"][0] == pytest.approx(sd, abs=0.006)


def test_paths_for_which_there_is_no_room_are_left_out_but_never_the_chosen_one(shown: ShownRun) -> None:
    front = shown.front
    assert front is not None
    assert told_points(front, 0) == list(range(len(front.paths)))
    steps = max(len(path.u) for path in front.paths)
    many = replace(
        front, paths=front.paths[:1] * 1000, rates=front.rates[:1] * 1000, failed=np.zeros((1000, 0), bool)
    )
    told = told_points(many, 517)
    assert 517 in told
    assert len(told) <= MAX_LEGS // min(len(p.u) for p in front.paths) + 1 <= MAX_LEGS
    assert len(told) * steps <= 2 * MAX_LEGS


def test_outlines_that_are_thinned_out_are_drawn_but_never_exported(shown: ShownRun) -> None:
    assert shown_map(shown.scene)["exported"]
    angle = np.linspace(0.0, 2.0 * np.pi, MAX_CORNERS + 1, endpoint=False)
    round_one = shown.scene.bounds.mean(axis=0) + 1e4 * np.column_stack([np.cos(angle), np.sin(angle)])
    drawn = shown_map(replace(shown.scene, obstacles=(round_one,), obstacle_names=()))
    (ring,) = [shape["ring"] for shape in drawn["shapes"] if shape["role"] == "obstacle"]
    assert len(ring) < MAX_CORNERS
    assert not drawn["exported"]


def test_rounded_numbers_have_no_minus_zero_and_whole_ones_no_point() -> None:
    assert rounded(np.array([-0.04, 1.26]), 1) == [0.0, 1.3]
    assert str(rounded(np.array([-0.04]), 1)) == "[0.0]"
    assert rounded(np.array([[1.2, 2.7]]), 0) == [[1, 3]]


def test_clocks_of_deadlines_are_told_as_times() -> None:
    automaton = translate("F[0,6h] a & G[90min,2h] !b & F c")
    labels = " ".join(told_clocks(automaton, name) for name in automaton.atoms)
    for words in ("t ≤ 6 h", "1.5 h ≤ t ≤ 2 h", "t > 2 h"):
        assert words in labels
    assert "clock_" not in labels


# --- one file, without a network, without markup from names -----------------------------------


def test_the_page_is_small_and_the_same_each_time(
    text: str, page_result: Path, tmp_path: Path, content: Content
) -> None:
    assert len(text.encode()) < MILLION
    assert pareto_ltl.page(page_result, tmp_path / "again.html").read_text(encoding="utf-8") == text
    assert page_bytes(content).decode() == text


def test_the_page_loads_nothing(text: str) -> None:
    tags = Tags(text).found
    for _, attributes in tags:
        for name in ("src", "href", "action", "srcset", "data", "poster"):
            value = attributes.get(name)
            assert value is None or value.startswith("data:"), attributes
    (policy,) = [a["content"] for tag, a in tags if tag == "meta" and a.get("http-equiv")]
    assert policy is not None
    assert policy.startswith("default-src 'none'")
    folder = Path(pareto_ltl.__file__).parents[1] / "pareto_ltl_apps" / "view" / "page"
    own = "".join([*map(component, MODULES), *(folder.joinpath(name).read_text() for name in SCRIPTS)])
    for reach in ("fetch(", "XMLHttpRequest", "WebSocket", "import(", "innerHTML", "eval(", "document.write"):
        assert reach not in own


def test_names_are_never_markup(shown: ShownRun, text: str) -> None:
    corners = next(iter(shown.scene.regions.values()))
    origin = Origin(HOSTILE, {HOSTILE: HOSTILE}, {HOSTILE: HOSTILE}, HOSTILE)
    assert shown.plan is not None
    hostile = replace(
        shown, name=HOSTILE, origin=origin, why=HOSTILE,
        scene=replace(shown.scene, regions=dict(shown.scene.regions) | {HOSTILE: corners}),
        plan=replace(shown.plan, covered=HOSTILE, not_covered=HOSTILE),
    )  # fmt: skip
    for run in (hostile, replace(hostile, plan=None)):
        page = page_bytes(page_content(run)).decode()
        assert "<img" not in page
        assert page.count("</script>") == 2
        assert [tag for tag, _ in Tags(page).found].count("script") == 2
        data = data_of(page)
        assert data["name"] == HOSTILE
        assert HOSTILE in [shape["name"] for shape in data["map"]["shapes"]]


def test_json_in_a_script_reads_back(text: str) -> None:
    data = {"a": HOSTILE, "b": ["<!--", "]]>", 1.5, None]}
    written = json_for_script(data)
    assert json.loads(written) == data
    assert not set("<>&\u2028") & set(written)


def test_the_components_are_joined_into_one_script() -> None:
    texts = {name: component(name) for name in MODULES}
    names: list[str] = []
    for name, text in texts.items():
        wanted = re.findall(r'from "\./([a-z]+\.js)"', text)
        assert all(MODULES.index(other) < MODULES.index(name) for other in wanted)
        names += re.findall(r"^(?:export )?(?:const|function|class) (\w+)", text, re.MULTILINE)
    assert len(names) == len(set(names))
    script = bundled(texts.values())
    assert not re.search(r"^(import|export)\b", script, re.MULTILINE)


def test_folders_of_the_machine_are_named_only_where_run_json_names_them(
    text: str, page_result: Path
) -> None:
    inputs = Run.open(page_result).provenance["inputs"]
    page = text
    for name in inputs:
        assert name not in page
        assert Path(name).name in page
    assert str(page_result) not in page


# --- runs without a plan, settings, commands ---------------------------------------------------


def test_a_mission_without_a_plan_has_a_page_that_says_why(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    place = tmp_path / "no_plan"
    few = {"planner": {"trees": 1, "n_max": 200}, "wind": "calm", "report": {"figures": False}}
    with pytest.raises(InfeasibleError) as error:
        pareto_ltl.plan(WALLED_OFF, "F a", out=place, **few)
    text = (place / "report.html").read_text(encoding="utf-8")
    assert "<strong>No plan.</strong>" in text
    assert str(error.value)[1:] in html.unescape(text)
    data = data_of(text)
    assert data["points"] == []
    assert data["chosen"] is None
    (place / "report.html").unlink()
    assert run_command_line(["show", str(place), "--print"]) == 0
    assert capsys.readouterr().out.strip() == str(place / "report.html")
    assert (place / "report.html").read_text(encoding="utf-8") == text


def test_show_prints_the_path_and_writes_a_missing_page(
    page_result: Path, text: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER"):
        monkeypatch.delenv(name, raising=False)
    (page_result / "report.html").unlink()
    assert run_command_line(["show", str(page_result)]) == 0
    first, second = capsys.readouterr().out.splitlines()
    assert first == str(page_result / "report.html")
    assert "found no browser" in second
    assert (page_result / "report.html").read_text(encoding="utf-8") == text


def test_show_opens_the_browser_where_there_is_one(
    page_result: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    opened: list[str] = []
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr("webbrowser.open", lambda address: bool(opened.append(address)) or True)
    assert run_command_line(["show", str(page_result)]) == 0
    assert opened == [(page_result / "report.html").resolve().as_uri()]
    assert capsys.readouterr().out.startswith("opened ")


@pytest.mark.parametrize("name", ["nothing", "empty"])
def test_a_folder_that_is_no_result_is_one_line(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "empty").mkdir()
    assert run_command_line(["show", str(tmp_path / name)]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1


def test_a_run_without_a_page_writes_none(tmp_path: Path) -> None:
    few = {"planner": {"trees": 1, "n_max": 300}, "deployment": {"runs": 5}, "wind": "calm", **QUICK_SEARCH}
    pareto_ltl.plan("phi1", "F a", out=tmp_path / "run", report="none", **few)
    assert not (tmp_path / "run" / "report.html").exists()
    result = pareto_ltl.plan("phi1", "F a", **few)
    text = pareto_ltl.page(result, tmp_path / "memory.html").read_text(encoding="utf-8")
    assert data_of(text)["chosen"] is not None
