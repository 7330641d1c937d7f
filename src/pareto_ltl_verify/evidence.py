"""A results directory as evidence: its files, and values computed from them without the planner's code."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from careful_io.archives import read_npz
from careful_io.errors import DataError
from careful_io.fingerprints import file_fingerprint
from careful_io.links import refuse_links_out
from careful_io.reading import read_json
from careful_io.yaml_files import read_yaml
from pareto_ltl_verify import gaussians, laws
from pareto_ltl_verify.arrays import BoolArray, FloatArray, IntArray
from pareto_ltl_verify.flights import NONE, Ground, failures, fly
from pareto_ltl_verify.formula import Dfa, Timetable, covers, losing, windows_of
from pareto_ltl_verify.geometry import Convex, beyond_bounds, convex
from pareto_ltl_verify.laws import Coherent, Course, Independent, Law, landmarks_of
from pareto_ltl_verify.rare import rare_failures
from pareto_ltl_verify.robot import Robot, energy_limits
from pareto_ltl_verify.sources import Source, source_of
from pareto_ltl_verify.wind_tables import ENSEMBLE, clock, read_wind_file
from pareto_ltl_verify.wording import ending_text

T = TypeVar("T")
LAWS = ("independent", "coherent")
BATCH = 20_000  # new flights that are in memory together, at most
HELD_RUNS = 2000  # new flights with position feedback
HELD_TIME = 60.0  # time constant of the position feedback of exports [s]
ROBOT = ("dt", "u_max", "start_sd", "feedback_time", "effort_risk", "fix_sd", "fix_time")  # used as set


def content_of(name: str, read: Callable[[Path], T]) -> cached_property[T]:
    """A property of :class:`Evidence`: the content of a file, read when first needed."""
    return cached_property(lambda self: read(self.directory / name))


def read_table(path: Path) -> list[dict[str, str]]:
    """The rows of a CSV file."""
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


@dataclass(frozen=True, eq=False)
class Evidence:
    """One finished result. Files are read when first needed, and derived values are cached."""

    directory: Path
    run: Mapping[str, Any]
    metrics: Mapping[str, Any]
    settings: Mapping[str, Any]
    source: Path | None = None  # file, or folder with the files, that the run read, if they have moved

    scene = content_of("scene.json", read_json)
    cells = content_of("cells.json", read_json)
    automaton = content_of("automaton.json", read_json)
    plan = content_of("plan.json", read_json)
    front = content_of("front.csv", read_table)
    front_arrays = content_of("front.npz", read_npz)
    trees = content_of("trees.npz", read_npz)
    flights = content_of("deployments.npz", read_npz)
    replanned = content_of("replan.json", read_json)
    wind = content_of("wind.nc", read_wind_file)

    @cached_property
    def remembered(self) -> dict[str, object]:
        """Results of long computations by name, so that several claims share them."""
        return {}

    def has(self, name: str) -> bool:
        """Whether the directory holds the file ``name``."""
        return (self.directory / name).is_file()

    def table(self, name: str) -> list[dict[str, str]]:
        """The rows of a CSV file."""
        return read_table(self.directory / name)

    def is_input(self, path: Path) -> bool:
        """Whether ``path``, outside the directory, is a file that the run read, by its SHA-256."""
        return _has_fingerprint(path, self.run["inputs"].get(str(path)))

    def moved_input(self, path: Path) -> Path:
        """Where the file ``path`` is now that the run read: there, or at ``source``."""
        if self.source is None or self.is_input(path):
            return path
        here = self.source / path.name if self.source.is_dir() else self.source
        return here if _has_fingerprint(here, self.run["inputs"].get(str(path))) else path

    def document(self, name: str) -> dict[str, Any]:
        """The content of a JSON file."""
        return read_json(self.directory / name)

    def front_x(self, number: int) -> FloatArray:
        """Positions (T+1, 2) [m] of a path of the front."""
        return np.asarray(self.front_arrays[f"path_{number:03d}/x"], float)

    def front_u(self, number: int) -> FloatArray:
        """Controls (T, 2) [m/s] of a path of the front."""
        return np.asarray(self.front_arrays[f"path_{number:03d}/u"], float)

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
        return source == "ensemble" or (self.source_row.ensemble and members)

    @property
    def source_row(self) -> Source:
        """What the source of the wind implies."""
        return source_of(str(self.settings["wind"]["source"]))

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

    @property
    def grain(self) -> float:
        """A millionth of the size of the map [m]; points so close to an edge may count on either side."""
        return 1e-6 * float(np.ptp(np.array(self.scene["bounds"], float), axis=0).max())

    @cached_property
    def robot(self) -> Robot:
        """The robot of the settings; with robot.dt=auto its time step comes from the metrics."""
        settings = dict(self.settings["robot"])
        if self.step_is_open:
            settings["dt"] = float(self.metrics["dt_s"])
        if self.settings["fidelity"]["judge"] == "flights":
            settings["effort_risk"] = 1.0  # no airspeed is reserved: flights show what is missing
        return Robot(
            a=np.array(settings["a"], float), b=np.array(settings["b"], float),
            ball=self.settings["wind"]["ball"],
            u_min=settings.get("u_min", 0.0),  # earlier versions have neither this setting nor the next two
            bank=math.radians(settings.get("bank", 0.0)), turn_delay=settings.get("turn_delay", 0.0),
            **energy_limits(settings.get("power") or {}), **{key: settings[key] for key in ROBOT},
            airspeed_sd=settings.get("airspeed_sd"),  # earlier versions have none of the next three
            heading_sd=settings.get("heading_sd"), clock_sd=settings.get("clock_sd"),
            bias=tuple(settings.get(f"{name}_bias", 0.0) for name in ("airspeed", "heading", "clock")),
            correlation=tuple(settings.get("error_correlation", (0.0, 0.0, 0.0))),
            start_shared=settings.get("start_error_covariance", ((0.0, 0.0),) * 3),
        )  # fmt: skip

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

    def law(self, name: str, steps: int | None = None) -> Law:
        """A wind law for ``steps`` steps, by default for the steps of the plan."""
        longest = int(self.settings["planner"]["max_steps"])
        times = clock(self.wind, self.robot.dt, len(self.u) if steps is None else steps, longest)
        if name == "independent":
            return Independent(self.wind, times, self.robot)
        used = self.planned_law == "coherent" and self.settings["fidelity"]["judge"] == "flights"
        tables = (
            self.settings.get("branch", {}).get("leaves", 1) > 1
        )  # a fix chooses a table, and steers nothing
        fixed = used and not self.robot.feedback and not tables
        landmarks = landmarks_of(self.scene, self.robot.fix_sd) if fixed else ()
        return Coherent(self.wind, times, self.robot, landmarks)

    @property
    def planned_law(self) -> str:
        """The wind law that the plan is judged in."""
        return str(self.settings["fidelity"]["law"])

    @property
    def flows(self) -> tuple[str, ...]:
        """What moves the robot, in words; files of earlier versions also call currents winds."""
        wind, flown = self.settings["wind"], self.settings["robot"].get("level") or ""
        depth = any(text.endswith("depth") for text in (wind["level"], flown))
        return ("currents", "winds") if depth or self.source_row.current else ("winds",)

    @cached_property
    def course(self) -> Course:
        """The Gaussian along the planned means, under the law that the plan is judged in."""
        return self.course_of(self.x)

    def course_of(self, x: FloatArray) -> Course:
        """The Gaussian along means ``x`` (T+1, 2) [m], under the law that the plan is judged in."""
        return laws.fly_means(self.law(self.planned_law, len(x) - 1), x)

    def grown_course(self, x: FloatArray) -> Course:
        """The Gaussian along means ``x`` (T+1, 2) [m] in a tree: under the independent law.

        Its start is as uncertain as the start of the plan.
        """
        lean = self.law(self.planned_law).errors.start
        return laws.fly_means(self.law("independent", len(x) - 1), x, lean @ lean.T)

    @property
    def grown_as_published(self) -> bool:
        """Whether trees grew by the models of the paper; earlier versions wrote the rule of other trees."""
        return bool(self.settings["fidelity"]["parents"] == "dominance")

    @property
    def planned_as_published(self) -> bool:
        """Whether the plan has the models of the paper, so that a vertex costs what its path costs."""
        fidelity = self.settings["fidelity"]
        chosen = fidelity["law"], fidelity["mission_bound"], fidelity["collision_bound"]
        return chosen == ("independent", "theorem2", "step")

    @cached_property
    def paper_course(self) -> Course:
        """The Gaussian along the planned means under the independent law, for f_o of the paper."""
        return laws.fly_means(self.law("independent"), self.x)

    @cached_property
    def segments(self) -> tuple[FloatArray, FloatArray]:
        """z of each segment of the plan and barrier (T, m), and the risk of each segment (T,)."""
        return gaussians.segment_risks(self.barriers, self.x, self.course.cov)

    @cached_property
    def forecasts(self) -> dict[str, Course]:
        """The Gaussian of the planned controls under each wind law for which the metrics have a forecast."""
        reported = [name for name in LAWS if f"mission_risk_{name}" in self.metrics]
        return {name: laws.fly_controls(self.law(name), self.start, self.u) for name in reported}

    # --- bounds -------------------------------------------------------------------------------

    def mission_bound(self, course: Course) -> float:
        """The ordered bound V of a course."""
        dfa, table, steps = self.dfa, self.timetable, range(len(course.x))
        masses = gaussians.label_masses(self.labelled, course.x, course.cov)
        labels = list({label for seen in masses for label in seen})
        empty = np.array([not label for label in labels])
        ways = [table.way(t) for t in steps]
        lose = {way: losing(dfa, self.ground.letter(NONE, way)) for way in set(ways)}
        read = {now: self.letter_numbers(labels, now) for now in {*ways, *map(table.now, steps)}}
        loses = {way: rows[:, self.letter_numbers(self.cells["labels"], way)] for way, rows in lose.items()}
        hazards = np.flatnonzero(np.any([rows.any(axis=0) for rows in loses.values()], axis=0))
        cells = [convex(self.cells["cells"][k]) for k in hazards]
        found = []
        for t, (seen, way) in enumerate(zip(masses, ways, strict=True)):
            on = slice(max(t - 1, 0), t + 1)
            met = np.array([gaussians.crossing(cell, course.x[on], course.cov[on]) for cell in cells])
            found.append(gaussians.Step(
                mass=np.array([seen.get(label, 0.0) for label in labels]),
                after=np.array(dfa.delta)[:, read[table.now(t)]],
                lost=lose[way][:, read[way]] & ~empty,
                cost=loses[way][:, hazards] @ met,
            ))  # fmt: skip
        return gaussians.ordered(found, covers(dfa), dfa.initial, dfa.accepting)

    def paper_bound(self, course: Course, labels: Sequence[frozenset[str]]) -> float:
        """f_o of Theorem 2 of a course with these labels at its steps."""
        letters = [self.timetable.letter(label, self.timetable.now(t)) for t, label in enumerate(labels)]
        return gaussians.theorem2(self.visited, course.x, course.cov, letters)

    def judged_bound(self, course: Course, labels: Sequence[frozenset[str]]) -> float:
        """The bound on the mission risk that the settings name."""
        by_order = self.settings["fidelity"]["mission_bound"] == "ordered"
        return self.mission_bound(course) if by_order else self.paper_bound(course, labels)

    def letter_numbers(self, labels: Iterable[Iterable[str]], holding: frozenset[str]) -> IntArray:
        """The numbers of the letters that ``labels`` show while windows ``holding`` are open."""
        letters = (self.ground.letter(frozenset(label), holding) for label in labels)
        return np.array([self.dfa.letters.index(letter) for letter in letters], int)

    def collision_bounds(self, law: Law, course: Course) -> tuple[float, float]:
        """R of a course (low, high), with a looser and a stricter test of growing deviations.

        The planner's R lies between them: rounding may decide that test either way.
        """
        parts: Sequence[Convex] = self.barriers
        if self.settings["fidelity"]["collision_bound"] == "path":
            parts = [gaussians.with_lines(part, course.x, course.cov) for part in parts]
        n, across = len(course.x), None
        walks = isinstance(law, Independent) and np.array_equal(law.robot.closed, np.eye(2))
        if isinstance(law, Coherent) and not course.chances:
            across = laws.covariance_across(law, course)

        def grows(part: Convex, share: float) -> BoolArray:
            """Whether the deviation along a normal grows from r to t, (faces, r, t)."""
            if across is None:
                return np.full((len(part.offsets), n, n), walks)
            return gaussians.growing(part, across, share)

        low, high = (
            gaussians.path_bound(parts, course.x, course.cov, [grows(part, share) for part in parts])
            for share in (1e-6, -1e-7)
        )
        return low, high

    # --- flights ------------------------------------------------------------------------------

    def fly(self, name: str, x: FloatArray, u: FloatArray, runs: int, *seed: int) -> FloatArray:
        """New flights (runs, T+1, 2) [m] under a wind law: controls ``u`` (T, 2) about ``x`` (T+1, 2)."""
        landmarks = self.law("coherent", len(u)).landmarks
        return fly(self.law(name, len(u)), x, u, runs, np.random.default_rng(seed), landmarks)

    @cached_property
    def new_flights(self) -> dict[str, FloatArray]:
        """Positions (n, T+1, 2) [m] of new flights under each law.

        As many as in the results or as the promise has, 2,000 to :data:`BATCH`: fewer could not contradict
        it.
        """
        flights, promise = {}, self.plan["promise"] or {}
        for number, name in enumerate(LAWS):
            if f"{name}/x" in self.flights:
                promised = promise["runs"] if promise.get("law") == name else 0
                runs = min(max(len(self.flights[f"{name}/x"]), promised, 2000), BATCH)
                flights[name] = self.fly(name, self.x, self.u, runs, 20181009, number)
        return flights

    @cached_property
    def new_verdicts(self) -> dict[str, tuple[BoolArray, BoolArray, BoolArray]]:
        """Which of :attr:`new_flights` complete the mission, meet an obstacle, and leave the map."""
        ground = self.ground
        flown = self.new_flights.items()
        return {name: (ground.accepted(x), ground.collided(x), ground.off_map(x)) for name, x in flown}

    def new_failures(self, name: str) -> BoolArray:
        """Which of :attr:`new_flights` under a law fail."""
        return failures(*self.new_verdicts[name], self.ground.walled)

    def more_failures(self, name: str, runs: int) -> Iterator[tuple[int, int]]:
        """Failed and all flights of further batches of new flights under a law, ``runs`` in all."""
        for number, first in enumerate(range(0, runs, BATCH), 1):
            few = min(BATCH, runs - first)
            x = self.fly(name, self.x, self.u, few, 20181009, LAWS.index(name), number)
            yield int(self.ground.failed(x).sum()), few

    @cached_property
    def rare_failures(self) -> FloatArray:
        """Weights (n,) of new flights of the plan, drawn so that many fail; 0 for others. May be empty."""
        law = self.law(self.planned_law)
        return rare_failures(law, self.ground, self.x, self.u, (20181009, LAWS.index(self.planned_law), 7))

    @cached_property
    def held_failures(self) -> tuple[int, int]:
        """How many of how many new flights with ``robot.feedback_time=60`` fail, in the winds of the plan."""
        held = replace(self.law(self.planned_law), robot=replace(self.robot, feedback_time=HELD_TIME))
        x = fly(held, self.x, self.u, HELD_RUNS, np.random.default_rng(20181011))
        return int(self.ground.failed(x).sum()), HELD_RUNS


def _has_fingerprint(path: Path, stated: str | None) -> bool:
    try:
        return stated is not None and path.is_file() and file_fingerprint(path) == stated
    except OSError:
        return False


def open_evidence(directory: Path, source: Path | None = None) -> Evidence:
    """The evidence in ``directory``; ``source`` is a file, or a folder with files, that the run read.

    Raises
    ------
    DataError
        If it holds no finished result of a plan, a link leads out of it, or ``source`` is no input of it.
    """
    if not directory.is_dir():
        raise DataError(f"{directory}: no such folder; give a results directory")
    refuse_links_out(directory)
    run = read_json(directory / "run.json")
    if run.get("status") not in ("ok", "infeasible"):
        raise DataError(f"{directory}: no finished result: {ending_text(directory, run.get('status'))}")
    stages = run.get("stages")
    if not isinstance(stages, list) or "plan" not in stages:
        raise DataError(
            f"{directory}: holds no plan, its stages are {stages}; verify judges the results of the "
            "command plan"
        )
    path = directory / "config_resolved.yaml"
    settings = read_yaml(path)
    if not isinstance(settings, dict):
        kind = type(settings).__name__
        raise DataError(f"{path}: expected keys and values, found {kind}; run the plan again")
    result = Evidence(directory, run, read_json(directory / "metrics.json"), settings, source)
    inputs = [Path(name) for name in run["inputs"]]
    if source is not None and not any(result.moved_input(path) != path or path == source for path in inputs):
        raise DataError(
            f"{source}: no file there has the name and the SHA-256 of an input of {directory / 'run.json'}, "
            f"which are {', '.join(path.name for path in inputs) or 'none'}"
        )
    return result


def all_branches(tree: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """What ``plan.json`` states of every branch: A, A1, A2, B, ..."""
    for row in tree["branches"]:
        yield row
        yield from all_branches(row["branches"]) if "branches" in row else ()


def all_trees(tree: Mapping[str, Any]) -> Iterator[Mapping[str, Any]]:
    """What it states of every fix at which the plan branches, the first one first."""
    yield tree
    for row in tree["branches"]:
        yield from all_trees(row["branches"]) if "branches" in row else ()
