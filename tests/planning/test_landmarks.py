"""Position fixes at landmarks: what a plan counts on, what robots do with them, how they are asked for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.random import SeedSequence

from pareto_ltl.planning.evaluate import evaluate_path, propagate
from pareto_ltl.settings import PlannerConfig, RobotConfig, SceneConfig
from pareto_ltl.simulation.flights import simulate_flights
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl.world.scene_files import from_dict, read_scene, to_dict
from problems import KM, box, make_problem, make_scene, smooth_wind

MARKED = replace(make_scene({"a": box(13, 13, 19, 19)}, start=(2.0, 2.0)), landmarks=(box(4, 4, 12.5, 12.5),))
WAY = np.linspace([2.0, 2.0], [16.0, 16.0], 29) * KM


def marked(scene=MARKED, **robot):
    options = {"dt": 100.0, "u_max": 25.0, "start_sd": 300.0, "fix_sd": 50.0} | robot
    wind = smooth_wind(scene, speed=2.0, sd=0.7, gust=0.3, rho=0.9)
    return make_problem("F a", scene, wind, RobotConfig(**options), PlannerConfig(), fidelity="full")


def test_a_landmark_collapses_what_is_unknown_and_lowers_the_risk():
    with_fix = evaluate_path(marked(), WAY, "")
    without = evaluate_path(marked(replace(MARKED, landmarks=())), WAY, "")
    assert len(with_fix.fixes) >= 1
    first = with_fix.fixes[0]
    np.testing.assert_allclose(with_fix.cov[: first + 1], without.cov[: first + 1], rtol=1e-5)
    assert np.trace(with_fix.cov[-1]) < 0.5 * np.trace(without.cov[-1])


@pytest.mark.statistical
def test_flights_with_fixes_spread_as_foreseen():
    """The robot of the simulation runs the estimator itself. The few flights that miss the landmark count
    as failed,
    and what is foreseen is how the others go on."""
    p = marked()
    path = evaluate_path(p, WAY, "")
    flights = simulate_flights(p, path.u, 20_000, "coherent", SeedSequence(1), path.x)
    at_fix = flights.x[:, path.fixes[0]]
    found_it = np.all((at_fix >= 4.0 * KM) & (at_fix <= 12.5 * KM), axis=1)
    assert 0.97 < found_it.mean() < 1.0
    for t in (path.fixes[0], path.fixes[0] + 1, path.fixes[0] + 4, len(WAY) - 1):
        found = np.cov(flights.x[found_it, t].T)
        expected = path.cov[t]
        wide = np.sqrt(np.trace(expected))
        assert np.sqrt(np.trace(found)) == pytest.approx(wide, rel=0.1)
    failures = int((~flights.accepted).sum())
    assert failures / 20_000 - 5 * np.sqrt(failures + 1) / 20_000 <= path.objectives.mission_risk


def test_a_fix_that_may_well_be_missed_is_not_counted_on():
    small = replace(MARKED, landmarks=(box(8.9, 8.9, 9.1, 9.1),))
    assert evaluate_path(marked(small, fix_risk=0.02), WAY, "").fixes == ()


def test_feedback_and_fixes_leave_less_airspeed_for_the_path():
    p = marked(fix_gain=0.5)
    steps = len(WAY) - 1
    room = propagate(p, WAY).speed / p.motion.u_max
    first = evaluate_path(p, WAY, "").fixes[0]
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
    scene = read_scene(settings_of(landmarks=[[[5, 5], [8, 5], [8, 8]]]))
    assert len(scene.landmarks) == 1
    again = from_dict(to_dict(scene))
    np.testing.assert_array_equal(again.landmarks[0], scene.landmarks[0])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"landmarks": [[[5, 5], [8, 5], [8, 8]]], "obstacles": [[[6, 4], [9, 4], [9, 9]]]},
            "landmark 1 overlaps obstacle 1",
        ),
        ({"landmarks": [[[5, 5], [9, 5], [6, 6], [5, 9]]]}, "landmark 1 is not convex"),
        ({"landmarks": [[[15, 15], [25, 15], [25, 25]]]}, "landmark 1"),
    ],
)
def test_a_landmark_that_no_robot_can_use_is_refused(changes, message):
    with pytest.raises(DataError, match=message):
        read_scene(settings_of(**changes))


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
