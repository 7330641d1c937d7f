"""A results directory as evidence: its files, and values computed from them without the planner's code."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pareto_ltl.support.archives import read_npz
from pareto_ltl.support.arrays import BoolArray, FloatArray
from pareto_ltl.support.errors import DataError
from pareto_ltl.support.reading import read_json, read_text
from pareto_ltl.support.run_status import ending_text
from pareto_ltl_verify import laws
from pareto_ltl_verify.energy import energy_limits
from pareto_ltl_verify.flights import Ground, Simulator
from pareto_ltl_verify.formula import Dfa, covers, losing
from pareto_ltl_verify.gaussians import Way, growing, label_masses, ordered, path_bound, way_risks
from pareto_ltl_verify.geometry import Convex, beyond_bounds, convex
from pareto_ltl_verify.laws import Coherent, Course, Independent, Law, Robot, landmarks_of
from pareto_ltl_verify.segments import with_lines
from pareto_ltl_verify.timetable import Timetable, windows_of
from pareto_ltl_verify.wind_modes import PartCovariance, part_covariances
from pareto_ltl_verify.wind_tables import ENSEMBLE, Clock, WindFile, clock, read_wind_file, source_of

LAWS = ("independent", "coherent")
HELD_RUNS = 2000  # new flights with position feedback
HELD_TIME = 60.0  # time constant of the position feedback of exports [s]


@dataclass(frozen=True, eq=False)
class Evidence:
    """One finished result. Files are read when first needed, and derived values are cached."""

    directory: Path
    run: Mapping[str, Any]
    metrics: Mapping[str, Any]
    settings: Mapping[str, Any]

    def has(self, name: str) -> bool:
        """Whether the directory holds the file ``name``."""
        return (self.directory / name).is_file()

    # --- files --------------------------------------------------------------------------------

    @cached_property
    def scene(self) -> dict[str, Any]:
        """The content of ``scene.json``."""
        return read_json(self.directory / "scene.json")

    @cached_property
    def cells(self) -> dict[str, Any]:
        """The content of ``cells.json``."""
        return read_json(self.directory / "cells.json")

    @cached_property
    def automaton(self) -> dict[str, Any]:
        """The content of ``automaton.json``."""
        return read_json(self.directory / "automaton.json")

    @cached_property
    def plan(self) -> dict[str, Any]:
        """The content of ``plan.json``."""
        return read_json(self.directory / "plan.json")

    @cached_property
    def front(self) -> list[dict[str, str]]:
        """The rows of ``front.csv``."""
        return self.table("front.csv")

    @cached_property
    def front_arrays(self) -> dict[str, NDArray[Any]]:
        """The arrays of ``front.npz``."""
        return read_npz(self.directory / "front.npz")

    @property
    def front_size(self) -> int:
        """The number of paths in front.npz."""
        return sum(key.endswith("/x") for key in self.front_arrays)

    def front_x(self, number: int) -> FloatArray:
        """Positions (T+1, 2) [m] of a path of the front."""
        return np.asarray(self.front_arrays[f"path_{number:03d}/x"], float)

    def front_u(self, number: int) -> FloatArray:
        """Controls (T, 2) [m/s] of a path of the front."""
        return np.asarray(self.front_arrays[f"path_{number:03d}/u"], float)

    @cached_property
    def trees(self) -> dict[str, NDArray[Any]]:
        """The arrays of ``trees.npz``."""
        return read_npz(self.directory / "trees.npz")

    @cached_property
    def flights(self) -> dict[str, NDArray[Any]]:
        """The arrays of ``deployments.npz``."""
        return read_npz(self.directory / "deployments.npz")

    @cached_property
    def wind(self) -> WindFile:
        """The wind field of ``wind.nc``."""
        return read_wind_file(self.directory / "wind.nc")

    @property
    def horizon(self) -> float | None:
        """End of the longest flight [s]; None if robot.dt=auto and no plan has the chosen time step."""
        if self.step_is_open and "dt_s" not in self.metrics:
            return None
        return float(self.robot.dt * self.settings["planner"]["max_steps"])

    @property
    def has_ensemble(self) -> bool:
        """Whether members of an ensemble, which are not in wind.nc, are part of the wind's error."""
        source, modes = self.settings["wind"]["source"], self.wind.modes
        members = modes is not None and bool((modes.part == ENSEMBLE).any())
        return source == "ensemble" or (source_of(source).ensemble and members)

    @cached_property
    def error_parts(self) -> dict[int, PartCovariance]:
        """Covariance of each part of the wind's error; the keys are numbers of ``wind_tables.PARTS``."""
        return part_covariances(self.wind, math.inf if self.horizon is None else self.horizon)

    def table(self, name: str) -> list[dict[str, str]]:
        """The rows of a CSV file."""
        with (self.directory / name).open(encoding="utf-8", newline="") as file:
            return list(csv.DictReader(file))

    # --- the world ----------------------------------------------------------------------------

    @cached_property
    def dfa(self) -> Dfa:
        """The automaton of ``automaton.json``."""
        content = self.automaton
        return Dfa(
            letters=tuple(frozenset(letter) for letter in content["letters"]),
            atoms=tuple(content["atoms"]),
            delta=tuple(tuple(row) for row in content["delta"]),
            initial=content["initial"],
            accepting=tuple(content["accepting"]),
        )

    @cached_property
    def regions(self) -> dict[str, tuple[Convex, ...]]:
        """Convex parts of each region."""
        return {name: tuple(map(convex, parts)) for name, parts in self.cells["regions"].items()}

    @cached_property
    def obstacles(self) -> tuple[Convex, ...]:
        """Convex parts of the obstacles."""
        return tuple(map(convex, self.cells["obstacles"]))

    @cached_property
    def barriers(self) -> tuple[Convex, ...]:
        """The obstacles and, if border=wall, the half plane beyond each side of the map."""
        walls = beyond_bounds(self.ground.bounds) if self.ground.walled else ()
        return (*self.obstacles, *walls)

    @cached_property
    def labelled(self) -> tuple[tuple[Convex, frozenset[str]], ...]:
        """The cells that show a label."""
        pairs = zip(self.cells["cells"], self.cells["labels"], strict=True)
        return tuple((convex(cell), frozenset(label)) for cell, label in pairs if label)

    @cached_property
    def ground(self) -> Ground:
        """Bounds, regions, obstacles and automaton by which flights are judged."""
        bounds = np.array(self.scene["bounds"])
        walled = self.scene["border"] == "wall"
        return Ground(bounds, self.regions, self.obstacles, self.dfa, walled, self.timetable)

    @cached_property
    def timetable(self) -> Timetable:
        """When the propositions with time windows hold."""
        windows = windows_of(self.automaton.get("windows"))
        return Timetable(windows, self.robot.dt if windows else 1.0)

    @cached_property
    def visited(self) -> list[tuple[str, tuple[Convex, ...]]]:
        """The propositions that are to be visited, with the convex parts of their regions."""
        places = [(name, self.timetable.region(name)) for name in self.dfa.atoms]
        allowed = [(name, place) for name, place in places if name not in self.automaton.get("forbidden", ())]
        return [(name, self.regions[place]) for name, place in allowed if place is not None]

    def letters_along(self, labels: Sequence[frozenset[str]]) -> list[frozenset[str]]:
        """The propositions that hold at each step of a path with these labels."""
        return [self.timetable.letter(label, self.timetable.now(t)) for t, label in enumerate(labels)]

    @property
    def grain(self) -> float:
        """A millionth of the size of the map [m]; points so close to an edge may count on either side."""
        return 1e-6 * float(np.ptp(np.array(self.scene["bounds"], float), axis=0).max())

    @cached_property
    def robot(self) -> Robot:
        """The robot of the settings; with robot.dt=auto its time step comes from the metrics."""
        settings = self.settings["robot"]
        if isinstance(settings["dt"], str):  # auto: the metrics have the chosen time step
            settings = settings | {"dt": float(self.metrics["dt_s"])}
        if self.settings["fidelity"]["judge"] == "flights":
            settings = settings | {
                "effort_risk": 1.0
            }  # no airspeed is reserved: flights show what is missing
        return Robot(
            a=np.array(settings["a"], float), b=np.array(settings["b"], float),
            ball=self.settings["wind"]["ball"],
            u_min=settings.get("u_min", 0.0),  # earlier versions have neither this setting nor the next two
            bank=math.radians(settings.get("bank", 0.0)), turn_delay=settings.get("turn_delay", 0.0),
            **energy_limits(settings.get("power") or {}),
            **{key: settings[key] for key in (
                "dt", "u_max", "start_sd", "feedback_time", "effort_risk", "fix_sd", "fix_time"
            )},
        )  # fmt: skip

    def energy_of(self, u: FloatArray) -> float:
        """Energy [J] of the controls ``u`` (T, 2) [m/s]."""
        power = self.robot.power
        assert power is not None
        return math.fsum(power(math.hypot(*control)) * self.robot.dt for control in u.tolist())

    @property
    def step_is_open(self) -> bool:
        """Whether robot.dt=auto: the planner then chooses the time step."""
        return isinstance(self.settings["robot"]["dt"], str)

    @property
    def epsilon(self) -> float:
        """planner.epsilon: the collision risk that planning allows in a segment; 1 for no limit."""
        stated = self.settings["planner"]["epsilon"]
        return 1.0 if stated is None else float(stated)

    # --- the plan -----------------------------------------------------------------------------

    @cached_property
    def x(self) -> FloatArray:
        """Planned means (T+1, 2) [m]."""
        return np.array(self.plan["x"], float)

    @cached_property
    def u(self) -> FloatArray:
        """Planned airspeeds (T, 2) [m/s]."""
        return np.array(self.plan["u"], float).reshape(-1, 2)

    @cached_property
    def start(self) -> FloatArray:
        """Start of the flight (2,) [m]."""
        return np.array(self.scene["start"], float)

    @cached_property
    def labels(self) -> list[frozenset[str]]:
        """Labels of the planned positions, from the polygons."""
        return self.ground.labels(self.x)

    def orders(self, x: FloatArray) -> list[str]:
        """Mission order of positions ``x``; on an edge of a region it may be any of several."""
        found = []
        for slack in (0.0, 1e-3 * self.grain, -1e-3 * self.grain):
            states, labels = self.ground.states(x[None], slack)[0], self.ground.labels(x, slack)
            before = [self.dfa.initial, *states[:-1]]
            atoms, turns = frozenset(self.dfa.atoms), np.flatnonzero(states != before)
            letters = [self.timetable.places(labels[t]) & atoms for t in turns]
            found.append(">".join("+".join(sorted(letter)) or "-" for letter in letters))
        return found

    @cached_property
    def times(self) -> Clock:
        """Slots of the wind at each step of the planned flight."""
        return self.clock_of(len(self.u))

    def clock_of(self, steps: int) -> Clock:
        """Slots of the wind at each step of a flight of ``steps`` steps."""
        return clock(self.wind, self.robot.dt, steps, int(self.settings["planner"]["max_steps"]))

    def law(self, name: str, steps: int | None = None) -> Law:
        """A wind law for ``steps`` steps, by default for the steps of the plan."""
        times = self.times if steps is None else self.clock_of(steps)
        if name == "independent":
            return Independent(self.wind, times, self.robot)
        used = self.planned_law == "coherent" and self.settings["fidelity"]["judge"] == "flights"
        fixed = used and not self.robot.feedback
        landmarks = landmarks_of(self.scene, self.robot.fix_sd) if fixed else ()
        return Coherent(self.wind, times, self.robot, landmarks)

    @property
    def planned_law(self) -> str:
        """The wind law that the plan is judged in."""
        return str(self.settings["fidelity"]["law"])

    @cached_property
    def course(self) -> Course:
        """The Gaussian along the planned means, under the law that the plan is judged in."""
        return laws.fly_means(self.law(self.planned_law), self.x)

    @cached_property
    def paper_course(self) -> Course:
        """The Gaussian along the planned means under the independent law, for f_o of the paper."""
        return laws.fly_means(self.law("independent"), self.x)

    @cached_property
    def forecasts(self) -> dict[str, Course]:
        """The Gaussian of the planned controls under each wind law for which the metrics have a forecast."""
        told = [name for name in LAWS if f"mission_risk_{name}" in self.metrics]
        return {name: laws.fly_controls(self.law(name), self.start, self.u) for name in told}

    # --- bounds -------------------------------------------------------------------------------

    def mission_bound(self, course: Course) -> float:
        """The ordered bound V of a course."""
        dfa = self.dfa
        masses = label_masses(self.labelled, course.x, course.cov)
        shown, table, states = {s for seen in masses for s in seen}, self.timetable, range(len(dfa.delta))
        nows, ways = [[of(t) for t in range(len(course.x))] for of in (table.now, table.way)]
        read = {
            now: [{s: dfa.delta[q][self._letter(s, now)] for s in shown} for q in states] for now in set(nows)
        }
        lost = {way: losing(dfa, self.ground.letter(frozenset(), way)) for way in set(ways)}
        losers = {
            way: [{s for s in shown if s and lost[way][q][self._letter(s, way)]} for q in states]
            for way in lost
        }
        way_met = Way(
            way_risks(self._hazards(lost, ways), course.x, course.cov, len(dfa.delta)),
            [losers[way] for way in ways],
        )
        steps = [read[now] for now in nows]
        return ordered(masses, steps, covers(dfa), dfa.initial, dfa.accepting, way_met)

    def _letter(self, label: Iterable[str], holding: frozenset[str]) -> int:
        """The number of the letter that a label shows while windows are open."""
        return self.dfa.letters.index(self.ground.letter(frozenset(label), holding))

    def _hazards(
        self, lost: Mapping[frozenset[str], list[list[bool]]], ways: Sequence[frozenset[str]]
    ) -> list[tuple[Convex, list[list[bool]]]]:
        """Cells whose letter loses some state of the automaton, and at each step which states."""
        found = []
        for cell, label in zip(self.cells["cells"], self.cells["labels"], strict=True):
            by_way = {way: [row[self._letter(label, way)] for row in table] for way, table in lost.items()}
            if any(any(row) for row in by_way.values()):
                found.append((convex(cell), [by_way[way] for way in ways]))
        return found

    def collision_bounds(self, law: Law, course: Course) -> tuple[float, float]:
        """R of a course (low, high), with a looser and a stricter test of growing deviations.

        The planner's R lies between them: rounding may decide that test either way.
        """
        parts: Sequence[Convex] = self.barriers
        if self.settings["fidelity"]["collision_bound"] == "path":
            parts = [with_lines(part, course.x, course.cov) for part in parts]
        low, high = (
            path_bound(parts, course.x, course.cov, self._growth(parts, law, course, share))
            for share in (1e-6, -1e-7)
        )
        return low, high

    def _growth(self, parts: Sequence[Convex], law: Law, course: Course, share: float) -> list[BoolArray]:
        """For each obstacle (faces, r, t): whether the deviation along a normal grows from r to t."""
        n = len(course.x)
        if isinstance(law, Coherent) and not course.chances:
            cross = laws.covariance_across(law, course)
            return [growing(part, cross, share) for part in parts]
        walks = isinstance(law, Independent) and np.array_equal(law.robot.closed, np.eye(2))
        return [np.full((len(part.offsets), n, n), walks) for part in parts]

    # --- flights ------------------------------------------------------------------------------

    def simulator(self, name: str) -> Simulator:
        """Simulator for new flights of the plan under a wind law."""
        return self._simulator_of(name, self.x, self.u)

    def front_simulator(self, number: int) -> Simulator:
        """Simulator for new flights of a path of the front under the wind law of planning."""
        return self._simulator_of(self.planned_law, self.front_x(number), self.front_u(number))

    def _simulator_of(self, name: str, x: FloatArray, u: FloatArray) -> Simulator:
        planned, law = self.law("coherent", len(u)), self.law(name, len(u))
        marks = planned.landmarks if isinstance(planned, Coherent) else ()
        alone = replace(law, landmarks=()) if isinstance(law, Coherent) else law
        return Simulator(law, laws.fly_means(alone, x) if marks else None, x, u, marks)

    @cached_property
    def new_flights(self) -> dict[str, FloatArray]:
        """Positions (n, T+1, 2) [m] of new flights under each law: n as in the results, 2,000 to 20,000.

        As many as the promise has, if that is more: fewer could not contradict it.
        """
        flights, promise = {}, self.plan["promise"] or {}
        for number, name in enumerate(LAWS):
            if f"{name}/x" in self.flights:
                promised = promise["runs"] if promise.get("law") == name else 0
                runs = min(max(len(self.flights[f"{name}/x"]), promised, 2000), 20_000)
                flights[name] = self.simulator(name).fly(runs, np.random.default_rng([20181009, number]))
        return flights

    @cached_property
    def held_failures(self) -> tuple[int, int]:
        """How many of how many new flights with ``robot.feedback_time=60`` fail, in the winds of the plan."""
        held = replace(self.law(self.planned_law), robot=replace(self.robot, feedback_time=HELD_TIME))
        x = Simulator(held, None, self.x, self.u, ()).fly(HELD_RUNS, np.random.default_rng(20181011))
        return int(self.ground.failed(x).sum()), HELD_RUNS


def open_evidence(directory: Path) -> Evidence:
    """The evidence in ``directory``.

    Raises
    ------
    DataError
        If it holds no finished result of a plan.
    """
    if not directory.is_dir():
        raise DataError(f"{directory}: no such folder; give a results directory")
    run = read_json(directory / "run.json")
    if run.get("status") not in ("ok", "infeasible"):
        raise DataError(f"{directory}: no finished result: {ending_text(directory, run.get('status'))}")
    stages = run.get("stages")
    if not isinstance(stages, list) or "plan" not in stages:
        raise DataError(
            f"{directory}: holds no plan, its stages are {stages}; verify judges the results of the "
            "command plan"
        )
    return Evidence(directory, run, read_json(directory / "metrics.json"), _settings(directory))


def _settings(directory: Path) -> dict[str, Any]:
    import yaml

    path = directory / "config_resolved.yaml"
    try:
        content = yaml.safe_load(read_text(path))
    except yaml.YAMLError as error:
        raise DataError(f"{path}: not YAML ({' '.join(str(error).split())}); run the plan again") from error
    if not isinstance(content, dict):
        raise DataError(
            f"{path}: expected keys and values, found {type(content).__name__}; run the plan again"
        )
    return content
