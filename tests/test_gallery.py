"""The gallery of the documentation: its page, its pictures, and the command that makes them."""

from __future__ import annotations

import io
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import gallery
from drawn_world import flights_of, path_of, scene_of
from figure_texts import texts_of, texts_outside, wrong_texts
from pareto_ltl_apps.view import style
from pareto_ltl_apps.view.figures import Drawing, draw_record
from pareto_ltl_apps.view.plan_maps import frames_figure

MOST = 1_500_000  # bytes of all pictures


def test_the_page_is_that_of_the_command_and_shows_every_picture() -> None:
    text = (gallery.DOCS / "gallery.md").read_text(encoding="utf-8")
    assert text == gallery.page_text(gallery.PICTURES, "images/gallery")
    shown = re.findall(r"!\[.*\]\((.*)\)", text)
    assert [Path(image).stem for image in shown] == [picture.name for picture in gallery.PICTURES]
    assert {path.name for path in gallery.IMAGES.iterdir()} == {Path(image).name for image in shown}


def test_the_pictures_are_small_and_the_readme_shows_the_strip() -> None:
    strip = gallery.IMAGES.parent / f"{gallery.STRIP.name}.png"
    pictures = [*gallery.IMAGES.iterdir(), strip]
    assert sum(path.stat().st_size for path in pictures) < MOST
    for path in pictures:
        with Image.open(path) as image:
            assert min(image.size) > 150
    assert f"docs/images/{strip.name}" in (gallery.ROOT / "README.md").read_text(encoding="utf-8")


def test_a_picture_of_few_colours_looks_like_its_drawing() -> None:
    drawing = draw_record(scene_of())
    packed = Image.open(io.BytesIO(gallery.picture_bytes(drawing, dpi=60))).convert("RGB")
    with style.report_style():
        content = style.figure_bytes(drawing.figure, "png", 60)
    plain = Image.open(io.BytesIO(content)).convert("RGB")
    apart = np.abs(np.asarray(packed, int) - np.asarray(plain, int))
    assert packed.size == plain.size
    assert apart.mean() < 2.0
    assert np.quantile(apart, 0.99) < 32


def test_each_picture_is_made_from_missions_that_are_planned_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[str] = []

    def drawn(name: str) -> gallery.Picture:
        def draw(missions: gallery.Missions) -> Drawing:
            assert missions["phi2"] is missions["phi2"]
            return draw_record(scene_of())

        return gallery.Picture(name, name, "", draw)

    monkeypatch.setattr(
        gallery.pareto_ltl, "plan", lambda scene, formula, **_: asked.append(scene) or object()
    )
    files = gallery.make_pictures(tmp_path, [drawn("one"), drawn("two")], gallery.Missions(planner="quick"))
    assert [path.name for path in files] == ["one.png", "two.png"]
    assert asked == ["phi2"]


def test_every_mission_of_the_gallery_has_a_map_that_is_read() -> None:
    for name, wanted in gallery.MISSIONS.items():
        scene = wanted()["scene"]
        if isinstance(scene, dict) and "file" in scene:
            assert Path(scene["file"]).is_file(), name
    timed = gallery.timed_map()
    assert set(timed["windows"]) <= set(timed["regions"])


def test_the_command_refuses_a_picture_that_is_none() -> None:
    command = [sys.executable, str(gallery.ROOT / "benchmarks" / "gallery.py"), "--only", "nonsense"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "flights_strip" in done.stderr


def test_a_strip_shows_each_moment_and_names_the_law() -> None:
    scene = scene_of()
    path = path_of(scene)
    flights = flights_of(path, runs=60, law="coherent")
    with style.report_style():
        figure = frames_figure(scene, flights, path.t, frames=4, count=60)
        said = texts_of(figure)
        assert texts_outside(figure) == []
    assert wrong_texts(said) == []
    assert len(figure.axes) == 4
    assert [text for text in said if text.endswith("after departure")] == [
        f"{hours} after departure" for hours in ("5.5 h", "11 h", "17 h", "22.5 h")
    ]
    assert any("60 of 60 simulated flights of one plan, coherent winds; 3 of those" in text for text in said)
    with pytest.raises(TypeError, match="needs plan="):
        flights.plot(scene=scene, frames=4)
