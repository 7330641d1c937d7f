"""Position fixes at landmarks: what a plan counts on, and how scenes and settings ask for them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.random import SeedSequence

from landmarks import LANDMARK_SCENE, LANDMARK_WAY, landmark_problem
from pareto_ltl.extend import which_fail
from pareto_ltl.planning.evaluate import evaluate_path, propagate
from pareto_ltl.settings import RobotConfig, SceneConfig
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl.world.scene_files import scene_from_dict, scene_to_dict
from pareto_ltl.world.scene_settings import scene_from_settings
from pareto_ltl_apps.studies.settings import ReplanningConfig
from problems import box


def test_a_landmark_collapses_what_is_unknown_and_lowers_the_risk():
    with_fix = evaluate_path(landmark_problem(), LANDMARK_WAY, "")
    without = evaluate_path(landmark_problem(replace(LANDMARK_SCENE, landmarks=())), LANDMARK_WAY, "")
    assert len(with_fix.fixes) >= 1
    first = with_fix.fixes[0]
    np.testing.assert_allclose(with_fix.cov[: first - 2], without.cov[: first - 2], rtol=1e-5)
    assert np.trace(with_fix.cov[-1]) < 0.5 * np.trace(without.cov[-1])
    assert with_fix.objectives.mission_risk < without.objectives.mission_risk


def test_a_fix_that_may_well_be_missed_is_not_named_and_helps_a_little():
    small = replace(LANDMARK_SCENE, landmarks=(box(8.3, 7.7, 9.3, 8.7),))
    path = evaluate_path(landmark_problem(small), LANDMARK_WAY, "")
    alone = evaluate_path(landmark_problem(replace(LANDMARK_SCENE, landmarks=())), LANDMARK_WAY, "")
    assert path.fixes == ()
    assert 0.5 < np.trace(path.cov[-1]) / np.trace(alone.cov[-1]) < 1.0


def test_what_a_landmark_gives_is_continuous_in_its_distance():
    """No gate: paths bend towards a landmark because the covariance falls step by step."""
    ends = []
    for aside in np.arange(0.0, 6.0, 0.1):
        mark = box(7.0 + aside, 7.0 - aside, 9.0 + aside, 9.0 - aside)
        scene = replace(LANDMARK_SCENE, landmarks=(mark,))
        ends.append(np.sqrt(np.trace(evaluate_path(landmark_problem(scene), LANDMARK_WAY, "").cov[-1])))
    steps = np.diff(ends) / ends[-1]
    assert ends[0] < 0.75 * ends[-1]
    assert np.abs(steps).max() < 0.05
    assert steps.min() > -1e-3  # farther away is never better


def test_nothing_is_reserved_for_fixes():
    p = landmark_problem(fix_time=100.0)
    assert evaluate_path(p, LANDMARK_WAY, "").fixes
    assert (propagate(p, LANDMARK_WAY).speed == p.motion.u_max).all()


@pytest.mark.parametrize(
    ("changes", "missing"),
    [({"judge": "bound"}, "fidelity.judge=flights"), ({"feedback_time": 60.0}, "robot.feedback_time=null")],
)
def test_landmarks_that_cannot_be_used_are_named_with_the_reason(changes, missing, caplog):
    p = landmark_problem(**changes)
    assert p.landmarks == ()
    assert evaluate_path(p, LANDMARK_WAY, "").fixes == ()
    assert missing in caplog.text


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
        ({"feedback_time": 0.0}, "robot.feedback_time"), ({"fix_time": -0.1}, "robot.fix_time"),
        ({"effort_risk": 0.0}, "robot.effort_risk"), ({"fix_sd": 0.0}, "robot.fix_sd"),
    ],
)  # fmt: skip
def test_settings_of_feedback_and_fixes_are_checked(settings, key):
    with pytest.raises(ConfigError, match=key.replace(".", r"\.")):
        RobotConfig(**settings)


def test_what_fixes_told_of_modes_that_fade_becomes_zero():
    """Else it would become so small that processors compute with it a hundred times more slowly."""
    p = landmark_problem()
    gains = []
    for kept in (1.0, 1e-3):
        modes = p.modes._replace(kept=np.full_like(p.modes.kept, kept))
        memory = propagate(p, LANDMARK_WAY, p.world.law._replace(modes=modes)).memory
        gains.append(np.abs(memory.gain[: memory.used[0]]))
    assert gains[0][0].max() > 0.1
    assert (gains[1][0] == 0.0).all()
    assert gains[1][gains[1] > 0.0].min(initial=1.0) > 1e-12


def test_of_overlapping_landmarks_one_fix_is_taken_and_equal_ones_change_nothing():
    (mark,) = LANDMARK_SCENE.landmarks
    twice = replace(LANDMARK_SCENE, landmarks=(mark, mark.copy()))
    paths, failed = [], []
    for scene in (LANDMARK_SCENE, twice):
        p = landmark_problem(scene)
        paths.append(evaluate_path(p, LANDMARK_WAY, ""))
        failed.append(which_fail(p, [paths[-1]], 500, SeedSequence(4))[0])
    np.testing.assert_array_equal(paths[0].cov, paths[1].cov)
    np.testing.assert_array_equal(failed[0], failed[1])


@pytest.mark.parametrize(
    ("settings", "key"),
    [
        ({"fix_sd": 0.0}, "replanning.fix_sd"), ({"fix_sd": math.nan}, "replanning.fix_sd"),
        ({"every": 0.0}, "replanning.every"), ({"forecasts": -6.0}, "replanning.forecasts"),
        ({"fixes": [0]}, "replanning.fixes"), ({"fixes": [2, 2]}, "replanning.fixes"),
        ({"flights": 0}, "replanning.flights"),
    ],
)  # fmt: skip
def test_settings_of_the_replanning_study_are_checked(settings, key):
    with pytest.raises(ConfigError, match=key.replace(".", r"\.")) as error:
        ReplanningConfig(**settings)
    assert "\n" not in str(error.value)
