"""Sentences on what a detour through a landmark buys."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pareto_ltl.extend import FailureRate
from pareto_ltl.planning.records import Front, Objectives, Plan, PlannedPath
from pareto_ltl_apps.view.limits import detour_lines
from problems import KM, box, make_scene

SCENE = replace(make_scene({"a": box(16, 0, 18, 2)}), landmarks=(box(4, 5, 6, 7), box(10, 0, 11, 1)))
FLIGHTS = 1000


def along(*corners: tuple[float, float]) -> PlannedPath:
    x = np.array(corners, float) * KM
    n, length = len(x), float(np.linalg.norm(np.diff(x, axis=0), axis=1).sum())
    cost, none = Objectives({"length": length}, 0.0, 0.0, 0.0, 0.0), (frozenset[str](),) * n
    return PlannedPath(
        60.0 * np.arange(n), x, np.zeros((n, 2, 2)), np.zeros(n, int), none, np.zeros((n - 1, 2)), cost, ""
    )


DIRECT, NORTH = along((1, 0.5), (17, 0.5)), along((1, 0.5), (5, 6), (17, 0.5))
LONGER = along((1, 0.5), (5, 6.5), (17, 0.5))


def front_of(*rows: tuple[PlannedPath, int]) -> Front:
    """Paths with the number of their flights of 1,000 that fail."""
    failed = np.array([np.arange(FLIGHTS) < count for _, count in rows])
    rates = tuple(FailureRate.counted("coherent", count, FLIGHTS) for _, count in rows)
    paths = tuple(path for path, _ in rows)
    return Front(paths, (), 0.5, np.array([1.0, 1e5]), rates=rates, raw_rates=(), failed=failed)


def plan_of(path: PlannedPath) -> Plan:
    return Plan(path, "F a", ("a",), 60.0, 20.0, 1.0, "full", "worth", (0.0,) * 3)


def test_a_plan_through_a_landmark_is_compared_with_the_safest_shorter_path_beside_it():
    lines = detour_lines(SCENE, front_of((NORTH, 32), (DIRECT, 173)), plan_of(NORTH))
    assert lines == ["4.0 km more through landmark 1 than point 1 without it: fails 17.3 % -> 3.2 %"]


def test_a_plan_beside_a_landmark_names_the_longer_point_that_crosses_it():
    front = front_of((LONGER, 20), (NORTH, 32), (DIRECT, 173))
    assert detour_lines(SCENE, front, plan_of(DIRECT)) == [
        "4.6 km more through landmark 1, point 0 of the front: fails 17.3 % -> 2.0 %"
    ]


@pytest.mark.parametrize(
    ("front", "path"),
    [
        (front_of((NORTH, 32)), NORTH),  # nothing to compare with
        (front_of((DIRECT, 10), (NORTH, 32)), NORTH),  # the detour buys nothing
        (front_of((NORTH, 32), (DIRECT, 173)), LONGER),  # not of this front
        (Front((NORTH, DIRECT), (), 0.5, np.array([1.0, 1.0, 1e5])), NORTH),  # bounds judge
    ],
)
def test_no_sentence_without_a_better_longer_path_through_it(front, path):
    assert detour_lines(SCENE, front, plan_of(path)) == []
