"""Missions of many kinds, each an independent child of one seed; all are flyable by geometry."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from corpus.drawing import BORDERS, Feature, Place
from corpus.maps import WRITERS, Recipe, draw_goals, draw_map
from corpus.winds import WINDS
from pareto_ltl.support.arrays import FloatArray

DETOUR = 3.0  # times the time of the straight tour in still air: the hours of wind that a mission needs
LATE, EARLY = 4.0, 1.0  # the same for deadlines and for spans in which a region is forbidden
LANDMARKS = 1 / 3  # share of missions with one to three
DRAWS = 2000  # drawings of one mission before its kind is given up


@dataclass(frozen=True, slots=True)
class Vehicle:
    """A vehicle, and the maps for it.

    Attributes
    ----------
    half : (float, float)
        Range of half the side [m].
    tour : float
        Longest straight tour through all regions [m].
    feedback : float
        Share with position feedback.
    """

    preset: str
    half: tuple[float, float]
    u_max: float  # [m/s]
    tour: float
    feedback: float = 0.0


@dataclass(frozen=True, slots=True)
class Shape:
    """A shape of formulas over ``regions`` regions; ``early`` and ``late`` are times [min]."""

    name: str
    regions: int
    text: str


@dataclass(frozen=True, slots=True)
class Kind:
    """One kind of mission: its share of the corpus and the choices that it is drawn from, empty: all."""

    name: str
    share: float
    winds: tuple[str, ...] = ("sample", "forecast", "no leads", "held", "calm")
    vehicles: tuple[str, ...] = ()
    shapes: tuple[str, ...] = ()
    borders: tuple[str, ...] = ()
    obstacles: tuple[int, ...] = (0, 3, 8, 8, 15)
    place: str = "america"
    clusters: float = 0.15
    at_border: int = 0
    corners: int = 0
    timed: bool = False


VEHICLES = {
    "multirotor": Vehicle("multirotor", (3e3, 8e3), 16.0, 9e3, 0.9),
    "fixed_wing": Vehicle("fixed_wing", (4e3, 15e3), 20.0, 25e3, 0.9),
    "long_endurance": Vehicle("long_endurance", (3e4, 2e5), 33.0, 7e5, 0.5),
    "airframe": Vehicle("airframe", (6e4, 4e5), 30.0, 1.6e6, 0.2),
    "light_aircraft": Vehicle("light_aircraft", (4e4, 2e5), 55.0, 4e5, 0.5),
    "underwater_glider": Vehicle("underwater_glider", (25e3, 6e4), 0.35, 9e4),
}
AIRCRAFT = tuple(name for name in VEHICLES if name != "underwater_glider")
SHAPES = (
    Shape("sequence", 2, "F(a & F b)"),
    Shape("coverage", 2, "F a & F b"),
    Shape("patrol", 2, "F(a & F(b & F a))"),
    Shape("until", 2, "!b U a & F b"),
    Shape("deadline", 2, "F[0,{late}min] a & F b"),
    Shape("sequence", 3, "F(a & F(b & F c))"),
    Shape("coverage", 3, "F a & F b & F c"),
    Shape("first", 3, "F(a & F b & F c)"),
    Shape("either", 3, "F(a & (F b | F c))"),
    Shape("two ways", 3, "F(a & F b) | F(a & F c)"),
    Shape("until", 3, "!c U a & F b & F c"),
    Shape("forbidden", 3, "!c U (a & (!c U b))"),
    Shape("closed for a time", 3, "F a & F b & G[0,{early}min] !c"),
    Shape("deadline", 3, "F(a & F b) & F[0,{late}min] c"),
    Shape("coverage", 4, "F a & F b & F c & F d"),
    Shape("two ways", 4, "F(a & F(b | c) & F d)"),
    Shape("forbidden", 4, "!d U (a & F b) & F c"),
    Shape("coverage", 5, "F a & F b & F c & F d & F e"),
    Shape("first", 5, "F(a & F b & F c & F d & F e)"),
)
REGIONS = {2: 0.35, 3: 0.4, 4: 0.15, 5: 0.1}  # shares
CALMER = ("forecast", "no leads", "ensemble", "calm")  # winds that also exist outside of America
KINDS = (
    Kind("plain", 30),
    Kind("crowded", 9, obstacles=(15, 25), clusters=0.4, at_border=2),
    Kind("nearly a rectangle", 9, borders=("plane",), vehicles=("airframe", "long_endurance")),
    Kind("deadline", 6, shapes=("deadline",)),
    Kind("forbidden", 6, shapes=("forbidden", "until", "closed for a time")),
    Kind("timed", 8, timed=True),
    Kind(
        "five regions", 4, shapes=("coverage", "first"), vehicles=("airframe", "long_endurance", "fixed_wing")
    ),
    Kind("coast", 6, corners=2500, obstacles=(3, 8)),
    Kind("180 degrees", 6, place="180 degrees", winds=CALMER),
    Kind("elsewhere", 4, place="elsewhere", winds=CALMER),
    Kind("current", 6, vehicles=("underwater_glider",), winds=("current table", "current file")),
    Kind("ensemble", 6, winds=("ensemble",)),
    Kind("GRIB", 4, winds=("grib",)),
    Kind("stations", 2, winds=("stations",)),
)
PLACES = {  # southern and northern latitude, western and eastern longitude of the middles of maps [deg]
    "america": (30.0, 46.0, -118.0, -78.0),
    "180 degrees": (-45.0, 55.0, 179.9, 180.1),
    "elsewhere": (-50.0, 60.0, -180.0, 180.0),
}


@dataclass(frozen=True, slots=True)
class Mission:
    """One mission of the corpus, before its files are written.

    Attributes
    ----------
    words : list of str
        Words of the command line that name no files.
    format : str
        ``geojson`` or ``kml``.
    seed : SeedSequence
        Of the files of the wind.
    tags : dict
        What the mission is, for tables.
    """

    name: str
    features: list[Feature]
    format: str
    place: Place
    half: float
    words: list[str]
    seed: np.random.SeedSequence
    tags: dict[str, Any] = field(default_factory=dict)

    def write(self, folder: Path) -> list[str]:
        """Write the map, the map without landmarks and the wind; the words of the command line."""
        folder.mkdir(parents=True, exist_ok=True)
        write = WRITERS[self.format]
        write(self.features, folder / f"map.{self.format}")
        if self.tags["landmarks"]:
            bare = [feature for feature in self.features if feature.role != "landmark"]
            write(bare, folder / f"bare.{self.format}")
        wind = WINDS[self.tags["wind"]].write(np.random.default_rng(self.seed), self.place, self.half, folder)
        words = [f"name={self.name}", f"scene.file={folder / f'map.{self.format}'}", *self.words, *wind]
        sketch = [[f.role, f.geometry, _thinned(f.points).tolist()] for f in self.features]
        record = {"words": words, "tags": self.tags, "sketch": sketch}
        (folder / "mission.json").write_text(json.dumps(record) + "\n")
        return words


def _thinned(points: FloatArray) -> FloatArray:
    """At most 60 of the corners, for a small picture."""
    return points[:: math.ceil(len(points) / 60)].round(5)


def missions(count: int, seed: int, landmarks: int | None = None) -> list[Mission]:
    """``count`` missions, without those that need files that are not there (see ``left_out``).

    With ``landmarks``, each map has room for as many or fewer, and no vehicle has position feedback.
    """
    shares = np.array([kind.share for kind in KINDS]) / sum(kind.share for kind in KINDS)
    made = []
    for number in range(count):
        source = np.random.SeedSequence(seed, spawn_key=(number,))
        kind = KINDS[int(np.random.default_rng(source.spawn(1)[0]).choice(len(KINDS), p=shares))]
        if is_available(kind):
            made.append(make(kind, f"m{number:03d}", source, landmarks))
    return made


def tenth(seed: int) -> list[Mission]:
    """One mission of every kind, about a tenth of a corpus."""
    return [of_kind(kind.name, seed) for kind in KINDS if is_available(kind)]


def of_kind(name: str, seed: int) -> Mission:
    """The mission of one kind of ``tenth(seed)``."""
    number = [kind.name for kind in KINDS].index(name)
    return make(KINDS[number], f"k{number:02d}", np.random.SeedSequence(seed, spawn_key=(number,)))


def is_available(kind: Kind) -> bool:
    """Whether the files of its winds are there."""
    needs = [WINDS[wind].needs for wind in kind.winds]
    return all(folder is None or folder.is_dir() for folder in needs)


def left_out() -> list[str]:
    """Names of the kinds that need files that are not there."""
    return [kind.name for kind in KINDS if not is_available(kind)]


def make(kind: Kind, name: str, source: np.random.SeedSequence, landmarks: int | None = None) -> Mission:
    """A mission of ``kind``; drawn again until it fits the range of the vehicle and the hours of wind."""
    drawing, files = source.spawn(2)
    rng = np.random.default_rng(drawing)
    for _ in range(DRAWS):
        made = _draw(rng, kind, name, files, landmarks)
        if made is not None:
            return made
    raise RuntimeError(
        f"no mission of kind {kind.name!r} fits after {DRAWS} drawings; widen its row in KINDS"
    )


def _pick(rng: np.random.Generator, choices: Sequence[str]) -> str:
    return str(choices[int(rng.integers(len(choices)))])


def _draw(
    rng: np.random.Generator, kind: Kind, name: str, files: np.random.SeedSequence, landmarks: int | None
) -> Mission | None:
    """One mission; None if it does not fit."""
    vehicle = VEHICLES[_pick(rng, kind.vehicles or AIRCRAFT)]
    shape, wind = _shape(rng, kind), _pick(rng, kind.winds)
    recipe = _recipe(rng, kind, vehicle, shape.regions, landmarks)
    goals = draw_goals(rng, recipe)
    if goals is None or goals.tour > vehicle.tour:
        return None
    hours = goals.tour / vehicle.u_max / 3600.0
    departure = WINDS[wind].departure(rng, DETOUR * hours)
    if departure is None:
        return None
    features = draw_map(rng, recipe, goals)
    if kind.timed:
        features = _timed(rng, features, hours)
    formula = shape.text.format(early=math.ceil(60 * EARLY * hours), late=math.ceil(60 * LATE * hours))
    feedback = float(rng.choice([60.0, 600.0, 3600.0])) if rng.random() < vehicle.feedback else 0.0
    feedback = feedback if landmarks is None else 0.0
    words = [f"mission.formula='{formula}'", f"robot={vehicle.preset}", f"mission.start_time={departure}"]
    words += [f"robot.feedback_time={feedback:g}"] if feedback else []
    number = Counter(feature.role for feature in features)
    tags = {
        "kind": kind.name, "vehicle": vehicle.preset, "feedback": feedback, "wind": wind,
        "shape": shape.name, "formula": formula, "departure": departure,
        "side_km": round(2 * recipe.half / 1e3, 1), "tour_km": round(goals.tour / 1e3, 2),
        "middle": [round(recipe.place.lat, 4), round(recipe.place.lon, 4)], "border": recipe.border,
        "regions": number["region"], "obstacles": number["obstacle"], "landmarks": number["landmark"],
    }  # fmt: skip
    format = _pick(rng, ("geojson", "geojson", "kml"))
    return Mission(name, features, format, recipe.place, recipe.half, words, files, tags)


def _recipe(
    rng: np.random.Generator, kind: Kind, vehicle: Vehicle, regions: int, asked: int | None
) -> Recipe:
    """Numbers of a map; one with landmarks has a border, so that it is the same map without them."""
    south, north, west, east = PLACES[kind.place]
    landmarks = int(rng.integers(1, 4)) if rng.random() < LANDMARKS else 0
    landmarks = landmarks if asked is None else asked
    borders = [border for border in kind.borders or BORDERS if border != "none" or not landmarks]
    return Recipe(
        place=Place(rng.uniform(south, north), rng.uniform(west, east)),
        half=math.exp(rng.uniform(*np.log(vehicle.half))),
        border=_pick(rng, borders),
        regions=regions,
        obstacles=int(rng.choice(kind.obstacles)),
        landmarks=landmarks,
        clusters=kind.clusters,
        at_border=kind.at_border,
        corners=kind.corners,
    )


def _shape(rng: np.random.Generator, kind: Kind) -> Shape:
    """A shape of the kind: first the number of regions, then one of its shapes."""
    known = [shape for shape in SHAPES if not kind.shapes or shape.name in kind.shapes]
    if kind.name == "five regions":
        known = [shape for shape in known if shape.regions == 5]
    counts = sorted({shape.regions for shape in known})
    shares = np.array([REGIONS[count] for count in counts])
    regions = int(rng.choice(counts, p=shares / shares.sum()))
    fitting = [shape for shape in known if shape.regions == regions]
    return fitting[int(rng.integers(len(fitting)))]


def _timed(rng: np.random.Generator, features: list[Feature], hours: float) -> list[Feature]:
    """One region opens after a third of the tour or closes late; a third of the obstacles are temporary."""
    opens = {"from": _minutes(0.3 * hours)} if rng.random() < 0.5 else {"until": _minutes(LATE * hours)}
    chosen = _pick(rng, [f.properties["name"] for f in features if f.role == "region"])
    found = []
    for feature in features:
        more: dict[str, Any] = {}
        if feature.role == "region" and feature.properties["name"] == chosen:
            more = opens
        elif feature.role == "obstacle" and rng.random() < 1 / 3:
            begins = rng.uniform(0.0, 1.0) * hours
            more = {"from": _minutes(begins), "until": _minutes(begins + rng.uniform(0.2, 1.5) * hours)}
        found.append(replace(feature, properties={**feature.properties, **more}))
    return found


def _minutes(hours: float) -> str:
    """A time after departure for ``from`` and ``until``."""
    return f"{max(1, round(60 * hours))}min"
