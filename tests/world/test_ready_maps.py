"""The ready maps lie where the documents say."""

from __future__ import annotations

import re

import pytest

import pareto_ltl
from careful_io.texts import distance_text
from documents import ROOT
from pareto_ltl.support.resources import CONF, resource_folder
from pareto_ltl_apps.exports.geojson import border_corners


def stated(name: str) -> tuple[str, str, str]:
    """Where a ready map lies, its size and its regions, as text."""
    scene = pareto_ltl.read_map(name)
    low, high = scene.bounds
    lon, lat = scene.frame.outline_degrees(border_corners(scene.bounds)).T
    east, north = (distance_text(side, 0).removesuffix(" km") for side in high - low)
    where = f"{lat.min():.1f} to {lat.max():.1f}° N, {-lon.max():.1f} to {-lon.min():.1f}° W"
    return where, f"{east} x {north} km", ", ".join(sorted(scene.regions))


def experiments(name: str) -> list[str]:
    files = sorted(resource_folder("conf").glob("experiment/*.yaml"))
    return [file.stem for file in files if f"override /scene: {name}\n" in file.read_text(encoding="utf-8")]


@pytest.mark.parametrize("name", CONF.names("scene"))
def test_the_page_of_maps_says_where_a_ready_map_lies(name: str) -> None:
    page = (ROOT / "docs" / "maps.md").read_text(encoding="utf-8")
    row = f"| `{name}` | {' | '.join(stated(name))} | "
    rest = re.search(re.escape(row) + r"(.*) \|\n", page)
    assert rest, f"docs/maps.md has no line that begins {row}"
    assert re.findall(r"`(\w+)`", rest[1]) == experiments(name)


@pytest.mark.parametrize("name", CONF.names("scene"))
def test_the_text_of_read_map_says_where_a_ready_map_lies(name: str) -> None:
    text = " ".join((pareto_ltl.read_map.__doc__ or "").split())
    listed = re.search(rf'``"{name}"``[^(]*\(([^)]*)\)', text)
    assert listed
    assert listed[1] == stated(name)[0]
