"""The Python interface: the plans of the command line, shown and simulated."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

import pareto_ltl
from careful_io.yaml_files import read_yaml
from pareto_ltl.run.interface import VEHICLE
from pareto_ltl.run.plan_run import Run
from pareto_ltl.settings import MissionConfig, SceneConfig, Settings
from pareto_ltl_apps.cli import hydra_app as app
from pareto_ltl_apps.view.geography import geography_around
from pareto_ltl_apps.view.land import BESIDE
from problems import box, make_scene

SMALL = {
    "planner": {"trees": 4, "n_max": 1500},
    "smoothing": {"candidates": 1, "weights": [10.0]},
    "refine": {"flights": 60, "sweep_flights": 20, "classes": 1, "points": 5},
    "selection": {"draws": 100, "runs": 100},
    "deployment": {"runs": 40},
    "report": "none",
}
ARGUMENTS = (
    "planner.trees=4", "planner.n_max=1500", "smoothing.candidates=1", "smoothing.weights=[10.0]",
    "refine.flights=60", "refine.sweep_flights=20", "refine.classes=1", "refine.points=5",
    "selection.draws=100", "selection.runs=100", "deployment.runs=40", "report=none",
)  # fmt: skip
PHI1 = "F(a & F b & F c)"


@pytest.fixture(scope="module")
def planned() -> Run:
    return pareto_ltl.plan("phi1", PHI1, **SMALL)


@pytest.fixture(scope="module", params=["paper", "full"])
def both(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """One mission planned by the command line and from Python, with results directories."""
    place = tmp_path_factory.mktemp(request.param)
    models = (f"fidelity={request.param}", "seed=1")
    argv = ["+experiment=phi1", *ARGUMENTS, *models, f"hydra.run.dir={place / 'line'}"]
    assert app.run_hydra(argv) == 0
    pareto_ltl.plan(
        "phi1",
        PHI1,
        seed=1,
        robot={"dt": 1800.0},
        fidelity=request.param,
        name="phi1",
        out=place / "python",
        **SMALL,
    )
    return place / "line", place / "python"


@pytest.mark.parametrize(
    "name", ["plan.json", "front.csv", "trees.npz", "scene.json", "wind.nc", "deployments.npz", "plan.csv"]
)
def test_the_interface_writes_the_bytes_of_the_command_line(name: str, both: tuple[Path, Path]) -> None:
    line, python = both
    assert (line / name).read_bytes() == (python / name).read_bytes()


def test_the_settings_are_those_of_the_command_line(both: tuple[Path, Path]) -> None:
    line, python = (pareto_ltl.load_results(place) for place in both)
    assert line.provenance["config_hash"] == python.provenance["config_hash"]
    assert line.settings == python.settings


def test_a_results_directory_flies_as_its_own_run_did(both: tuple[Path, Path]) -> None:
    results = pareto_ltl.load_results(both[0])
    flights = pareto_ltl.simulate(results, runs=40, law="coherent")
    np.testing.assert_array_equal(flights.x, results.deployments["coherent"].x)
    np.testing.assert_array_equal(flights.accepted, results.deployments["coherent"].accepted)


def test_in_memory_the_plan_is_the_same_and_nothing_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, planned: Run
) -> None:
    monkeypatch.chdir(tmp_path)
    written = pareto_ltl.plan("phi1", PHI1, out="here", **SMALL)
    np.testing.assert_array_equal(written.plan.path.x, planned.plan.path.x)
    assert [path.name for path in tmp_path.iterdir()] == ["here"]


def test_a_result_has_every_record_of_the_run(planned: Run) -> None:
    assert planned.plan is planned.plan
    assert planned.forest is planned.forest
    assert planned.problem is planned.problem
    assert planned.scene.regions.keys() == {"a", "b", "c"}
    assert planned.automaton.formula == PHI1
    assert planned.metrics["nodes"] == sum(map(len, planned.forest.trees))
    assert planned.metrics["length_m"] == planned.plan.path.objectives.length
    assert any(path is planned.plan.path for path in planned.front.paths)
    assert len(planned.cells.cells) > 0
    assert planned.settings.planner.trees == 4


def test_one_seed_is_one_wind_and_another_is_another(planned: Run) -> None:
    first, again, other = (pareto_ltl.simulate(planned, 30, "independent", seed=seed).x for seed in (5, 5, 6))
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)
    assert pareto_ltl.simulate(planned, 30, "coherent").law == "coherent"


def test_a_map_comes_as_settings_as_a_mapping_as_a_file_or_as_a_record(tmp_path: Path) -> None:
    corners = [[13e3, 2e3], [17e3, 2e3], [17e3, 6e3], [13e3, 6e3]]
    keys = {"border": "open", "bounds": [[0, 0], [2e4, 2e4]], "start": [2e3, 3e3], "regions": {"a": corners}}
    record = make_scene({"a": box(13, 2, 17, 6)}, start=(2.0, 3.0))
    options = SMALL | {
        "wind": "calm",
        "robot": {"dt": 100, "u_max": 12},
        "planner": {"trees": 1, "n_max": 200},
    }
    first = pareto_ltl.plan(keys, "F a", out=tmp_path / "keys", **options)
    file = tmp_path / "keys" / "scene.json"
    given = (SceneConfig(**keys), file, str(file), record)
    for scene in given:
        other = pareto_ltl.plan(scene, MissionConfig(formula="F a"), **options)
        np.testing.assert_allclose(other.plan.path.x, first.plan.path.x, atol=1e-9)
    kept = pareto_ltl.plan(record, "F a", out=tmp_path / "record", **options)
    assert (tmp_path / "record" / "scene.json").is_file()
    assert (tmp_path / "record" / "plan.json").read_bytes() == (tmp_path / "keys" / "plan.json").read_bytes()
    assert kept.scene is record
    back = pareto_ltl.load_results(tmp_path / "record")
    assert pareto_ltl.simulate(back, 10).x.shape == (10, len(kept.plan.path.u) + 1, 2)


@pytest.mark.parametrize(
    ("scene", "formula", "options", "message"),
    [
        ("phi9", "F a", {}, "scene 'phi9' is neither a file nor a ready map; there are hop, phi1, phi2"),
        ("phi1", "", {}, "mission.formula is missing"),
        ("phi1", "F a", {"planner": {"treez": 1}}, "did you mean planner.trees"),
        ("phi1", "F a", {"pipelines": {"stages": ["readings"]}}, "pipelines.stages makes no plan; it lists"),
        ({}, "F a", {}, "scene is missing"),
        ("phi1", "F a", {"mission": {"formula": "F b"}}, r"mission\.formula is given twice"),
        ("phi1", "F a", {"mission": "phi1"}, "the mission is given twice"),
    ],
)
def test_what_is_wrong_is_a_config_error(
    scene: object, formula: str, options: dict[str, object], message: str
) -> None:
    with pytest.raises(pareto_ltl.ConfigError, match=message):
        pareto_ltl.plan(scene, formula, **options)  # type: ignore[arg-type]


def test_the_mission_has_keys_beside_its_formula() -> None:
    options = {"wind": "calm", "planner": {"trees": 1, "n_max": 200}, "fidelity": "paper"}
    found = pareto_ltl.plan("phi1", "F a", mission={"start_time": "2018-10-09T06:00:00Z"}, **options)
    assert found.settings.mission.formula == "F a"
    assert found.scene.time_zero == "2018-10-09T06:00:00Z"


def lab_readings(speed: float = 2.0) -> pareto_ltl.Readings:
    """A wind that turns within 6 h, at 25 places of a plane of 100 km."""
    east, north = np.meshgrid(np.linspace(0.0, 1e5, 5), np.linspace(0.0, 1e5, 5))
    points = np.stack([east, north], axis=-1).reshape(-1, 2)
    winds = np.stack([np.full((25, 2), wind) for wind in ([speed, 0.0], [0.0, speed])])
    winds = winds + 1e-5 * points[None]
    return pareto_ltl.Readings.of_arrays(
        ["2026-01-01T00:00Z", "2026-01-01T06:00Z"], points, winds, geographic=False
    )


LAB = {"planner": {"trees": 2, "n_max": 400}, "robot": {"u_max": 20.0}} | {
    name: SMALL[name] for name in ("smoothing", "refine", "selection")
}


def lab_scene() -> pareto_ltl.Scene:
    return make_scene({"a": [box(60, 60, 90, 90)]}, start=(10.0, 10.0), side=100.0)


def test_the_wind_comes_as_readings_as_a_field_or_as_a_file(tmp_path: Path) -> None:
    """A table, the arrays in it, and the field that is fitted to them give the same plan."""
    readings = lab_readings()
    wind = {"forecast_error": "none", "spacing": 2e4, "padding": 2e4, "modes_spacing": 2e4}
    rows = [
        f"2026-01-01T{6 * k:02d}:00Z,{x!r},{y!r},{u!r},{v!r}"
        for k, winds in enumerate(readings.winds)
        for (x, y), (u, v) in zip(readings.points[k].tolist(), winds.tolist(), strict=True)
    ]
    (tmp_path / "wind.csv").write_text("\n".join(["time,x,y,u,v", *rows]) + "\n")
    found = [
        pareto_ltl.plan(lab_scene(), "F a", wind=wind | {"source": source}, **LAB)
        for source in (str(tmp_path / "wind.csv"), readings)
    ]
    found.append(pareto_ltl.plan(lab_scene(), "F a", wind=found[0].wind, **LAB))
    assert [one.settings.wind.source for one in found] == ["csv", "given", "given"]
    for one in found[1:]:
        np.testing.assert_array_equal(one.wind.mean, found[0].wind.mean)
        np.testing.assert_array_equal(one.plan.path.u, found[0].plan.path.u)


def test_readings_that_cannot_be_are_refused_in_one_line() -> None:
    with pytest.raises(pareto_ltl.DataError, match=r"2026-01-01T00:00:00Z, row 0: wind speed 99.0 m/s is"):
        pareto_ltl.plan(lab_scene(), "F a", wind=lab_readings(99.0), **LAB)
    with pytest.raises(pareto_ltl.ConfigError, match=r"wind.level=100m: the given Readings states .* 10m"):
        pareto_ltl.plan(lab_scene(), "F a", wind={"source": lab_readings(), "level": "100m"}, **LAB)
    with pytest.raises(ValueError, match=r"expected points \(N, 2\) and winds \(K, N, 2\)"):
        pareto_ltl.Readings.of_arrays(["2026-01-01"], np.zeros((3, 2)), np.zeros((3, 2)))
    with pytest.raises(ValueError, match="expected increasing times"):
        pareto_ltl.Readings.of_arrays(["2026-01-01"] * 2, np.zeros((3, 2)), np.zeros((2, 3, 2)))
    with pytest.raises(ValueError, match=r"expected times such as 2026-01-01T06:00Z, got \['noon'\]"):
        pareto_ltl.Readings.of_arrays(["noon"], np.zeros((3, 2)), np.zeros((1, 3, 2)))


def test_a_run_of_the_command_line_cannot_be_given_arrays() -> None:
    with pytest.raises(pareto_ltl.ConfigError, match=r"wind.source=given: the wind is an object in Python"):
        pareto_ltl.plan("phi1", PHI1, wind={"source": "given"}, **SMALL)


def test_a_folder_without_a_run_is_refused(tmp_path: Path) -> None:
    with pytest.raises(pareto_ltl.DataError, match=r"there is no run\.json; name a results directory"):
        pareto_ltl.load_results(tmp_path)


# --- how records show themselves -----------------------------------------------------------------


def shown_records(planned: Run) -> tuple[Any, ...]:
    """One record of every kind that users get."""
    front, forest = planned.front, planned.forest
    return (
        planned, planned.plan, front, front.paths[0], forest, forest.trees[0], planned.wind, planned.scene,
        planned.cells, planned.automaton, planned.problem, pareto_ltl.simulate(planned, runs=50),
    )  # fmt: skip


def test_records_are_one_line_and_a_table(planned: Run, both: tuple[Path, Path]) -> None:
    results = pareto_ltl.load_results(both[0])
    for record in (*shown_records(planned), results):
        line = repr(record)
        assert line.startswith(f"{type(record).__name__}(")
        assert "\n" not in line
        assert len(line) < 270
        table = record._repr_html_()
        assert table.startswith("<table>")
        assert all(name in table for name in record.facts())
    assert "F(a &amp; F b &amp; F c)" in planned.plan._repr_html_()


def test_records_draw_themselves(planned: Run, both: tuple[Path, Path], tmp_path: Path) -> None:
    results = pareto_ltl.load_results(both[0])
    for number, record in enumerate((*shown_records(planned), results)):
        drawing = record.plot()
        assert drawing._repr_png_().startswith(b"\x89PNG")
        assert drawing.save(tmp_path / f"{number}.svg").stat().st_size > 2000
    with_map = planned.plan.plot(scene=planned.scene)
    shown = {text.get_text() for text in with_map.figure.axes[0].texts}
    numbers = {str(number) for number in range(1, len(planned.scene.obstacles) + 1)}
    around = geography_around(planned.scene, BESIDE)
    assert around is not None
    cities = {city[0] for city in around.cities}
    assert {"a", "b", "c"} <= shown <= {"a", "b", "c"} | numbers | cities
    assert shown & cities
    assert shown & numbers
    for record in shown_records(planned)[1:]:
        assert record.plot(scene=planned.scene)._repr_png_().startswith(b"\x89PNG")


def test_records_are_drawn_on_axes_of_the_reader(planned: Run) -> None:
    for record in shown_records(planned):
        ax = Figure().add_subplot()
        assert record.plot(ax=ax) is ax
        assert ax.has_data()
    front = planned.front.plot(ax=Figure().add_subplot(), plan=planned.plan)
    assert front.get_xlabel() == "path length [km]"
    assert "chosen plan" in [text.get_text() for text in front.get_legend().get_texts()]


def test_axes_keep_in_view_what_they_show(planned: Run) -> None:
    ax = planned.scene.plot(ax=Figure().add_subplot())
    (west, south), (east, north) = planned.scene.bounds
    assert (*ax.get_xlim(), *ax.get_ylim()) == (west, east, south, north)
    planned.plan.plot(ax=ax)
    assert ax.get_xlim()[0] <= west < east <= ax.get_xlim()[1]
    assert {text.get_text() for text in ax.texts} >= {"a", "b", "c"}
    there = Figure().add_subplot()
    there.set(xlim=(0.0, 1e4), ylim=(1e-5, 1.0), yscale="log")
    there.plot([0.0, 1e4], [1e-5, 1.0])
    planned.front.plot(ax=there)
    assert there.get_ylim() == (1e-5, 1.0)
    assert there.get_xlim() == (0.0, 1e4)


def test_moments_need_a_figure_of_their_own(planned: Run) -> None:
    flown, ax = pareto_ltl.simulate(planned, runs=50), Figure().add_subplot()
    with pytest.raises(TypeError, match=r"^frames= makes several maps, which ax= cannot have"):
        flown.plot(scene=planned.scene, frames=3, plan=planned.plan, ax=ax)


def test_a_figure_of_cells_has_all_cells(planned: Run) -> None:
    cells = planned.cells.plot().figure.axes[0].collections[0]
    assert len(cells.get_paths()) == len(planned.cells.cells)


def test_a_drawing_shows_what_it_is_asked_for(planned: Run) -> None:
    early, late = (planned.wind.plot(scene=planned.scene, time=time) for time in (0.0, "6h"))
    assert early._repr_png_() != late._repr_png_()
    assert any("6 h after departure" in text.get_text() for text in late.figure.texts)
    assert any(text.get_text().startswith("9 Oct 2018, 06:00 UTC") for text in late.figure.texts)
    marked = planned.front.plot(plan=planned.plan).figure
    assert "chosen plan" in [text.get_text() for text in marked.legends[-1].get_texts()]
    few = pareto_ltl.simulate(planned, runs=50).plot(scene=planned.scene, count=7).figure
    assert any("7 drawn" in text.get_text() for text in few.legends[0].get_texts())


def test_equal_drawings_are_equal_files(planned: Run, tmp_path: Path) -> None:
    for kind in ("png", "svg", "pdf"):
        one, two = (planned.plan.plot().save(tmp_path / f"{name}.{kind}") for name in ("one", "two"))
        assert one.read_bytes() == two.read_bytes()


def test_the_package_is_light_until_it_is_used() -> None:
    code = (
        "import sys, pareto_ltl\n"
        "heavy = 'numpy scipy numba cvxpy sklearn matplotlib shapely xarray pyproj hydra'.split()\n"
        "print([name for name in heavy if name in sys.modules])\n"
        "print(sorted(set(pareto_ltl.__all__) - set(dir(pareto_ltl))))\n"
        "pareto_ltl.Settings, pareto_ltl.ConfigError\n"
        "print([name for name in heavy if name in sys.modules])\n"
        "print(pareto_ltl.plan.__name__, pareto_ltl.Scene.__name__)\n"
        "print('matplotlib' in sys.modules, 'hydra' in sys.modules, 'cvxpy' in sys.modules)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == ["[]", "[]", "[]", "plan Scene", "False False False"]
    with pytest.raises(AttributeError, match="has no attribute 'plann'"):
        _ = pareto_ltl.plann  # type: ignore[attr-defined]


def test_the_vehicle_without_a_choice_is_the_one_of_the_command_line(planned: Run) -> None:
    """Its errors are in the promise, whichever way the plan is made."""
    rows = read_yaml(Path(__file__).parents[2] / "conf" / "config.yaml")["defaults"]
    assert [row["robot"] for row in rows if isinstance(row, dict) and "robot" in row] == [VEHICLE]
    assert planned.settings.robot == Settings.of_section("robot", VEHICLE)
