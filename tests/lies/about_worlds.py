"""False values in the map and the mission."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from lies.editing import (
    Lie,
    both,
    in_json,
    in_plan,
    in_settings,
    moved,
    put,
    setting,
    shrunk,
)


def _shrink_obstacle(content: dict[str, Any]) -> None:
    content["obstacles"][0] = shrunk(content["obstacles"][0])


def _move_region(content: dict[str, Any]) -> None:
    content["regions"]["a"] = moved(content["regions"]["a"], 5000.0)


def _move_part(content: dict[str, Any]) -> None:
    content["regions"]["a"][0] = moved(content["regions"]["a"][0], 5000.0)


def _unlabel(content: dict[str, Any]) -> None:
    content["labels"][content["labels"].index(["b"])] = []


def _shortcut(content: dict[str, Any]) -> None:
    last = len(content["delta"]) - 1
    content["delta"][0] = [last if target else target for target in content["delta"][0]]


def _other_formula(place: Path) -> None:
    text = "F(a & F(b & F c))"
    in_json("automaton.json", lambda a: a.update(formula=text))(place)
    in_plan(lambda p: p.update(formula=text))(place)
    hoa = place / "automaton.hoa"
    hoa.write_text(hoa.read_text().replace("F(a & F b & F c)", text))
    setting("mission", "formula", text)(place)


def _hoa_edge(place: Path) -> None:
    hoa = place / "automaton.hoa"
    hoa.write_text(hoa.read_text().replace("State: 0\n[!0] 0\n[0] 1\n", "State: 0\n[!1] 0\n[1] 1\n"))


WORLD_LIES = (
    Lie(
        "a door is gone",
        in_json("cells.json", lambda c: c["doors"].pop(5)),
        ("map: doors join all cells that touch",),
    ),
    Lie(
        "a door leads elsewhere",
        in_json("cells.json", lambda c: put(c, "doors", 0, 1, value=c["doors"][0][1] + 2)),
        ("map: doors join all cells that touch",),
    ),
    Lie(
        "the map is elsewhere",
        in_json("scene.json", lambda c: c.update(crs=c["crs"].replace("lat_0=37", "lat_0=38"))),
        ("map: projection",),
    ),
    Lie(
        "the departure is another",
        in_json("scene.json", lambda c: c.update(time_zero="2018-10-09T06:00:00Z")),
        ("map: departure",),
    ),
    Lie(
        "an obstacle is smaller in scene.json",
        in_json("scene.json", _shrink_obstacle),
        ("map: scene.json is the map of the settings", "map: convex parts are the polygons"),
    ),
    Lie(
        "an obstacle is smaller in both files",
        both(in_json("scene.json", _shrink_obstacle), in_json("cells.json", _shrink_obstacle)),
        ("map: scene.json is the map of the settings", "map: cells cover the free space once"),
    ),
    Lie(
        "the settings ask for an obstacle at a random place",
        in_settings(lambda told: told["scene"]["random"].update(obstacles=1)),
        ("map: scene.json is the map of the settings",),
    ),
    Lie(
        "an obstacle is gone",
        both(*(in_json(name, lambda c: c["obstacles"].pop(0)) for name in ("scene.json", "cells.json"))),
        ("map: scene.json is the map of the settings",),
    ),
    Lie(
        "a region is elsewhere",
        in_json("scene.json", _move_region),
        ("map: scene.json is the map of the settings", "map: convex parts are the polygons"),
    ),
    Lie(
        "a part is elsewhere",
        in_json("cells.json", _move_part),
        ("map: convex parts are the polygons", "map: cells cover the free space once"),
    ),
    Lie(
        "a cell has lost its label",
        in_json("cells.json", _unlabel),
        ("map: cells cover the free space once",),
    ),
    Lie(
        "a cell is gone",
        in_json("cells.json", lambda c: (c["cells"].pop(), c["labels"].pop())),
        ("map: cells cover the free space once",),
    ),
    Lie(
        "a door joins cells that are apart",
        in_json("cells.json", lambda c: c["doors"].append([0, 1])),
        ("map: doors join all cells that touch",),
    ),
    Lie(
        "a transition is another",
        in_json("automaton.json", _shortcut),
        ("mission: automaton follows from the formula", "mission: automaton.hoa is automaton.json"),
    ),
    Lie(
        "a state accepts",
        in_json("automaton.json", lambda a: put(a, "accepting", 1, value=True)),
        ("mission: automaton follows from the formula",),
    ),
    Lie("an edge of the HOA file is another", _hoa_edge, ("mission: automaton.hoa is automaton.json",)),
    Lie(
        "the formula is another everywhere", _other_formula, ("mission: automaton follows from the formula",)
    ),
    Lie(
        "the formula of the plan is another",
        in_plan(lambda p: p.update(formula="F a")),
        ("mission: one formula in all files",),
    ),
    Lie(
        "a distance is another",
        in_json("automaton.json", lambda a: put(a, "d_A", 0, value=1.0)),
        ("mission: distance to acceptance",),
    ),
    Lie(
        "a letter is gone",
        in_json("automaton.json", lambda a: (a["letters"].pop(), [row.pop() for row in a["delta"]])),
        ("mission: letters are the labels of the map",),
    ),
)
