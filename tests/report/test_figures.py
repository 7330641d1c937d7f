"""Pictures: complete, readable, and the same every time."""

from __future__ import annotations

import os
import pathlib
import re
from dataclasses import replace
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from drawn_world import (
    REGIONS,
    decomposition_of,
    forest_of,
    front_of,
    plan_of,
    run_records,
    scene_of,
    wind_of,
)
from pareto_ltl.planning.records import Front
from pareto_ltl.settings import preset
from pareto_ltl_apps.view import style
from pareto_ltl_apps.view.figures import draw_run_figures
from pareto_ltl_apps.view.front import front_figure
from pareto_ltl_apps.view.records import DrawnRun
from pareto_ltl_apps.view.settings import ReportConfig


@pytest.fixture(scope="module")
def records():
    return run_records()


def drawn(folder: pathlib.Path, records: dict[str, Any], **changes: Any) -> dict[str, pathlib.Path]:
    files = draw_run_figures(
        folder, ReportConfig(dpi=60, formats=["png", "svg"]), DrawnRun(**(records | changes))
    )
    return {file.name: file for file in files}


def size_of(png: pathlib.Path) -> tuple[int, int]:
    """Width and height from the header of a PNG file."""
    head = png.read_bytes()[:24]
    assert head[:8] == b"\x89PNG\r\n\x1a\n"
    return int.from_bytes(head[16:20], "big"), int.from_bytes(head[20:24], "big")


def text_of(svg: pathlib.Path) -> str:
    """What the drawing says: glyphs are drawn as outlines, the strings stand in comments."""
    said = " ".join(re.findall(r"<!-- (.*?) -->", svg.read_text(encoding="utf-8")))
    return said.replace("\N{NO-BREAK SPACE}", " ")


def test_figures_are_png_files_unless_others_are_asked_for(tmp_path, records):
    files = draw_run_figures(tmp_path, ReportConfig(dpi=30), DrawnRun(**records))
    assert {file.name for file in files} == {"plan.png", "front.png", "wind.png"} == set(os.listdir(tmp_path))


def test_plan_front_and_wind_are_written_as_png_and_svg(tmp_path, records):
    files = drawn(tmp_path / "figures", records)
    assert set(files) == {f"{name}.{kind}" for name in ("plan", "front", "wind") for kind in ("png", "svg")}
    for name, file in files.items():
        if name.endswith(".svg"):
            assert ElementTree.parse(file).getroot().tag.endswith("svg")
            assert file.stat().st_size < 2_000_000


def test_the_resolution_is_the_one_asked_for(tmp_path, records):
    coarse = size_of(drawn(tmp_path / "coarse", records)["plan.png"])
    fine = draw_run_figures(tmp_path / "fine", ReportConfig(dpi=120), DrawnRun(**records))
    twice = size_of(next(file for file in fine if file.name == "plan.png"))
    np.testing.assert_allclose(twice, np.multiply(coarse, 2), atol=2)


def test_the_same_records_give_the_same_bytes(tmp_path, records):
    one, two = drawn(tmp_path / "one", records), drawn(tmp_path / "two", records)
    assert {name: file.read_bytes() for name, file in one.items()} == {
        name: file.read_bytes() for name, file in two.items()
    }


def test_the_map_names_its_regions_and_states_the_promise(tmp_path, records):
    words = text_of(drawn(tmp_path, records)["plan.svg"])
    assert "east [km]" in words
    assert "north [km]" in words
    for name in REGIONS:
        assert re.search(rf"\b{name}\b", words)
    assert "planned in independent winds: f_o ≤ 0.020 %, R ≤ 0.30 %" in words


def test_without_a_plan_trees_and_wind_are_still_drawn(tmp_path, records):
    nothing = forest_of(records["scene"], accepted=False)
    files = drawn(tmp_path, records, forest=nothing, front=None, plan=None, deployments={})
    assert set(files) == {"plan.png", "plan.svg", "wind.png", "wind.svg"}
    assert "no path completes the mission" in text_of(files["plan.svg"])


def test_a_risk_of_zero_is_shown_at_a_floor_that_says_so(tmp_path, records):
    scene = records["scene"]
    front = front_of(scene, risks=(0.0, 0.01), collisions=(0.0, 0.02))
    words = text_of(drawn(tmp_path, records, front=front, plan=plan_of(front.paths[0]))["front.svg"])
    assert "≤ " in words


@pytest.mark.parametrize(
    ("bound", "label", "risks"),
    [
        ("ordered", "mission risk V, coherent winds [%]", [0.2, 0.1]),
        ("theorem2", "mission risk f_o, independent winds [%]", [0.004, 0.002]),
    ],
)
def test_the_front_shows_the_judged_risk_under_its_name_without_a_plan_too(
    tmp_path, records, bound, label, risks
):
    scene = records["scene"]

    def costs(objectives, v, f):
        judged = {"ordered": v, "theorem2": f}[bound]
        return replace(objectives, mission_risk=judged, mission_risk_paper=f, mission_risk_ordered=v)

    paths = tuple(
        replace(path, objectives=costs(path.objectives, v, f))
        for path, v, f in zip(front_of(scene).paths, (0.2, 0.1), (0.004, 0.002), strict=False)
    )
    models = preset("full" if bound == "ordered" else "paper")
    front = Front(paths, tuple(path.objectives for path in paths), 0.5, np.ones(3), models=models)
    changes = {"front": front, "plan": None, "deployments": {}}
    words = text_of(drawn(tmp_path, records, **changes)["front.svg"])
    assert label in words
    figure = front_figure(DrawnRun(scene), front)
    axes = figure.axes[0]
    assert axes.get_ylabel() == label
    np.testing.assert_allclose(axes.collections[-1].get_offsets()[:, 1], risks)


def test_a_plane_that_lies_nowhere_on_earth_has_no_meridians(tmp_path, records):
    words = text_of(drawn(tmp_path, records, scene=scene_of(crs=None))["plan.svg"])
    assert "°W" not in words
    assert "°W" in text_of(drawn(tmp_path / "earth", records)["plan.svg"])


def test_a_small_map_is_labelled_in_metres(tmp_path):
    scene = scene_of(crs=None, scale=10.0)
    front, wind = front_of(scene), wind_of()
    records = {
        "scene": scene, "decomposition": decomposition_of(scene),
        "wind": replace(wind, origin=wind.origin * 1e-4, spacing=wind.spacing * 1e-4),
        "forest": forest_of(scene), "front": front, "plan": plan_of(front.paths[0]), "deployments": {},
    }  # fmt: skip
    assert "east [m]" in text_of(drawn(tmp_path, records)["plan.svg"])


def test_a_word_without_end_is_cut_with_few_measurements(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[int] = []
    honest = style.text_width
    monkeypatch.setattr(style, "text_width", lambda text, size: asked.append(len(text)) or honest(text, size))
    (line,) = style.fitted_lines("a" * 5000, 3.0, 10.0, most=1)
    assert line.endswith("...")
    assert 2.5 < honest(line, 10.0) <= 3.0
    assert honest(line[:-3] + "a...", 10.0) > 3.0
    assert len(asked) < 15
