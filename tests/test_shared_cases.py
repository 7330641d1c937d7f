"""Maps and formulas of other programs with answers that were computed elsewhere, where they are at hand."""

from __future__ import annotations

import itertools
import json
import logging
import re
from pathlib import Path

import numpy as np
import pytest
import shapely

import pareto_ltl
from pareto_ltl.support.errors import ParetoLtlError

FOLDER = Path(__file__).resolve().parents[2] / "shared" / "cases"
CASES = FOLDER / "cases.json"
KNOWN = json.loads(CASES.read_text(encoding="utf-8")) if CASES.is_file() else []
MAPS = [case for case in KNOWN if case["type"] == "map"]
FORMULAS = [case for case in KNOWN if case["type"] == "formula"]
LETTERS = [frozenset(some) for n in range(4) for some in itertools.combinations("abc", n)]

pytestmark = pytest.mark.skipif(not KNOWN, reason="the cases are not beside this checkout")


def refused(case, error):
    """Whether a refusal is an answer of ``case``."""
    wanted = case.get("refused") or case.get("or_refused")
    return wanted is not None and re.search(wanted, str(error).replace(str(FOLDER), "")) is not None


@pytest.mark.parametrize("case", MAPS, ids=[case["file"] for case in MAPS])
def test_a_map_is_what_its_author_drew(case, caplog):
    caplog.set_level(logging.CRITICAL)
    try:
        scene = pareto_ltl.read_map(FOLDER / case["file"], altitude=case.get("altitude"))
    except ParetoLtlError as error:
        assert refused(case, error), str(error)
        return
    assert "refused" not in case
    area = shapely.union_all([shapely.Polygon(outline) for outline in scene.obstacles])
    for key, wanted in (("inside", True), ("outside", False)):
        for lon, lat in case.get(key, ()):
            ((x, y),) = scene.frame.to_plane([lon], [lat])
            assert shapely.contains_xy(area, x, y) == wanted
    if "regions" in case:
        assert sorted(scene.regions) == case["regions"]
    low, high = case.get("width_km", (0.0, np.inf))
    assert low < np.ptp(scene.bounds[:, 0]) / 1e3 < high


@pytest.mark.parametrize("case", FORMULAS, ids=[case["text"] for case in FORMULAS])
def test_a_formula_means_what_its_tool_means(case):
    try:
        found = pareto_ltl.read_formula(case["text"], LETTERS)
    except ParetoLtlError as error:
        assert refused(case, error), str(error)
        return
    assert "refused" not in case
    same = pareto_ltl.read_formula(case["same_as"], LETTERS)
    for n in (1, 2, 3):
        for word in itertools.product(LETTERS, repeat=n):
            assert found.accepts(word) == same.accepts(word)
