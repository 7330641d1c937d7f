"""Position fixes at landmarks: what a plan counts on, and how scenes and settings ask for them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from landmarks import LANDMARK_SCENE, LANDMARK_WAY, landmark_problem
from pareto_ltl.planning.evaluate import evaluate_path, propagate
from pareto_ltl.planning.problem import without_landmarks
from pareto_ltl.settings import RobotConfig, SceneConfig
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl.world.scene_files import scene_from_dict, scene_to_dict
from pareto_ltl.world.scene_settings import scene_from_settings
from problems import box


def test_a_landmark_collapses_what_is_unknown_and_lowers_the_risk():
    with_fix = evaluate_path(landmark_problem(), LANDMARK_WAY, "")
    without = evaluate_path(landmark_problem(replace(LANDMARK_SCENE, landmarks=())), LANDMARK_WAY, "")
    assert len(with_fix.fixes) >= 1
    first = with_fix.fixes[0]
    np.testing.assert_allclose(with_fix.cov[: first + 1], without.cov[: first + 1], rtol=1e-5)
    assert np.trace(with_fix.cov[-1]) < 0.5 * np.trace(without.cov[-1])


def test_a_fix_that_may_well_be_missed_is_not_counted_on():
    small = replace(LANDMARK_SCENE, landmarks=(box(8.9, 8.9, 9.1, 9.1),))
    assert evaluate_path(landmark_problem(small, fix_risk=0.02), LANDMARK_WAY, "").fixes == ()


def test_nothing_is_reserved_for_fixes_where_flights_judge():
    p = landmark_problem(fix_gain=0.5)
    assert evaluate_path(p, LANDMARK_WAY, "").fixes
    assert (propagate(p, LANDMARK_WAY).speed == p.motion.u_max).all()


def test_without_landmarks_the_same_path_takes_no_fix_and_all_else_is_equal():
    whole = landmark_problem()
    (plain,) = without_landmarks(whole)
    drawn = landmark_problem(replace(LANDMARK_SCENE, landmarks=()))
    assert evaluate_path(plain, LANDMARK_WAY, "").fixes == ()
    np.testing.assert_array_equal(propagate(plain, LANDMARK_WAY).cov, propagate(drawn, LANDMARK_WAY).cov)
    assert plain.scene.landmarks == ()
    assert whole.scene.landmarks
    assert without_landmarks(drawn) == ()


def test_feedback_and_fixes_leave_less_airspeed_for_the_path_where_bounds_judge():
    p = landmark_problem(fix_gain=0.5, judge="bound")
    steps = len(LANDMARK_WAY) - 1
    room = propagate(p, LANDMARK_WAY).speed / p.motion.u_max
    first = evaluate_path(p, LANDMARK_WAY, "").fixes[0]
    assert room.shape == (steps,)
    assert np.all(room[:first] == 1.0)
    assert room[first] < 1.0


def settings_of(**changes):
    base = {
        "bounds": [[0, 0], [20, 20]], "start": [2, 2], "obstacles": [],
        "regions": {"a": [[13, 13], [19, 13], [19, 19], [13, 19]]},
    }  # fmt: skip
    return SceneConfig(**(base | changes))


def test_landmarks_survive_the_way_through_scene_json():
    scene = scene_from_settings(settings_of(landmarks=[[[5, 5], [8, 5], [8, 8]]]))
    assert len(scene.landmarks) == 1
    again = scene_from_dict(scene_to_dict(scene))
    np.testing.assert_array_equal(again.landmarks[0], scene.landmarks[0])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"landmarks": [[[5, 5], [8, 5], [8, 8]]], "obstacles": [[[6, 4], [9, 4], [9, 9]]]},
            "landmark 1 overlaps obstacle 1",
        ),
        ({"landmarks": [[[15, 15], [25, 15], [25, 25]]]}, "landmark 1"),
    ],
)
def test_a_landmark_that_no_robot_can_use_is_refused(changes, message):
    with pytest.raises(DataError, match=message):
        scene_from_settings(settings_of(**changes))


@pytest.mark.parametrize(
    ("settings", "key"),
    [
        ({"feedback": 1.5}, "robot.feedback"), ({"fix_gain": -0.1}, "robot.fix_gain"),
        ({"effort_risk": 0.0}, "robot.effort_risk"), ({"fix_sd": 0.0}, "robot.fix_sd"),
    ],
)  # fmt: skip
def test_settings_of_feedback_and_fixes_are_checked(settings, key):
    with pytest.raises(ConfigError, match=key.replace(".", r"\.")):
        RobotConfig(**settings)
