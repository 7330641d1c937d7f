"""The API of the desk, as programs use it."""

from __future__ import annotations

import asyncio
import json
import re
import shlex
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import httpx
import numpy as np
import psutil
import pytest

from desk import HOP, MOST, SMALL, RunningDesk, running_desk
from pareto_ltl.extend import Frame
from pareto_ltl.run.plan_run import Run
from pareto_ltl.support.errors import DataError
from pareto_ltl_apps.cli.commands import run_command_line
from pareto_ltl_apps.desk import views
from pareto_ltl_apps.desk.app import ROUTES
from pareto_ltl_apps.desk.folder import DeskFolder
from pareto_ltl_apps.desk.plans import MAX_ENDED, Plans
from quick_wind import wind_words


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("desk")


@pytest.fixture(scope="module")
def desk(folder: Path) -> Iterator[RunningDesk]:
    with running_desk(folder) as running:
        yield running


@pytest.fixture(scope="module")
def hop(desk: RunningDesk) -> dict[str, Any]:
    """The state of a finished plan."""
    return desk.planned(overrides=HOP)


def drawn(title: str) -> dict[str, Any]:
    """A map with a start and one region, as the page writes it."""

    def square(lon: float, lat: float) -> list[list[float]]:
        half = 0.05
        ring = [(-half, -half), (half, -half), (half, half), (-half, half), (-half, -half)]
        return [[lon + a, lat + b] for a, b in ring]

    return {
        "type": "FeatureCollection",
        "features": [
            {
                "type": "Feature", "properties": {"role": "start"},
                "geometry": {"type": "Point", "coordinates": [-92.4, 36.8]},
            },
            {
                "type": "Feature", "properties": {"role": "region", "name": "a", "title": title},
                "geometry": {"type": "Polygon", "coordinates": [square(-92.0, 37.1)]},
            },
        ],
    }  # fmt: skip


def test_the_first_line_is_the_address(desk: RunningDesk) -> None:
    assert re.fullmatch(r"http://127\.0\.0\.1:\d+/\?token=[\w-]{20,}", desk.address)


def test_nothing_on_the_command_line_of_the_browser_can_be_used_again(tmp_path: Path) -> None:
    seen, script = tmp_path / "argv", tmp_path / "browser"
    script.write_text(f'#!/bin/sh\necho "$*" > {seen}.part && mv {seen}.part {seen}\n')
    script.chmod(0o755)
    with running_desk(tmp_path / "desk", browser=f"{script} %s") as opened:
        deadline = time.monotonic() + MOST
        while not seen.exists() and time.monotonic() < deadline:
            time.sleep(0.05)
        argv = seen.read_text().strip()
        base, _, once = argv.partition("/?token=")
        assert base == opened.address.partition("/?token=")[0]
        assert once not in opened.address
        with httpx.Client(base_url=base, follow_redirects=True) as browser:
            page = browser.get(f"/?token={once}")
            assert (page.status_code, str(page.url)) == (200, f"{base}/")
            assert "Planning desk" in page.text
            assert browser.get("/api/plans").json() == {"plans": []}
        with httpx.Client(base_url=base) as other:
            assert other.get("/api/plans", headers={"Authorization": f"Bearer {once}"}).status_code == 401
            assert "works once" in other.get(f"/?token={once}").text


def test_only_the_loopback_address_listens(desk: RunningDesk) -> None:
    listening = [
        c for c in psutil.Process(desk.process.pid).net_connections() if c.status == psutil.CONN_LISTEN
    ]
    assert [c.laddr.ip for c in listening] == ["127.0.0.1"]


def test_the_same_settings_give_the_bytes_of_the_command_line(hop: dict[str, Any], tmp_path: Path) -> None:
    assert hop["status"] == "done", hop
    assert run_command_line(["plan", *HOP, f"hydra.run.dir={tmp_path}"]) == 0
    for name in ("plan.json", "front.csv", "plan.csv", "scene.json"):
        assert (Path(hop["directory"]) / name).read_bytes() == (tmp_path / name).read_bytes(), name


def test_a_result_is_one_that_verify_accepts(hop: dict[str, Any]) -> None:
    assert run_command_line(["verify", hop["directory"]]) == 0


def test_the_command_line_is_shown(hop: dict[str, Any], folder: Path) -> None:
    assert hop["command"].startswith(f"cd {folder.resolve()} && pareto-ltl plan +experiment=hop ")


def test_the_front_has_the_points_of_the_result(desk: RunningDesk, hop: dict[str, Any]) -> None:
    front = desk.client.get(f"/api/plans/{hop['id']}/front").json()
    results = Run.open(Path(hop["directory"]))
    rates = [rate.failure for rate in results.front.rates]
    assert [point["failure"] for point in front["points"]] == pytest.approx(rates)
    lengths = [path.objectives.length for path in results.front.paths]
    assert [point["length_m"] for point in front["points"]] == pytest.approx(lengths)
    assert front["law"] == "coherent"


def test_a_point_has_its_path_in_degrees(desk: RunningDesk, hop: dict[str, Any]) -> None:
    front = desk.client.get(f"/api/plans/{hop['id']}/front").json()
    for number in range(len(front["points"])):
        view = desk.client.get(f"/api/plans/{hop['id']}/points/{number}").json()
        assert len(view["line"]) == len(view["t"]) == len(view["spread"])
        assert view["line"][0] == pytest.approx([-92.4, 36.76], abs=0.1)
        assert view["risk"]["runs"] > 0
        assert (view["limits"] is not None) == view["chosen"]
        flights = view["flights"]
        assert len(flights["at"][0]) == len(view["t"])
        failed = [step >= 0 for step in flights["failed"]]
        assert failed == [why is not None for why in flights["why"]]


def test_events_report_stages_paths_and_the_end(desk: RunningDesk, hop: dict[str, Any]) -> None:
    text = desk.client.get(f"/api/plans/{hop['id']}/events").text
    events = [json.loads(line[6:]) for line in text.splitlines() if line.startswith("data: ")]
    kinds = [event["event"] for event in events]
    assert kinds[0] == "begun"
    assert kinds[-1] == "status"
    paths = [event for event in events if event["event"] == "paths"]
    sources = [event["source"] for event in paths]
    assert (sources[0], sources[-1]) == ("search", "front")
    assert sources.count("refinement") >= 2  # the front grows
    front = desk.client.get(f"/api/plans/{hop['id']}/front").json()
    assert [p["failure"] for p in paths[-1]["points"]] == [p["failure"] for p in front["points"]]
    assert all(point["length_m"] > 0 and point["line"] for event in paths for point in event["points"])
    stages = [event["stage"] for event in events if event["event"] == "stage"]
    assert stages[:2] == ["readings", "scene"]


def test_the_front_is_shown_while_the_plan_is_being_checked(desk: RunningDesk) -> None:
    name = desk.client.post("/api/plans", json={"overrides": HOP}).json()["id"]
    assert desk.client.get(f"/api/plans/{name}/front").status_code == 400
    early = {}
    with desk.client.stream("GET", f"/api/plans/{name}/events") as events:
        for line in events.iter_lines():
            if line.startswith("data: ") and json.loads(line[6:]).get("source") == "front":
                early = desk.client.get(f"/api/plans/{name}/front").json()
                assert desk.client.get(f"/api/plans/{name}/points/0").json()["line"]
    late = desk.client.get(f"/api/plans/{name}/front").json()
    assert early["points"] == late["points"]
    assert late["chosen"] is not None


def test_what_limits_a_point_is_what_limits_it_as_the_plan(desk: RunningDesk, hop: dict[str, Any]) -> None:
    front = desk.client.get(f"/api/plans/{hop['id']}/front").json()
    number = next(k for k in range(len(front["points"])) if k != front["chosen"])
    assert desk.client.get(f"/api/plans/{hop['id']}/points/{number}").json()["limits"] is None
    limits = desk.client.get(f"/api/plans/{hop['id']}/points/{number}/limits").json()
    assert limits["prices"] or limits["segments"]
    state = desk.client.post(f"/api/plans/{hop['id']}/choose", json={"point": number}).json()
    assert desk.ended(state["id"])["status"] == "done"
    chosen = desk.client.get(f"/api/plans/{state['id']}/front").json()["chosen"]
    assert desk.client.get(f"/api/plans/{state['id']}/points/{chosen}").json()["limits"] == limits


def test_a_map_and_a_formula_are_planned(desk: RunningDesk, folder: Path) -> None:
    state = desk.planned(map=drawn("Лес <b>"), formula="F a", overrides=[*SMALL, "wind=calm"])
    assert state["status"] == "done", state
    assert Run.open(Path(state["directory"])).plan.formula == "F a"
    words = shlex.split(state["command"])
    assert words[:3] == ["cd", str(folder.resolve()), "&&"]
    words[-1] = "hydra.run.dir=by_command_line"
    subprocess.run([sys.executable, "-m", "pareto_ltl", *words[4:]], cwd=folder, check=True)
    for name in ("plan.json", "front.csv", "plan.csv", "scene.json"):
        ours = (folder / "by_command_line" / name).read_bytes()
        assert (Path(state["directory"]) / name).read_bytes() == ours, name
    (kept,) = (folder / "maps").iterdir()
    assert json.loads(kept.read_text(encoding="utf-8"))["features"][1]["properties"]["title"] == "Лес <b>"


def test_another_point_becomes_the_plan(desk: RunningDesk, hop: dict[str, Any]) -> None:
    front = desk.client.get(f"/api/plans/{hop['id']}/front").json()
    wanted = len(front["points"]) - 1
    answer = desk.client.post(f"/api/plans/{hop['id']}/choose", json={"point": wanted})
    state = desk.ended(answer.json()["id"])
    assert state["status"] == "done", state
    assert desk.client.get(f"/api/plans/{state['id']}/front").json()["chosen"] == wanted
    far = desk.client.post(f"/api/plans/{hop['id']}/choose", json={"point": wanted + 1})
    assert far.status_code == 404
    assert "there is no point" in far.json()["error"]


def test_a_plan_is_exported(desk: RunningDesk, hop: dict[str, Any]) -> None:
    answer = desk.client.get(f"/api/plans/{hop['id']}/exports/kml")
    assert answer.headers["content-disposition"] == 'attachment; filename="plan.kml"'
    assert b"<kml" in answer.content
    assert desk.client.get(f"/api/plans/{hop['id']}/exports/gpx?point=0").status_code == 200
    assert desk.client.get(f"/api/plans/{hop['id']}/exports/pdf").status_code == 404


def test_the_rest_is_planned_again_after_a_fix(desk: RunningDesk, hop: dict[str, Any]) -> None:
    point = desk.client.get(f"/api/plans/{hop['id']}/front").json()["chosen"]
    view = desk.client.get(f"/api/plans/{hop['id']}/points/{point}").json()
    lon, lat = view["line"][3]
    body = {"time": view["t"][3], "fix": [lat, lon, 300]}
    answer = desk.client.post(f"/api/plans/{hop['id']}/replan", json=body)
    state = desk.ended(answer.json()["id"])
    assert state["status"] == "done", state
    again = desk.client.get(f"/api/plans/{state['id']}/points/0").json()
    assert again["line"][0] == pytest.approx([lon, lat], abs=0.02)


def test_a_beacon_is_tried_along_the_plan(desk: RunningDesk, hop: dict[str, Any]) -> None:
    place = f"/api/plans/{hop['id']}/beacons"
    assert desk.client.get(place).status_code == 404
    job = desk.client.post(place).json()
    assert desk.ended(job["id"])["status"] == "done"
    found = desk.client.get(place).json()
    assert len(found["at"]) == len(found["failure"]) > 50
    assert found["said"][0].startswith("without a further beacon")
    assert job["id"] not in [state["id"] for state in desk.client.get("/api/plans").json()["plans"]]
    assert run_command_line(["verify", hop["directory"]]) == 0


def test_the_last_check_of_a_plan_is_shown(desk: RunningDesk, hop: dict[str, Any]) -> None:
    place = f"/api/plans/{hop['id']}/check"
    missing = desk.client.get(place).json()
    assert (missing["go"], missing["wind"]) == (None, None)
    assert "pareto-ltl check" in missing["said"][0]
    folder = Path(hop["directory"]) / "check"
    folder.mkdir()
    (folder / "check.json").write_text('{"go": false, "wind": "winds/newer.grib2"}')
    (folder / "check.txt").write_text("NO-GO\n1. fails 9 %, limit 5 %\n")
    found = desk.client.get(place).json()
    assert found == {"go": False, "wind": "newer.grib2", "said": ["NO-GO", "1. fails 9 %, limit 5 %"]}


def test_the_wind_is_shown_without_a_plan(desk: RunningDesk) -> None:
    state = desk.planned(command="wind", overrides=["+experiment=hop", "report=none", *wind_words()])
    assert (state["status"], state["made_by"]) == ("done", "wind")
    wind = desk.client.get(f"/api/plans/{state['id']}/wind").json()
    across, along = wind["shape"]
    assert across * along == len(wind["at"]) == len(wind["uv"][0]) == len(wind["sd"][0])
    assert len(wind["t"]) == len(wind["utc"]) == len(wind["uv"]) == len(wind["sd"])
    assert wind["utc"][0] == "2018-10-09T00:00:00Z"
    assert wind["issued"] is None  # winds that were observed


def test_the_age_of_a_forecast_is_that_of_its_start(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    field = SimpleNamespace(
        times=np.array([0.0, 3600.0]), leads=np.array([6.0, 7.0]) * 3600.0, known_until=1.0
    )
    frame = Frame(None, "2026-11-25T18:00:00Z")
    scene = SimpleNamespace(crs=Frame.at(50.0, 8.0).crs, time_zero=frame.time_zero, frame=frame)
    monkeypatch.setattr(views, "load_results", lambda _: SimpleNamespace(wind=field, scene=scene))
    monkeypatch.setattr(views, "shown_wind", lambda *_: {})
    assert views.wind_view(tmp_path) == {"issued": "2026-11-25T12:00:00Z"}


def test_starts_are_compared(desk: RunningDesk) -> None:
    words = [*HOP, "departure.flights=200", "departure.seeds=1", "departure.last=2018-10-09T03:00:00Z"]
    state = desk.planned(command="departure", overrides=words)
    assert state["status"] == "done", state
    found = desk.client.get(f"/api/plans/{state['id']}/departures").json()
    assert [row["departure"] for row in found["starts"]] == ["2018-10-09T00:00:00Z", "2018-10-09T03:00:00Z"]
    assert all(len(row["failure_at"]) == len(found["lengths_m"]) for row in found["starts"])


def test_other_commands_are_refused(desk: RunningDesk) -> None:
    answer = desk.client.post("/api/plans", json={"command": "compare", "overrides": HOP})
    assert answer.status_code == 400
    assert "command must be one of plan, departure, wind" in answer.json()["error"]


def test_a_mission_that_cannot_be_planned_says_why(desk: RunningDesk) -> None:
    state = desk.planned(map=drawn("a"), formula="F nowhere", overrides=[*SMALL, "wind=calm"])
    assert state["status"] == "failed"
    assert "nowhere" in state["error"]
    assert "\n" not in state["error"]


def test_a_plan_that_is_removed_leaves_the_list_and_keeps_its_files(desk: RunningDesk) -> None:
    state = desk.planned(map=drawn("a"), formula="F nowhere", overrides=[*SMALL, "wind=calm"])
    answer = desk.client.post(f"/api/plans/{state['id']}/remove", json={})
    moved = Path(answer.json()["moved"])
    assert (moved / "run.json").is_file()
    assert moved.parent.name == "removed"
    assert not Path(state["directory"]).exists()
    assert state["id"] not in [one["id"] for one in desk.client.get("/api/plans").json()["plans"]]
    again = desk.client.post(f"/api/plans/{state['id']}/remove", json={})
    assert again.status_code == 404
    assert "there is no plan" in again.json()["error"]


def test_a_plan_that_runs_is_not_removed(desk: RunningDesk) -> None:
    words = [*HOP, "planner.n_max=200000", "planner.trees=4"]
    name = desk.client.post("/api/plans", json={"overrides": words}).json()["id"]
    answer = desk.client.post(f"/api/plans/{name}/remove", json={})
    desk.client.delete(f"/api/plans/{name}")
    assert answer.status_code == 400
    assert "is running; cancel it before" in answer.json()["error"]
    assert desk.ended(name)["status"] == "cancelled"


def test_a_cancelled_plan_ends_and_the_next_one_is_made(desk: RunningDesk) -> None:
    words = [*HOP, "planner.n_max=200000", "planner.trees=4"]
    name = desk.client.post("/api/plans", json={"overrides": words}).json()["id"]
    with desk.client.stream("GET", f"/api/plans/{name}/events") as events:
        next(line for line in events.iter_lines() if "forest" in line)
    waiting = desk.client.post("/api/plans", json={"overrides": HOP}).json()["id"]
    desk.client.delete(f"/api/plans/{waiting}")
    desk.client.delete(f"/api/plans/{name}")
    assert desk.ended(name)["status"] == desk.ended(waiting)["status"] == "cancelled"
    assert desk.planned(overrides=HOP)["status"] == "done"


def test_formulas_are_explained_with_the_place_of_an_error(desk: RunningDesk) -> None:
    right = desk.client.post("/api/formula", json={"formula": "F(a & F b)"}).json()
    assert (right["words"], right["names"], right["error"]) == ("reach a, then b", ["a", "b"], None)
    wrong = desk.client.post("/api/formula", json={"formula": "F(a & )"}).json()
    assert wrong["column"] == 6
    made = desk.client.post("/api/formula", json={"pattern": "sequence", "goals": ["b", "a"]}).json()
    assert made["formula"] == "F(b & F a)"


def test_examples_are_maps_that_can_be_planned(desk: RunningDesk) -> None:
    for name in desk.client.get("/api/choices").json()["examples"]:
        roles = [f["properties"]["role"] for f in desk.client.get(f"/api/examples/{name}").json()["features"]]
        assert {"start", "region", "obstacle", "border"} <= set(roles)


def test_a_second_tab_does_not_overwrite_the_first(desk: RunningDesk) -> None:
    revision = desk.client.get("/api/mission").json()["revision"]
    body = {"revision": revision, "mission": {"features": []}}
    assert desk.client.put("/api/mission", json=body).json() == {"revision": revision + 1}
    late = desk.client.put("/api/mission", json=body)
    assert late.status_code == 409
    assert "another tab" in late.json()["error"]


def test_the_document_describes_every_operation(desk: RunningDesk) -> None:
    paths = desk.client.get("/api/openapi.json").json()["paths"]
    described = {(method.upper(), path) for path, methods in paths.items() for method in methods}
    assert described == {(row.method, row.path) for row in ROUTES}


def test_events_of_old_plans_leave_the_memory(tmp_path: Path) -> None:
    async def many() -> int:
        plans = Plans(DeskFolder.opened(tmp_path))
        for _ in range(3 * MAX_ENDED):
            plans.plan("plan", ["+experiment=hop"]).end("done")
        return len(plans.jobs)

    assert asyncio.run(many()) == MAX_ENDED + 1


def test_a_front_is_shown_from_when_it_is_made_until_the_plan_is_cancelled_and_after(tmp_path: Path) -> None:
    async def asked() -> None:
        plans = Plans(DeskFolder.opened(tmp_path))
        job = plans.plan("plan", ["+experiment=hop"])
        with pytest.raises(DataError, match="is running; only a finished plan has results"):
            plans.require_front(job.name)
        job.tell({"event": "paths", "source": "front"})
        assert plans.require_front(job.name).name == job.name
        job.end("cancelled")
        assert plans.require_front(job.name).name == job.name

    asyncio.run(asked())


def ends(process: psutil.Process, patience: float = 60.0) -> bool:
    """Whether a process ends in time; an orphan for which nobody waits (in a container) stays as a zombie."""
    deadline = time.monotonic() + patience
    while process.is_running() and process.status() != psutil.STATUS_ZOMBIE:
        if time.monotonic() > deadline:
            return False
        time.sleep(0.1)
    return True


def test_a_plan_of_a_server_that_was_killed_says_so(tmp_path: Path) -> None:
    words = [*HOP, "planner.n_max=200000", "planner.trees=4"]
    with running_desk(tmp_path) as killed:
        name = killed.client.post("/api/plans", json={"overrides": words}).json()["id"]
        with killed.client.stream("GET", f"/api/plans/{name}/events") as events:
            next(line for line in events.iter_lines() if "forest" in line)
        workers = psutil.Process(killed.process.pid).children()
        killed.process.kill()
        assert all(ends(worker) for worker in workers)  # they end with their server
    with running_desk(tmp_path) as again:
        state = again.client.get(f"/api/plans/{name}").json()
        assert state["status"] in ("failed", "cancelled")
        assert again.planned(overrides=HOP)["status"] == "done"


def test_a_full_disk_is_reported_and_nothing_is_lost(tmp_path: Path) -> None:
    with running_desk(tmp_path, largest_file=4000) as full:
        kept = {"revision": 0, "mission": {"features": [], "formula": "F a"}}
        assert full.client.put("/api/mission", json=kept).json() == {"revision": 1}
        large = {"revision": 1, "mission": {"features": ["x" * 9000]}}
        answer = full.client.put("/api/mission", json=large)
        assert answer.status_code == 400
        assert "File too large" in answer.json()["error"]
        assert full.client.get("/api/mission").json()["mission"] == kept["mission"]
        state = full.planned(overrides=HOP)
        assert state["status"] == "failed"
        assert "File too large" in state["error"]
        assert full.client.get("/api/mission").json()["mission"] == kept["mission"]


def test_plans_and_mission_survive_a_restart(
    desk: RunningDesk, folder: Path, hop: dict[str, Any], tmp_path: Path
) -> None:
    shutil.copytree(folder, tmp_path / "folder", ignore=shutil.ignore_patterns("*.lock"))
    with running_desk(tmp_path / "folder") as again:
        assert hop["id"] in [state["id"] for state in again.client.get("/api/plans").json()["plans"]]
        assert again.client.get(f"/api/plans/{hop['id']}").json()["status"] == "done"
        assert again.client.get(f"/api/plans/{hop['id']}/front").status_code == 200
        assert again.client.get("/api/mission").json()["revision"] >= 0


def test_a_folder_has_one_server_at_a_time(desk: RunningDesk, folder: Path) -> None:
    words = [
        sys.executable,
        "-m",
        "pareto_ltl",
        "serve",
        "--port",
        "0",
        "--no-browser",
        "--folder",
        str(folder),
    ]
    second = subprocess.run(words, capture_output=True, text=True, check=False, timeout=MOST)
    assert second.returncode == 2
    assert not second.stdout
    assert second.stderr.count("\n") == 1
    assert f"a desk is at work in {folder} already (process {desk.process.pid} on" in second.stderr
    assert "give another --folder" in second.stderr


def test_a_plan_that_a_killed_server_had_not_begun_is_not_forgotten(tmp_path: Path) -> None:
    words = [*HOP, "planner.n_max=200000", "planner.trees=4"]
    with running_desk(tmp_path) as killed:
        first, second = (
            killed.client.post("/api/plans", json={"overrides": words}).json()["id"] for _ in range(2)
        )
        with killed.client.stream("GET", f"/api/plans/{first}/events") as events:
            next(line for line in events.iter_lines() if "forest" in line)
        killed.process.kill()
        killed.process.wait()
    with running_desk(tmp_path) as again:
        states = {state["id"]: state for state in again.client.get("/api/plans").json()["plans"]}
        assert states[second]["status"] == "failed"
        assert states[second]["error"] == "the server ended before this plan was begun; plan it again"
        assert "planner.n_max=200000" in states[second]["command"]
        assert states[first]["error"] != states[second]["error"]
        assert again.client.get(f"/api/plans/{second}").json() == states[second]


@pytest.mark.parametrize("text", ["", "[]", '{"../x": ["plan"]}', '{"20200101-000000-abcd": "plan"}', "{"])
def test_a_damaged_note_of_plans_names_none(text: str, tmp_path: Path) -> None:
    (tmp_path / "plans").mkdir()
    (tmp_path / "plans" / "queue.json").write_text(text)
    plans = Plans(DeskFolder.opened(tmp_path))
    assert plans.all_states() == []
