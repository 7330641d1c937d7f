"""Times of regions and obstacles on maps."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drawn_world import UNIT, decomposition_of, run_records, scene_of
from figure_texts import texts_of, texts_outside, wrong_texts
from pareto_ltl.world.scene import Scene
from pareto_ltl.world.windows import Window
from pareto_ltl_apps.view import style
from pareto_ltl_apps.view.figures import draw_record
from pareto_ltl_apps.view.map import plan_figure
from pareto_ltl_apps.view.map_layers import short_span, time_lines, timed_obstacles, visited_outlines
from pareto_ltl_apps.view.records import DrawnRun
from pareto_ltl_apps.view.settings import ReportConfig

HOUR = 3600.0
STORM = np.array([(3.0, 7.9), (3.9, 7.9), (3.9, 8.8), (3.0, 8.8)]) * UNIT
WINDOWS = {
    "a": Window("a", 0.0, 6 * HOUR),
    "b_late": Window("b", 20 * HOUR),
    "closed": Window("c", 3 * HOUR, 4.5 * HOUR),
    "storm": Window("storm", 2 * HOUR, 9 * HOUR),
    "clock": Window(None, 0.0, HOUR),
}


@pytest.fixture
def scene() -> Scene:
    """``a`` until 6 h, ``b`` also from 20 h on, ``c`` closed for a while, and a storm."""
    plain = scene_of()
    windows = {name: window for name, window in WINDOWS.items() if window.region is not None}
    return replace(
        plain, regions={**plain.regions, "storm": STORM}, windows=windows, forbidden=("closed", "storm")
    )


@pytest.mark.parametrize(
    ("window", "told"),
    [
        (Window("a", 3 * HOUR, 5 * HOUR), "3 to 5 h"),
        (Window("a", 0.5 * HOUR, 1.5 * HOUR), "30 min to 1.5 h"),
        (Window("a", -HOUR, 5 * HOUR), "until 5 h"),
        (Window("a", -math.inf, 90.0), "until 1.5 min"),
        (Window("a", 20 * HOUR), "from 20 h"),
        (Window("a"), "at any time"),
    ],
)
def test_a_window_is_told_in_few_letters(window: Window, told: str) -> None:
    assert short_span(window) == told


def test_each_region_has_a_line_for_each_of_its_windows(scene: Scene) -> None:
    assert {name: time_lines(scene, name) for name in scene.regions} == {
        "a": ["until 6 h"],
        "b": ["b_late from 20 h"],
        "c": ["forbidden 3 to 4.5 h"],
        "storm": ["forbidden 2 to 9 h"],
    }


def test_what_only_stands_for_an_obstacle_is_no_region_to_visit(scene: Scene) -> None:
    assert len(visited_outlines(scene)) == 3
    assert {outline.tobytes() for outline in timed_obstacles(scene)} == {
        STORM.tobytes(),
        scene.regions["c"][0].tobytes(),
    }
    assert timed_obstacles(scene_of()) == ()


def test_the_map_of_a_plan_shows_the_times(scene: Scene) -> None:
    records = run_records() | {"scene": scene, "decomposition": decomposition_of(scene)}
    with style.report_style():
        figure = plan_figure(ReportConfig(), DrawnRun(**records))
        said = texts_of(figure)
        assert wrong_texts(said) == []
        assert texts_outside(figure) == []
    lines = {line for name in scene.regions for line in time_lines(scene, name)}
    assert {part for line in lines for part in line.replace("forbidden ", "forbidden|").split("|")} <= set(
        said
    )
    assert "region, with times" in said
    assert "obstacle for a time" in said
    hatched = [drawn for drawn in figure.axes[0].collections if drawn.get_hatch()]
    assert [len(drawn.get_paths()) for drawn in hatched] == [2]


def test_a_map_without_times_does_not_speak_of_them() -> None:
    with style.report_style():
        figure = plan_figure(ReportConfig(), DrawnRun(**run_records()))
        said = texts_of(figure)
    assert "region" in said
    assert not [text for text in said if "departure" in text]
    assert not any(len(drawn.get_paths()) for drawn in figure.axes[0].collections if drawn.get_hatch())


def test_names_with_times_stay_on_the_map(scene: Scene, tmp_path: Path) -> None:
    small = replace(scene, regions={**scene.regions, "storm": 0.05 * STORM})  # in the south-west corner
    drawing = draw_record(small)
    assert drawing.save(tmp_path / "map.png").stat().st_size > 2000
    ax = drawing.figure.axes[0]
    renderer = drawing.figure.canvas.get_renderer()  # type: ignore[attr-defined]
    frame = ax.get_window_extent(renderer)
    for text in ax.texts:
        box = text.get_window_extent(renderer)
        assert frame.x0 - 2 <= box.x0 <= box.x1 <= frame.x1 + 2, text.get_text()
        assert frame.y0 - 2 <= box.y0 <= box.y1 <= frame.y1 + 2, text.get_text()
