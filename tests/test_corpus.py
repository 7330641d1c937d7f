"""The corpus of missions (benchmarks/corpus): its parts, and one mission of each kind planned."""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
import shapely
from hydra.types import RunMode

from corpus import judging, missions, page, running
from corpus.drawing import BORDERS, Place
from corpus.winds import WINDS
from levels import AT_NIGHT
from pareto_ltl.planning.refine import flown_lines
from pareto_ltl.planning.separation import ROUNDING
from pareto_ltl.run.plan_run import UnpricedRun
from pareto_ltl.settings import SceneConfig
from pareto_ltl.support.errors import DataError, InfeasibleError
from pareto_ltl.world.scene import Scene
from pareto_ltl.world.scene_settings import scene_from_settings
from pareto_ltl_apps.cli import composition
from pareto_ltl_apps.cli.commands import run_command_line
from pareto_ltl_apps.cli.setting_keys import settings_from
from quick_wind import wind_words

SEEDS = {  # of the missions that are planned here: a small search finds their paths
    "plain": 1, "crowded": 2, "nearly a rectangle": 15, "deadline": 2, "forbidden": 6, "timed": 2,
    "five regions": 2, "coast": 2, "180 degrees": 6, "elsewhere": 2, "current": 1, "ensemble": 2,
}  # fmt: skip
SMALL = (
    "planner.trees=4", "planner.n_max=1500", "refine.points=3", "refine.flights=100",
    "refine.sweep_flights=40",
    "refine.classes=1", "selection.draws=100", "selection.runs=200", "deployment.runs=20", "report=none",
    "exports=none", *wind_words(),
)  # fmt: skip
ANSWERED = (  # the question is only whether there is a plan: a third of the time
    "planner.trees=2", "planner.n_max=500", "refine.points=2", "refine.flights=40", "refine.sweep_flights=20",
)  # fmt: skip
TENTH = [missions.of_kind(kind, seed) for kind, seed in SEEDS.items()]


@pytest.mark.parametrize("mission", TENTH, ids=lambda mission: mission.tags["kind"])
def test_a_mission_of_each_kind_has_a_plan(mission: missions.Mission, tmp_path: Path) -> None:
    words = mission.write(tmp_path / "mission")
    target = f"hydra.run.dir={tmp_path / 'run'}"
    assert run_command_line(["plan", *words, *SMALL, target]) == 0
    row = running.results(tmp_path / "run")
    assert 0.0 <= row["low"] <= row["promise"] <= row["high"] <= 1.0
    assert row["length"] > 0.0
    assert row["front"]


@pytest.mark.parametrize("number", range(100 if AT_NIGHT else 3))
def test_a_mission_that_a_line_can_fly_has_a_plan(number: int) -> None:
    """Winds that drift far from their forecast, and robots that do not know where they are."""
    kind = replace(missions.KINDS[0], winds=("held", "forecast"), vehicles=missions.AIRCRAFT)
    mission = missions.make(kind, "m", np.random.SeedSequence(20261127, spawn_key=(number,)))
    with TemporaryDirectory() as folder:
        words = [word for word in mission.write(Path(folder)) if "feedback_time" not in word]
        arguments = composition.parse_flags([*words, *SMALL, *ANSWERED])
        with composition.opened_hydra(arguments) as hydra:
            settings = settings_from(composition.composed_config(hydra, arguments, RunMode.RUN))
        run = UnpricedRun(settings)
        try:
            plan = run.plan
        except InfeasibleError as error:
            assert "robot.power.capacity" in str(error) or not flown_lines(run.problem), error
        except DataError as error:  # its made table has too few winds near the map
            assert "wind readings within" in str(error), error
        else:
            assert plan.worst is not None
            assert plan.epsilon_kept is (plan.worst.probability <= plan.epsilon * (1.0 + ROUNDING))


def test_every_kind_that_needs_no_other_files_is_planned_here() -> None:
    assert set(SEEDS) == {kind.name for kind in missions.KINDS} - {"GRIB", "stations"}


def test_a_mission_depends_only_on_the_seed_and_its_number(tmp_path: Path) -> None:
    first, again = missions.missions(4, 7), missions.missions(8, 7)
    assert len(first) <= 4
    for one, other in zip(first, again, strict=False):
        for mission, folder in ((one, "one"), (other, "other")):
            mission.write(tmp_path / folder)
        written = [
            {file.name: file.read_bytes() for file in (tmp_path / folder).iterdir() if file.suffix != ".json"}
            for folder in ("one", "other")
        ]
        assert written[0] == written[1]
    assert [m.tags for m in missions.missions(4, 8)] != [m.tags for m in first]


@pytest.fixture(scope="module")
def drawn() -> list[missions.Mission]:
    return missions.missions(40, 2)


def test_a_corpus_has_every_border_format_and_both_sides_of_a_choice(drawn: list[missions.Mission]) -> None:
    assert {mission.tags["border"] for mission in drawn} == set(BORDERS)
    assert {mission.format for mission in drawn} == {"geojson", "kml"}
    assert {bool(mission.tags["landmarks"]) for mission in drawn} == {True, False}
    assert {mission.tags["regions"] for mission in drawn} == {2, 3, 4, 5}
    assert len({mission.tags["wind"] for mission in drawn} - set(WINDS)) == 0


def areas(mission: missions.Mission, role: str) -> list[shapely.Polygon]:
    found = [f for f in mission.features if f.role == role and f.geometry == "Polygon"]
    return [shapely.Polygon(feature.points) for feature in found]


def test_regions_are_apart_from_each_other_and_from_obstacles_and_inside_the_border(
    drawn: list[missions.Mission],
) -> None:
    for mission in drawn:
        regions, obstacles = areas(mission, "region"), areas(mission, "obstacle")
        start = shapely.Point(mission.features[0].points[0])
        assert len(regions) == mission.tags["regions"]
        for number, region in enumerate(regions):
            others = [*regions[:number], *obstacles, start]
            assert not any(region.intersects(other) for other in others), mission.name
        for border in areas(mission, "border"):
            assert all(border.contains(place) for place in [*regions, start]), mission.name


def test_a_mission_departs_when_its_wind_is_known(drawn: list[missions.Mission]) -> None:
    for mission in drawn:
        wind = WINDS[mission.tags["wind"]]
        if wind.at_end:
            continue
        vehicle = missions.VEHICLES[mission.tags["vehicle"]]
        needed = missions.DETOUR * 1000 * mission.tags["tour_km"] / vehicle.u_max / 3600
        departure = np.datetime64(mission.tags["departure"].rstrip("Z")) - np.datetime64(wind.first)
        hours = departure / np.timedelta64(1, "s") / 3600
        assert 0.0 <= hours <= wind.hours - needed + 1e-2


def load(path: Path) -> Scene:
    return scene_from_settings(SceneConfig(file=str(path)))


def test_kml_and_geojson_of_a_mission_are_one_map(tmp_path: Path) -> None:
    mission = next(m for m in missions.missions(30, 3) if m.tags["landmarks"] and m.tags["obstacles"] > 3)
    for suffix, write in missions.WRITERS.items():
        write(mission.features, tmp_path / f"map.{suffix}")
    one, other = load(tmp_path / "map.geojson"), load(tmp_path / "map.kml")
    assert sorted(one.regions) == sorted(other.regions)
    assert len(one.obstacles) == len(other.obstacles)
    assert len(one.landmarks) == len(other.landmarks) > 0
    for mine, theirs in zip(one.obstacles, other.obstacles, strict=True):
        np.testing.assert_allclose(mine, theirs, atol=0.02)  # [m], digits of degrees


@pytest.mark.parametrize("name", [name for name in BORDERS if BORDERS[name]])
def test_a_border_has_the_size_of_the_map_across_180_degrees_too(name: str) -> None:
    draw, half = BORDERS[name], 50e3
    assert draw is not None
    for lon in (20.0, 179.9, -179.9):
        corners = draw(Place(40.0, lon), half)
        wide, tall = np.ptp(corners, axis=0) * 111.2e3 * np.array([np.cos(np.deg2rad(40.0)), 1.0])
        np.testing.assert_allclose([wide, tall], 2 * half, rtol=0.16)


def row(seed: int, promise: float, length: float, **more: Any) -> dict[str, Any]:
    """A row of a run whose front is its plan, with an interval of 10 %."""
    low, high = 0.9 * promise, min(1.0, 1.1 * promise)
    found = {"mission": "m", "variant": "full", "seed": seed, "code": 0, "cpu": 10.0, "cold": False}
    found |= {
        "promise": promise,
        "low": low,
        "high": high,
        "length": length,
        "origin": "refined",
        "order": "a",
    }
    return found | {"front": [[promise, low, high, length]]} | more


def failed(seed: int, code: int = 2) -> dict[str, Any]:
    return {
        "mission": "m",
        "variant": "full",
        "seed": seed,
        "code": code,
        "cpu": 1.0,
        "cold": False,
        "said": "no",
    }


def test_hypervolumes_are_areas_of_rectangles() -> None:
    one, other = [[0.5, 0, 0, 10.0]], [[0.25, 0, 0, 15.0]]
    # Below failure 1 and length 30: 0.5 x 20 and 0.75 x 15, of which 0.5 x 15 are common.
    assert judging.relative_volumes([one, other, []]) == pytest.approx([10 / 13.75, 11.25 / 13.75, 0.0])
    assert judging.relative_volumes([[], []]) == []


def test_failures_of_seeds_are_compared_at_the_lengths_that_all_of_them_reach() -> None:
    """Three fronts with one slope: failure c / length, so that the ratios are those of c."""
    fronts = [[[c / at, 0, 0, at] for at in (10.0, 20.0, 40.0)] for c in (1.0, 2.0, 3.0)]
    fronts[0] += [[1e-9, 0, 0, 1e3]]  # beyond the others
    assert judging.relative_failures([*fronts, []]) == pytest.approx([0.5, 1.0, 1.5])
    assert judging.relative_failures([fronts[0], []]) == []
    far = [[0.5, 0, 0, 100.0]]
    assert judging.relative_failures([fronts[1], far]) == []
    nothing = [[[0.0, 0, 0, 10.0]], [[0.0, 0, 0, 10.0]]]
    assert judging.relative_failures(nothing) == pytest.approx([1.0, 1.0])


@pytest.mark.parametrize(("worst", "equal"), [(0.11, True), (0.13, False)])
def test_the_summary_says_how_far_fronts_of_seeds_lie_apart(worst: float, equal: bool) -> None:
    rows = [row(seed, promise, 1e3) for seed, promise in enumerate((0.1, 0.1, worst))]
    judged = judging.judge(rows, {"m": {}})
    goals = {goal.text: goal for goal in judging.summary(judged, None)}
    assert judged[0].equal is equal
    assert goals["worst seed fails at most 1.15 x the median at equal length"].met is equal
    ratio = f"{worst / 0.1:.2f}"
    assert (
        goals["failure at equal length, worst seed over the median"].value
        == f"{ratio} (median), {ratio} (largest)"
    )
    least = (1.0 - worst) / 0.9  # of rectangles between 1 km and 2 km
    assert goals["hypervolume of the worst seed over that of all"].value.startswith(f"{least:.3f} (median)")


@pytest.mark.parametrize(
    ("promises", "agrees"),
    [([0.1, 0.11, 0.12], True), ([0.1, 0.1, 0.14], False), ([0.001, 0.001, 0.009], True), ([0.1], True)],
)
def test_seeds_agree_if_the_worst_is_small_or_near_the_median(promises: list[float], agrees: bool) -> None:
    rows = [row(seed, promise, 1e3) for seed, promise in enumerate(promises)]
    judged = judging.judge(rows, {"m": {}})[0]
    assert judged.agrees is agrees
    assert not judging.judge([*rows, failed(9)], {"m": {}})[0].agrees


def test_a_run_is_worse_only_beyond_both_intervals_and_if_it_is_not_shorter() -> None:
    better = row(0, 0.1, 1000.0)
    assert judging.why_worse(row(0, 0.115, 1000.0), better) == ""
    assert "promises 20 % instead of 10 %" in judging.why_worse(row(0, 0.2, 1000.0), better)
    shorter = row(0, 0.2, 500.0, front=[*better["front"], [0.2, 0.18, 0.22, 500.0]])
    assert judging.why_worse(shorter, better) == ""
    assert "least failure" in judging.why_worse(row(0, 0.2, 500.0), better)
    assert judging.why_worse(failed(0, 1), better) == "exit code 1"
    assert judging.why_worse(better, failed(0)) == ""


def test_the_summary_counts_what_the_rows_say() -> None:
    rows = [row(0, 0.1, 1e3), row(1, 0.2, 1e3), failed(2, 1)]
    rows += [
        row(0, 0.05, 1e3, variant="quick"),
        row(1, 0.2, 1e3, variant="quick"),
        row(0, 0.1, 1e3, variant="bare"),
    ]
    goals = {goal.text: goal for goal in judging.summary(judging.judge(rows, {"m": {}}), 4.0)}
    assert goals["runs by exit code"].value == "0: 5, 1: 1"
    assert goals["runs with an internal error"].met is False
    rows[0] |= {"epsilon_kept": 0.0}
    goals = {goal.text: goal for goal in judging.summary(judging.judge(rows, {"m": {}}), 4.0)}
    assert goals["plans that satisfy planner.epsilon"].value == "4 of 5"
    assert goals["worst seed promises at most 1.3 x the median"].value == "0 of 1 (0 %)"
    assert goals["full is worse than quick, beyond the noise"].value == "1 of 2 runs"
    assert goals["landmarks hurt, beyond the noise"].met is True
    assert goals["points of a quick front that full misses"].value == "1 of 2"
    assert goals["median CPU time"].value == "10.0 s, 2.5 units of 4.0 s"


def asked(**more: Any) -> argparse.Namespace:
    return argparse.Namespace(words=[], limit=60.0, jobs=2, **more)


def test_a_finished_run_is_not_repeated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ran: list[running.Task] = []

    def run_one(task: running.Task, *_: Any) -> dict[str, Any]:
        ran.append(task)
        return row(task.seed, 0.1, 1e3, mission=task.mission, variant=task.variant)

    monkeypatch.setattr(running, "run_one", run_one)
    wanted = [running.Task("m", variant, seed) for variant in ("full", "quick") for seed in (0, 1)]
    running.run_all(wanted[:2], tmp_path, asked())
    with (tmp_path / "rows.jsonl").open("a") as file:
        file.write('{"mission": "m", "vari')  # of a process that was killed
    running.run_all(wanted, tmp_path, asked())
    assert sorted(task.key for task in ran) == sorted(task.key for task in wanted)
    assert len(running.read_rows(tmp_path)) == 4


def test_only_missions_with_landmarks_are_planned_without_them(
    drawn: list[missions.Mission], tmp_path: Path
) -> None:
    found = running.tasks(drawn, [0], ["full", "bare"])
    bare = {task.mission for task in found if task.variant == "bare"}
    assert bare == {mission.name for mission in drawn if mission.tags["landmarks"]}
    mission = next(mission for mission in drawn if mission.name in bare)
    running.prepare([mission], tmp_path, {})
    words = running.command(running.Task(mission.name, "bare", 0), tmp_path, [])
    file = next(word for word in words if word.startswith("scene.file=")).removeprefix("scene.file=")
    assert len(load(Path(file)).landmarks) == 0


def test_a_folder_with_runs_of_other_missions_is_refused(tmp_path: Path) -> None:
    running.prepare([], tmp_path, {"seed": 1})
    running.prepare([], tmp_path, {"seed": 1})
    with pytest.raises(SystemExit, match="choose another --out"):
        running.prepare([], tmp_path, {"seed": 2})


def test_the_page_shows_every_mission_without_scripts(drawn: list[missions.Mission], tmp_path: Path) -> None:
    chosen = drawn[:6]
    running.prepare(chosen, tmp_path, {})
    rows = [row(seed, 0.1, 1e3, mission=mission.name) for mission in chosen for seed in (0, 1)]
    rows[0] |= {"code": 2, "said": "no <path> & no reason"}
    judged = judging.judge(rows, running.read_tags(tmp_path))
    text = page.write_page(judged, tmp_path, 10.0, ["planner.trees=4"]).read_text()
    assert "<script" not in text
    assert "http" not in text
    assert "no &lt;path&gt; &amp; no reason" in text
    assert text.count("<circle") == 2 * len(rows) - 1 - len(chosen)
    for mission in chosen:
        assert f'id="{mission.name}"' in text


@pytest.mark.parametrize(
    ("rate", "place"), [(1e-4, 6.0), (1e-6, 6.0), (1.0, page.WIDTH - 6.0), (1e-2, page.WIDTH / 2)]
)
def test_rates_are_on_a_logarithmic_axis(rate: float, place: float) -> None:
    assert page.across(rate) == pytest.approx(place)


def test_the_record_of_a_mission_has_its_words(tmp_path: Path) -> None:
    mission = missions.missions(3, 5)[0]
    words = mission.write(tmp_path)
    assert json.loads((tmp_path / "mission.json").read_text())["words"] == words
    assert f"mission.start_time={mission.tags['departure']}" in words
