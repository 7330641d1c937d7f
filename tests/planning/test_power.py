"""Power curves, energies, and choices by energy, each against a second way to the same number."""

from __future__ import annotations

import math
from dataclasses import asdict, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from careful_io.texts import energy_text
from pareto_ltl.extend import FailureRate
from pareto_ltl.planning import selection
from pareto_ltl.planning.power import EnergyModel, energy_model
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.records import Front, Objectives, PlannedPath
from pareto_ltl.planning.routes.taut_lines import CAP
from pareto_ltl.planning.selection_rules import choose_path, within_capacity
from pareto_ltl.planning.shortest_mission import capacity_advice, energy_at
from pareto_ltl.settings import PlannerConfig, PowerConfig, RobotConfig, SelectionConfig, Settings
from pareto_ltl.settings.mission import POWER_KINDS
from pareto_ltl.support.errors import ConfigError, InfeasibleError
from pareto_ltl.support.resources import CONF
from pareto_ltl_verify.robot import power_law
from problems import box, make_problem, make_scene, steady_wind

VEHICLES = sorted(set(CONF.names("robot")) - {"airframe"})
TABLE = [[0.0, 80.0], [10.0, 50.0], [25.0, 200.0]]
watts = st.floats(0.0, 1e4)
some = settings(deadline=None, max_examples=80)
curves = st.builds(
    PowerConfig, kind=st.sampled_from(POWER_KINDS[1:]), base=watts, drag=st.floats(0.0, 10.0), lift=watts,
    blade=watts, lifting=watts, tip=st.floats(10.0, 300.0), wake=st.floats(0.5, 20.0), points=st.just(TABLE),
)  # fmt: skip
controls = st.lists(st.tuples(st.floats(-18, 18), st.floats(0.5, 17)), min_size=1, max_size=30).map(np.array)


def model_of(cfg: PowerConfig) -> EnergyModel:
    found = energy_model(cfg)
    assert found is not None
    return found


# --- curves ---------------------------------------------------------------------------------------


@some
@given(curves, st.floats(0.5, 25.0))
def test_a_power_curve_is_that_of_the_judge_and_never_negative(cfg: PowerConfig, v: float) -> None:
    law = power_law(asdict(cfg))
    assert law is not None
    found = model_of(cfg).curve.watts(np.array([v]))
    assert found[0] >= cfg.base * (1 - 1e-12)
    assert found[0] == pytest.approx(law(v), rel=1e-6, abs=1e-6)  # the judge's rotor cancels at high speed


@some
@given(curves, controls, st.floats(1.0, 3600.0))
def test_energy_is_the_sum_of_power_times_time(cfg: PowerConfig, u: np.ndarray, dt: float) -> None:
    model = model_of(cfg)
    brute = sum(float(model.curve.watts(np.array([math.hypot(*row)]))[0]) * dt for row in u)
    assert model.of(u, dt) == pytest.approx(brute, rel=1e-12)
    half = np.repeat(u, 2, axis=0)
    assert model.of(half, dt / 2) == pytest.approx(model.of(u, dt), rel=1e-12)  # steps do not matter


def test_a_rotor_that_hovers_draws_profile_and_induced_power() -> None:
    """The airspeeds of least power and of least power per metre agree with Zeng, Xu and Zhang, Fig. 3."""
    robot: RobotConfig = Settings.of_section("robot", "multirotor")
    curve = model_of(replace(robot.power, base=0.0)).curve
    assert curve.watts(np.zeros(1))[0] == pytest.approx(79.86 + 88.63)
    v = np.linspace(0.1, 40.0, 4000)
    power = curve.watts(v)
    assert v[power.argmin()] == pytest.approx(10.2, abs=0.1)
    assert v[(power / v).argmin()] == pytest.approx(18.3, abs=0.1)


def test_a_wing_needs_the_least_power_where_the_drag_of_lift_is_three_times_the_other() -> None:
    """dP/dv = 3 drag v² - lift / v² = 0 (Anderson, Section 5.6)."""
    cfg = PowerConfig(kind="wing", drag=0.02, lift=1000.0)
    v = np.linspace(1.0, 40.0, 40_000)
    assert v[model_of(cfg).curve.watts(v).argmin()] == pytest.approx((1000.0 / 0.06) ** 0.25, abs=2e-3)


def test_a_robot_without_a_power_curve_has_no_energy() -> None:
    assert energy_model(PowerConfig()) is None
    assert power_law(asdict(PowerConfig())) is None
    assert RobotConfig().power.kind == Settings.of_section("robot", "airframe").power.kind == "none"


@pytest.mark.parametrize("name", VEHICLES)
def test_a_ready_vehicle_has_airspeeds_a_level_and_energy_for_an_hour(name: str) -> None:
    robot: RobotConfig = Settings.of_section("robot", name)
    model = model_of(robot.power)
    assert robot.level
    assert model.capacity is not None
    assert 0.0 <= robot.u_min < robot.u_max
    v = np.linspace(max(robot.u_min, 0.01), robot.u_max, 200)
    assert model.capacity / model.curve.watts(v).min() > 1400.0  # [s]
    assert robot.feedback_time is None  # the planner is for robots without a position


@pytest.mark.parametrize(
    ("power", "robot", "text"),
    [
        ({"kind": "wing", "drag": 1.0, "lift": 1.0}, {}, "robot.power.kind=wing needs robot.u_min > 0"),
        ({"kind": "wing", "drag": -1.0}, {"u_min": 9.0}, r"robot.power.drag must lie in \[0, 1e9\]"),
        (
            {"kind": "wings"},
            {},
            "robot.power.kind must be one of none, body, wing, rotor, table; got 'wings'",
        ),
        ({"kind": "table"}, {}, "robot.power.points must be two or more pairs"),
        ({"kind": "table", "points": [[0, 5], [0, 6]]}, {}, "airspeeds rising"),
        ({"kind": "table", "points": [[0, 5], [9, -6]]}, {}, "none negative"),
        ({"kind": "table", "points": TABLE}, {"u_max": 30.0}, "reach from 0 to 25 m/s, and the robot flies"),
        ({"capacity": 10.0}, {}, "robot.power.capacity needs a power curve"),
        ({"kind": "body", "capacity": 0.0}, {}, "robot.power.capacity must be positive"),
        ({"kind": "body"}, {"u_min": 31.0}, "robot.u_min = 31 m/s is above robot.u_max = 30 m/s"),
    ],
)
def test_what_no_robot_can_be_is_refused(
    power: dict[str, object], robot: dict[str, object], text: str
) -> None:
    with pytest.raises(ConfigError, match=text):
        Settings.of_section("robot", robot | {"power": power})


# --- choices --------------------------------------------------------------------------------------


def path_of(risk: float, length: float, energy: float | None) -> PlannedPath:
    costs = {"length": length} | ({} if energy is None else {"energy": energy})
    objectives = Objectives(costs, risk, risk, 0.0, risk)
    empty, nowhere = np.zeros((1, 2)), np.zeros(1, np.int64)
    return PlannedPath(
        np.zeros(1), empty, np.zeros((1, 2, 2)), nowhere, (frozenset(),), empty[:0], objectives, ""
    )


def flown_front(*rows: tuple[int, float, float]) -> Front:
    """(failures of 1000 flights, length, energy) of each path."""
    return Front(
        paths=tuple(path_of(0.1, length, energy) for _, length, energy in rows),
        raw=(), hypervolume=0.0, reference=np.ones(3),
        rates=tuple(FailureRate.counted("coherent", count, 1000) for count, _, _ in rows),
        failed=np.array([np.arange(1000) < count for count, _, _ in rows]),
    )  # fmt: skip


COSTS = st.tuples(st.integers(0, 900), st.floats(1.0, 9.0), st.floats(1.0, 9.0))


@some
@given(st.lists(COSTS, min_size=1, max_size=12), st.floats(0.01, 0.9))
def test_the_rule_energy_takes_the_least_of_those_that_are_safe(
    rows: list[tuple[int, float, float]], alpha: float
) -> None:
    front, cfg = flown_front(*rows), SelectionConfig(rule="energy", alpha=alpha)
    safe = [row[2] for row, rate in zip(rows, front.rates, strict=True) if rate.high <= alpha]
    if not safe:
        with pytest.raises(InfeasibleError, match=r"no path keeps the failure rate"):
            choose_path(cfg, front)
    else:
        assert choose_path(cfg, front).objectives.costs["energy"] == min(safe)


@some
@given(st.lists(COSTS, min_size=1, max_size=12), st.tuples(*[st.floats(0.01, 1.0)] * 4))
def test_the_fourth_weight_is_that_of_energy(
    rows: list[tuple[int, float, float]], weights: tuple[float, ...]
) -> None:
    table = np.array(rows, float)
    scaled = table / [1000.0, table[:, 1].min(), table[:, 2].min()]
    g = scaled @ [weights[0] + weights[1], weights[2], weights[3]]
    found = choose_path(SelectionConfig(rule="weighted", weights=list(weights)), flown_front(*rows))
    k = next(
        k
        for k, row in enumerate(rows)
        if row[1:] == (found.objectives.length, found.objectives.costs["energy"])
    )
    assert g[k] <= g.min() + 1e-12 or rows[k][1:] in [row[1:] for i, row in enumerate(rows) if i != k]


@some
@given(st.lists(st.tuples(*[st.integers(0, 3).map(float)] * 3), min_size=1, max_size=15))
def test_energy_is_one_more_objective_of_a_front_of_bounds(rows: list[tuple[float, ...]]) -> None:
    front = selection.build_front([], [path_of(risk / 4, 1 + length, 1 + e) for risk, length, e in rows])
    kept = {
        (p.objectives.mission_risk * 4, p.objectives.length - 1, p.objectives.costs["energy"] - 1)
        for p in front.paths
    }
    beaten = {
        row for row in rows if any(all(np.less_equal(o, row)) and any(np.less(o, row)) for o in rows)
    }  # fmt: skip
    assert kept == set(rows) - beaten
    assert front.reference.tolist()[2:] == [2 * (1 + max(row[k] for row in rows)) for k in (1, 2)]


def calm_problem(energy: EnergyModel) -> Problem:
    return replace(make_problem("F a", make_scene({"a": box(8, 8, 10, 10)})), energy=energy)


def test_paths_beyond_the_battery_are_not_chosen(caplog: pytest.LogCaptureFixture) -> None:
    front = flown_front((1, 5.0, 9.0), (20, 5.0, 4.0), (300, 4.0, 2.0))
    model = EnergyModel(model_of(PowerConfig(kind="body")).curve, 5.0)
    cfg = SelectionConfig()
    problem = calm_problem(energy=model)
    left = within_capacity(cfg, front, problem)
    assert [p.objectives.costs["energy"] for p in left.paths] == [4.0, 2.0]
    assert left.failed.shape == (2, 1000)
    assert choose_path(cfg, front).objectives.costs["energy"] == 9.0
    assert within_capacity(cfg, front, replace(problem, energy=None)) is front
    assert within_capacity(cfg, front, replace(problem, energy=replace(model, capacity=None))) is front
    assert within_capacity(SelectionConfig(rule="point"), front, problem) is front
    assert "1 of 3 paths of the front need more than robot.power.capacity" in caplog.text
    with pytest.raises(InfeasibleError, match=r"every path of the front needs more .* the least is .* Wh: "):
        within_capacity(cfg, front, replace(problem, energy=replace(model, capacity=1.0)))


def flown_line(robot: RobotConfig, kilometres: float) -> tuple[Problem, Front]:
    """A straight flight in still air, and the front that consists of it."""
    side = 1.2 * kilometres
    scene = make_scene({"a": box(side - 2, 0, side, side)}, start=(1, 1), side=side)
    wind = steady_wind(scene, gust=(0.0, 0.0), until=np.inf)
    planner = PlannerConfig(max_steps=2000)
    problem = make_problem("F a", scene, wind, replace(robot, dt=100.0), planner)
    x = np.array([[0.0, 0.0], [1000 * kilometres, 0.0]]) + 1000.0
    (front,) = [flown_front((1, 1000 * kilometres, 1e12))]
    return problem, replace(front, paths=(replace(front.paths[0], x=x),))


@pytest.mark.parametrize(
    ("name", "kilometres", "advised"),
    [("multirotor", 35.0, "fixed_wing"), ("fixed_wing", 400.0, "long_endurance"), ("multirotor", 5e3, None)],
)
def test_a_vehicle_that_can_is_named_with_its_energy(
    name: str, kilometres: float, advised: str | None
) -> None:
    problem, front = flown_line(Settings.of_section("robot", name), kilometres)
    with pytest.raises(InfeasibleError) as error:
        within_capacity(SelectionConfig(), front, problem)
    text = str(error.value)
    assert "raise robot.power.capacity" in text
    if advised is None:
        assert "robot=" not in text
        return
    assert "set robot.u_max" not in text
    robot: RobotConfig = Settings.of_section("robot", advised)
    model = model_of(robot.power)
    # Energy a metre times the distance.
    needed = (
        float(model.curve.watts(np.array([CAP * robot.u_max]))[0]) / (CAP * robot.u_max) * 1000 * kilometres
    )
    assert (
        f"take robot={advised}, which needs {energy_text(needed)} of its {energy_text(model.capacity)}"
        in text
    )
    assert needed < model.capacity


def test_a_smaller_airspeed_is_advised_only_where_it_suffices() -> None:
    robot: RobotConfig = Settings.of_section("robot", "long_endurance")
    problem, front = flown_line(robot, 1000.0)
    assert problem.energy is not None
    at_full = energy_at(problem, front.paths[0].x, problem.energy, robot.u_max)
    speeds = np.linspace(robot.u_min, robot.u_max, 200)
    model = problem.energy
    least = 1e6 * float((model.curve.watts(speeds) / speeds).min())
    for capacity, helps in ((0.97 * at_full, True), (least, False)):
        limited = replace(problem, energy=replace(model, capacity=capacity))
        text = capacity_advice(limited, front)
        assert ("set robot.u_max=" in text) == helps
        if helps:
            u_max = float(text.split("set robot.u_max=")[1].split(",")[0])
            assert energy_at(problem, front.paths[0].x, model, u_max) == pytest.approx(least, rel=0.01)


def test_a_front_without_energies_has_no_choice_by_energy() -> None:
    front = selection.build_front([], [path_of(0.1, 2.0, None)])
    with pytest.raises(ConfigError, match="needs the power curve of the robot"):
        choose_path(SelectionConfig(rule="energy"), front)
