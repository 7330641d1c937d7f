"""The schemas are valid, ship with the package, accept what the program writes and name what is wrong."""

from __future__ import annotations

import json
import random
from copy import deepcopy
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from pareto_ltl.support import schemas
from pareto_ltl.support.errors import DataError
from pareto_ltl.support.schemas import SCHEMA_NAMES, check_document, read_document, schema_text

SQUARE = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
SCENE: dict[str, Any] = {
    "bounds": [[0, 0], [4, 1]],
    "start": [0.5, 0.5],
    "regions": {"a": SQUARE},
    "obstacles": [SQUARE, SQUARE],
}
RUN = {"status": "ok", "inputs": {"wind.csv": "0" * 64}, "packages": {"numpy": "2.1", "moocore": None}}


@pytest.mark.parametrize("name", SCHEMA_NAMES)
def test_a_schema_is_one_of_draft_2020_12(name: str) -> None:
    schema = json.loads(schema_text(name))
    assert schema["$schema"] == "https://json-schema.org/draft/2020-12/schema"
    jsonschema.Draft202012Validator.check_schema(schema)


def test_every_schema_of_the_folder_has_a_name() -> None:
    found = {path.name.removesuffix(".schema.json") for path in schemas.FOLDER.glob("*.json")}
    assert found == set(SCHEMA_NAMES)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("scene", {**SCENE, "start": "a"}, '/start: expected an array of 2 numbers, got "a"'),
        ("scene", {**SCENE, "start": [1, True]}, "/start/1: expected a number of metres, at"),
        ("scene", {**SCENE, "start": [1, 2, 3]}, "/start: expected an array of 2 numbers, got [1, 2, 3]"),
        ("scene", {**SCENE, "obstacles": [[[0, 1e300], *SQUARE]]}, "/obstacles/0/0/1: expected a number"),
        ("scene", {**SCENE, "obstacles": [SQUARE[:2]]}, "/obstacles/0: expected an array of at least 3"),
        ("scene", {**SCENE, "regions": {"a b": None}}, "/regions/a b: expected an array of at"),
        ("scene", {**SCENE, "crs": 1}, "/crs: expected text or null, got 1"),
        ("scene", {"bounds": [], "start": []}, "lacks 'regions', 'obstacles'"),
        ("scene", [], "expected scene.json: the map of a run"),
        ("metrics", {"completed": 1, "length_m": "9"}, "/length_m: expected a number or null, at"),
        ("metrics", {"completed": None}, "/completed: expected a number, got null"),
        ("metrics", {"completed": 1, "failure_coherent": 1.5}, "/failure_coherent: expected a share"),
        ("metrics", {"completed": 1, "collision_risk": 1.5, "runs_a": -1}, "/runs_a: expected a number of"),
        ("metrics", {"completed": 1, "length_m": 1e308}, "/length_m: expected a number or null"),
        ("run", {**RUN, "inputs": {"a": 1}}, "/inputs/a: expected text, got 1"),
        ("run", {**RUN, "git": "main"}, '/git: expected an object, or null, got "main"'),
        ("run", {"status": "a" * 5000}, '/status: expected a word, got "aaa'),
        ("run", {}, "lacks 'status'"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_named_with_its_place(name: str, content: Any, message: str) -> None:
    with pytest.raises(DataError) as caught:
        check_document(content, name, "x.json")
    assert str(caught.value).startswith(f"x.json: {message}")
    assert str(caught.value).endswith("; run the plan again")
    assert "\n" not in str(caught.value)


def test_a_long_wrong_value_is_cut(tmp_path: Path) -> None:
    (tmp_path / "run.json").write_text(json.dumps({"status": ["running"] * 1000}))
    with pytest.raises(DataError, match=r'/status: expected a word, got \["running", .*\.\.\.; run'):
        read_document(tmp_path / "run.json", "run")


NASTY = [None, True, "x", [], {}, -1, 1.5, 1e300, 2**60, [[]], [1, 2], [[1, 2], [3, "4"]]]


def spoilt(content: Any, draw: random.Random) -> Any:
    """``content`` with one value anywhere replaced."""
    content = deepcopy(content)
    place, depth = content, draw.randrange(5)
    while True:
        keys = list(place) if isinstance(place, dict) else list(range(len(place)))
        key = draw.choice(keys)
        if depth == 0 or not isinstance(place[key], list | dict) or not place[key]:
            place[key] = draw.choice(NASTY)
            return content
        place, depth = place[key], depth - 1


def fits(content: Any, name: str) -> bool:
    """Whether the check accepts ``content``."""
    try:
        check_document(content, name, "x.json")
    except DataError:
        return False
    return True


CELLS = {
    "cells": [SQUARE],
    "labels": [["a"]],
    "doors": [[0, 1], [1, 2]],
    "obstacles": [],
    "regions": {"a": [SQUARE]},
}


@pytest.mark.parametrize(
    ("name", "content"), [("scene", SCENE), ("cells", CELLS), ("metrics", {"completed": 1.0, "a": None})]
)
def test_a_check_decides_as_jsonschema_does(name: str, content: Any) -> None:
    plain = jsonschema.Draft202012Validator(json.loads(schema_text(name)))
    draw = random.Random(name)
    cases = [content, *(spoilt(content, draw) for _ in range(400))]
    verdicts = [plain.is_valid(case) for case in cases]
    assert [fits(case, name) for case in cases] == verdicts
    assert 0 < sum(verdicts) < len(verdicts)
