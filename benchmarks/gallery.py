"""The gallery of the documentation: plans missions, draws their figures and writes the page that shows them.

    make gallery                                       # docs/gallery.md, docs/images/gallery and the strip
    python benchmarks/gallery.py FOLDER --only timed   # some of the pictures, into a folder, without the page

The missions are planned with the default settings, which takes some minutes.
"""

from __future__ import annotations

import argparse
import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from PIL import Image

import pareto_ltl
from careful_io.files import write_bytes, write_text
from careful_io.yaml_files import read_yaml
from pareto_ltl.run.plan_run import Run
from pareto_ltl.support.resources import CONF
from pareto_ltl_apps.view.figures import Drawing

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
IMAGES = DOCS / "images" / "gallery"
EXAMPLES = ROOT / "examples"
DPI = 150
COLOURS = 256  # of a picture: rare ones are kept; half of the bytes
FLIGHTS, DRAWN, FRAMES = 1000, 100, 5
PHI2 = "F(a & F(b & F c)) | F(a & F(d & F c))"
FIX = ("6h", (38.7, -96.1, 5000.0))  # when, and (latitude, longitude, standard deviation [m])


def timed_map() -> dict[str, Any]:
    """The map of phi1 with times: ``a`` only early, ``c`` only late, and a storm between ``a`` and ``b``."""
    scene = read_yaml(CONF.file("scene", "phi1"))
    scene["regions"]["storm"] = [[3.2, 8.0], [4.0, 7.8], [4.3, 9.8], [3.3, 9.9]]
    scene["windows"] = {
        "a": {"until": "8h"},
        "c": {"from": "16h"},
        "storm": {"from": "3h", "until": "12h", "forbidden": True},
    }
    return scene


MISSIONS: Mapping[str, Callable[[], dict[str, Any]]] = {
    "phi2": lambda: {"scene": "phi2", "formula": PHI2},
    "timed": lambda: {"scene": timed_map(), "formula": "F(a & F b & F c)"},
    "coast": lambda: {
        "scene": {"file": str(EXAMPLES / "coast_survey" / "map.geojson"), "altitude": 300.0},
        "formula": {"formula": "F(shore & F islands) & F bay", "start_time": "2018-10-09T18:00:00Z"},
        "robot": "long_endurance",
    },
    "glider": lambda: {
        "scene": {"file": str(EXAMPLES / "glider_current" / "map.geojson"), "altitude": -30.0},
        "formula": "F(shelf & F edge) & F mooring",
        "wind": {
            "source": "csv", "path": str(EXAMPLES / "glider_current" / "current.csv"),
            "forecast_error": "none", "max_speed": 3.0, "noise_min": 0.05,
        },
        "robot": "underwater_glider",
    },
}  # fmt: skip


class Missions:
    """Missions by name, each planned once; ``small`` are settings for all of them."""

    def __init__(self, **small: Any) -> None:
        self._small = small
        self._made: dict[str, Run] = {}

    def __getitem__(self, name: str) -> Run:
        if name not in self._made:
            wanted = MISSIONS[name]() | self._small
            self._made[name] = pareto_ltl.plan(wanted.pop("scene"), wanted.pop("formula"), **wanted)
        return self._made[name]


def flown_map(missions: Missions, name: str) -> Drawing:
    """The plan of a mission on its map, with trees, wind and flights."""
    made = missions[name]
    return made.plot(deployments={"coherent": pareto_ltl.simulate(made, FLIGHTS)})


def strip_of_flights(missions: Missions) -> Drawing:
    """A hundred flights of phi2 at five moments."""
    made = missions["phi2"]
    flights = pareto_ltl.simulate(made, FLIGHTS)
    return flights.plot(scene=made.scene, plan=made.plan, frames=FRAMES, count=DRAWN)


@dataclass(frozen=True)
class Picture:
    """One picture of the gallery.

    Attributes
    ----------
    name : str
        Of its file, without suffix.
    title, text : str
        For the page; ``text`` is Markdown.
    draw : function
        From the missions to the drawing.
    """

    name: str
    title: str
    text: str
    draw: Callable[[Missions], Drawing]


PICTURES = (
    Picture(
        "plan", "A plan and its flights",
        "phi2: `a`, then `b` or `d`, then `c`, in the winds of 9 October 2018. Made by "
        "`pareto-ltl plan +experiment=phi2` or `result.plot()`; [probability](probability.md) explains the "
        "rates.",
        lambda missions: flown_map(missions, "phi2"),
    ),
    Picture(
        "front", "The front",
        "Failure rate and length of every path of the front: no other path is better in one of them without "
        "being worse in the other. Made by `result.front.plot(plan=result.plan)`; see [front](front.md).",
        lambda missions: missions["phi2"].front.plot(plan=missions["phi2"].plan),
    ),
    Picture(
        "wind", "A wind and its uncertainty",
        "Expected wind, and the standard deviation of one component: small at the readings, larger between "
        "them. Made by `result.wind.plot(scene=result.scene, time=\"13.5h\")`; see [wind](wind.md).",
        lambda missions: missions["phi2"].wind.plot(scene=missions["phi2"].scene, time="13.5h"),
    ),
    Picture(
        "automaton", "A mission as an automaton",
        "The automaton of the formula of phi2. Made by `result.automaton.plot()` or "
        "`pareto-ltl formula \"" + PHI2 + "\" --picture FILE.png`; see [missions](missions.md).",
        lambda missions: missions["phi2"].automaton.plot(),
    ),
    Picture(
        "timed", "Times",
        "A visit to `a` counts until 8 h after departure, a visit to `c` from 16 h on, and the region of a "
        "storm is forbidden from 3 to 12 h; see [missions](missions.md#times).",
        lambda missions: flown_map(missions, "timed"),
    ),
    Picture(
        "coast", "A map from GeoJSON",
        "A survey along a shore: regions with holes and with several parts, buffers, a geofence, and a "
        "landmark at which the aircraft measures its position; see "
        "[examples/coast_survey](../examples/coast_survey/README.md).",
        lambda missions: flown_map(missions, "coast"),
    ),
    Picture(
        "glider", "A glider in a current",
        "An underwater glider with a speed of 0.35 m/s in currents of up to the same speed; see "
        "[examples/glider_current](../examples/glider_current/README.md).",
        lambda missions: flown_map(missions, "glider"),
    ),
    Picture(
        "replanned", "Replanning during a flight",
        "phi2 after a position fix at 6 h: the rest of the old plan, and the new plan. Made by "
        "`pareto_ltl.replan(result, \"6h\", (38.7, -96.1, 5000.0)).plot()`; see [replanning](replanning.md).",
        lambda missions: pareto_ltl.replan(missions["phi2"], *FIX).plot(),
    ),
)  # fmt: skip
STRIP = Picture("flights_strip", "", "", strip_of_flights)  # of the README


def picture_bytes(drawing: Drawing, dpi: int = DPI) -> bytes:
    """A drawing as a PNG file of few colours."""
    from pareto_ltl_apps.view import style

    with style.report_style():
        content = style.figure_bytes(drawing.figure, "png", dpi)
    image = Image.open(io.BytesIO(content)).convert("RGB")
    few = image.quantize(COLOURS, method=Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
    packed = io.BytesIO()
    few.save(packed, "png", optimize=True)
    return packed.getvalue()


def page_text(pictures: Sequence[Picture], folder: str) -> str:
    """The page in Markdown; its images lie in ``folder``, seen from the page."""
    lines = [
        "# Gallery",
        "",
        "Figures of the package, of missions that are planned with the default settings. A run writes each "
        "figure as PNG and, with `report=print`, also as SVG and PDF. `make gallery` writes this page and "
        "its pictures again.",
        "",
    ]
    for picture in pictures:
        lines += [
            f"## {picture.title}",
            "",
            picture.text,
            "",
            f"![{picture.title}]({folder}/{picture.name}.png)",
            "",
        ]
    return "\n".join(lines)


def make_pictures(folder: Path, pictures: Sequence[Picture], missions: Missions) -> tuple[Path, ...]:
    """Draw ``pictures`` into ``folder``; return the files."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for picture in pictures:
        paths.append(folder / f"{picture.name}.png")
        write_bytes(paths[-1], picture_bytes(picture.draw(missions)))
        print(f"{paths[-1]}: {paths[-1].stat().st_size / 1e3:.0f} kB", flush=True)
    return tuple(paths)


def main() -> None:
    """Plan, fly, draw and write."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path, nargs="?", help="of the pictures; without it, the documentation")
    names = [picture.name for picture in (*PICTURES, STRIP)]
    parser.add_argument(
        "--only", choices=names, nargs="+", default=names, metavar="NAME", help=", ".join(names)
    )
    asked = parser.parse_args()
    missions = Missions()
    wanted = [picture for picture in PICTURES if picture.name in asked.only]
    make_pictures(asked.folder or IMAGES, wanted, missions)
    if STRIP.name in asked.only:
        make_pictures(asked.folder or IMAGES.parent, [STRIP], missions)
    if asked.folder is None:
        write_text(DOCS / "gallery.md", page_text(PICTURES, f"images/{IMAGES.name}"))


if __name__ == "__main__":
    main()
