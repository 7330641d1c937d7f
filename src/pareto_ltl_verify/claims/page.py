"""Claims about report.html: its texts, tables and numbers are functions of the records."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from html import unescape
from html.parser import HTMLParser
from typing import Any

import numpy as np

from careful_io.errors import DataError
from careful_io.fingerprints import SOURCES
from careful_io.reading import parse_json, read_text
from pareto_ltl_verify import page_texts
from pareto_ltl_verify.areas import area_fault
from pareto_ltl_verify.arrays import FloatArray, IntArray
from pareto_ltl_verify.claims import Claim, Verdict, far_apart, no_fault, same, unlike
from pareto_ltl_verify.claims.exports import PLAN
from pareto_ltl_verify.claims.origin import same_code
from pareto_ltl_verify.claims.outlines import map_areas
from pareto_ltl_verify.evidence import Evidence, all_trees
from pareto_ltl_verify.geometry import in_plane, on_earth
from pareto_ltl_verify.sentences import height_text

PAGE = "report.html"
OF_THIS_CODE = "page: texts that the records do not give, style and script"
DATA = re.compile(r'<script type="application/json" id="page-data">(.*?)</script>', re.DOTALL)
HEADLINE = re.compile(
    r'<div class="fact main"><dt>fails</dt><dd>(.*?)<small>(.*?)</small></dd></div>', re.DOTALL
)
TITLE = re.compile(r"<h1>(.*?)</h1>", re.DOTALL)
COLUMNS = (
    "failure", "failure_low", "failure_high", "length_m", "mission_risk", "collision_risk", "duration_s",
)  # fmt: skip
ROUNDED = 1e-3  # largest allowed error of a position in the page, as a share of the map's longer side
FINE = (
    0.5  # [m] largest allowed error of a corner, besides the rounding of the page to six digits of a degree
)
DEGREES = 0.2  # [m] of a place that is rounded to six digits of a degree
MAX_SHAPES = 20_000  # corners of all areas, of which the page leaves out some if there are more
INVISIBLE = ("script", "style")
PACKAGE = SOURCES / "pareto_ltl_apps" / "view"
WORLD, UNITS = PACKAGE / "geography" / "world.npz", 500  # of a degree, in which the table has its places
EDGE = 2e-3  # [deg] of a corner on the edge of what is shown
BOX_ROUNDING = 6e-4  # [deg] of the edges of what is shown, which have three digits
STYLES = ("components/components.css", "page/page.css")
SCRIPTS = (
    *(f"components/{name}.js" for name in (
        "shapes", "geo", "map", "ground", "wind", "flight", "branches", "front", "risk", "machine", "player"
    )),
    *(f"page/{name}.js" for name in ("basics", "layers", "files", "main")),
)  # fmt: skip
IMPORT = re.compile(r'^import \{[^}]*\} from "\./[a-z]+\.js";\n', re.MULTILINE)
EXPORT = re.compile(r"^export (?=(async )?(const|function|class) )", re.MULTILINE)
WORDS = frozenset(
    {
        "reach",
        "then",
        "and",
        "or",
        "in",
        "any",
        "order",
        "either",
        "if",
        "until",
        "is",
        "reached",
        "be",
        "outside",
        "stay",
        "out",
        "of",
        "a",
        "point",
        "from",
        "which",
        "to",
        "at",
        "the",
        "next",
        "later",
        "step",
        "exactly",
        "within",
        "between",
        "after",
        "departure",
        "h",
        "min",
        "s",
        "true",
        "false",
    }
)  # fmt: skip - of missions in words


# --- its numbers ----------------------------------------------------------------------------------


def page_data(result: Evidence) -> Any:
    """The JSON data that the script of the page reads; DataError unless there is exactly one set."""
    blocks = DATA.findall(read_text(result.directory / PAGE))
    if len(blocks) != 1:
        raise DataError(f"{PAGE}: has {len(blocks)} sets of numbers; one was expected")
    return parse_json(blocks[0].encode(), PAGE)


def points(result: Evidence) -> Verdict:
    """Each point of the scatter plot is a row of front.csv; without rates its failure is the bound."""
    stated, rows = page_data(result)["points"], result.front
    if len(stated) != len(rows):
        return same(f"{len(stated)} points", f"{len(rows)} points")
    faults = []
    for k, (point, row) in enumerate(zip(stated, rows, strict=True)):
        wanted = {name: float(row[name]) for name in COLUMNS if row[name]}
        if "failure" not in wanted:
            wanted["failure"] = min(1.0, wanted["mission_risk"] + wanted["collision_risk"])
        others = {name: None for name in COLUMNS if name not in wanted}
        law = {"law": row["law"] or result.planned_law, "runs": int(row["runs"]) if row["runs"] else None}
        texts = {"steps": int(row["steps"]), "order": row["order"], "origin": row["origin"]}
        wrong = unlike(point, others | law | {key: texts[key] for key in texts if key in point})
        faults += [f"point {k}: {fault}" for fault in [*wrong, *far_apart(point, wanted, 1e-9)]]
    return no_fault(f"{len(stated)} points", faults)


def paths(result: Evidence) -> Verdict:
    """The paths and the promise agree with front.npz and plan.json; the chosen one is the plan."""
    data, plan = page_data(result), result.plan
    promise, faults = data["promise"], list[str]()
    if data["chosen"] != page_texts.chosen_point(result):
        faults.append(f"chosen {data['chosen']}")
    for name, way in data["paths"].items():
        number = int(name)
        x, arrays = result.front_x(number), result.front_arrays
        wanted = {"q": np.asarray(arrays[f"path_{number:03d}/q"]).tolist(),
                  "fixes": np.asarray(arrays[f"path_{number:03d}/fixes"]).tolist()}  # fmt: skip
        faults += [f"path {name}: {fault}" for fault in unlike(way, wanted)]
        t = np.asarray(arrays[f"path_{number:03d}/t"], float)
        late = len(way["t"]) != len(t) or np.abs(np.array(way["t"], float) - t).max() > 1e-3
        off = _off(result, data, way["line"], x)
        faults += [f"path {name}: times"] * bool(late) + [f"path {name}: places"] * off
    faults += _tree_faults(result, data)
    if data["chosen"] is None and (result.plan.get("branches") or {}).get("bent") is not None:
        return no_fault(f"{len(data['paths'])} paths", faults, unlike(plan["promise"] or {}, promise or {}))
    way = data["paths"][str(data["chosen"])]
    same_times = {"automaton states": way["q"] != plan["q"], "times": way["utc"] != plan["time_utc"],
                  "positions": _off(result, data, way["line"], result.x)}  # fmt: skip
    same_times[f"promise {promise}"] = (promise is None) != (plan["promise"] is None)
    return no_fault(
        f"{len(data['paths'])} paths", faults, same_times, unlike(plan["promise"] or {}, promise or {})
    )


def _tree_faults(result: Evidence, data: Mapping[str, Any]) -> list[str]:
    """What the page draws of branches otherwise than the plan has them."""
    tree, shown = result.plan.get("branches"), data.get("tree")
    if tree is None or not shown:
        return ["branches"] * ((tree is None) != (not shown))
    rows = [(own, row) for own in all_trees(tree) for row in own["branches"]]
    by_name = {row["name"]: (own, row) for own, row in rows}
    if sorted(by_name) != sorted(one["name"] for one in shown["branches"]):
        return ["other branches"]
    faults = ["trunk"] * ((shown["trunk"] is None) != (tree["bent"] is None))
    if shown["trunk"] is not None:
        faults += ["trunk"] * _off(result, data, shown["trunk"], result.x)
    for one in shown["branches"]:
        own, row = by_name[one["name"]]
        faults += [f"branch {one['name']}: {fault}" for fault in unlike(one, {"where": row["where"]})]
        faults += [f"branch {one['name']}: share"] * (abs(one["share"] - row["share"]) > 1e-9)
        faults += [f"branch {one['name']}: places"] * _off(result, data, one["line"], np.array(row["x"]))
        there = np.array(own["fix"]["place"])[None]
        faults += [f"branch {one['name']}: fix"] * _off(result, data, [one["fix"]], there)
    return faults


def _off(result: Evidence, data: Mapping[str, Any], line: Any, x: Any) -> bool:
    """Whether a line of the page, in degrees for a map on the Earth, is not at the positions ``x`` [m]."""
    size = float(np.ptp(np.array(result.scene["bounds"], float), axis=0).max())
    drawn = np.array(line, float)
    drawn = in_plane(result.scene["crs"], drawn) if data["map"]["earthly"] else drawn
    return bool(drawn.shape != x.shape or np.abs(drawn - x).max() > ROUNDED * size)


def drawn_map(result: Evidence) -> Verdict:
    """The areas of the map: number, names and outlines; its start, border and time windows."""
    shown, areas, crs = page_data(result)["map"], map_areas(result), result.scene["crs"]
    wanted = [(area.role, area.title, corners) for area in areas for corners in area.outlines]
    shapes = shown["shapes"]
    named = [(shape["role"], shape["name"]) for shape in shapes]
    if named != [(role, title) for role, title, _ in wanted]:
        return no_fault(f"{len(shapes)} areas", [f"{len(wanted)} areas are expected"])
    faults = unlike(shown, {"walled": result.scene["border"] == "wall"})
    faults += ["start"] * _off(result, {"map": shown}, [shown["start"]], result.start[None])
    windows = [one["name"] for one in shown["windows"]]
    faults += [f"windows {windows}"] * (windows != list(result.scene.get("windows") or {}))
    size = float(np.ptp(np.array(result.scene["bounds"], float), axis=0).max())
    near = FINE + DEGREES if shown["earthly"] else FINE + 1e-5 * size
    whole = sum(len(corners) for _, _, corners in wanted) <= MAX_SHAPES
    for shape, (_, title, corners) in zip(shapes, wanted, strict=True) if whole else ():
        ring = np.array(shape["ring"], float)
        ring = in_plane(crs, ring) if shown["earthly"] else ring
        fault = area_fault([ring[:-1]], [corners], near)
        faults += [f"{title}: {fault}"] * bool(fault)
    return no_fault(f"{len(shapes)} areas", faults)


def geography(result: Evidence) -> Verdict | None:
    """Coasts, lakes, borders and cities of the page come from the table of this package.

    Outlines are simplified and cut by a box, which is three times as wide and high as the map: each corner is
    one of the table, or lies where a line of the table crosses the box, or is a corner of the box, or lies on
    180 degrees. None for a page without them.
    """
    shown = page_data(result).get("geography")
    if shown is None:
        return None
    box, number = np.array(shown["box"], float), 0
    far = np.abs(box - _box(result)).max()
    faults = [f"box {shown['box']}"] * bool(far > BOX_ROUNDING + 1e-2 * np.ptp(box[::2]))
    with np.load(WORLD) as table:
        names = table["city_names"].tobytes().decode().split("\n")
        lon, lat = table["city_places"] / UNITS
        lon = box[0] + (lon - box[0]) % 360.0
        inside = np.flatnonzero((lon <= box[2]) & (lat >= box[1]) & (lat <= box[3]))[: len(shown["cities"])]
        wanted = [[names[k], lon[k], lat[k]] for k in inside]
        faults += ["cities"] * (len(wanted) != len(shown["cities"]))
        for (name, *there), (other, *here) in zip(wanted, shown["cities"], strict=False):
            moved = name != other or float(np.abs(np.subtract(there, here)).max()) > 1e-3
            faults += [f"city {other}"] * moved
        for layer in ("land", "lakes", "islands", "borders", "states"):
            known, crossed = _known_corners(table, layer, box)
            for line in shown[layer]:
                number += len(line)
                xy = np.array(line, float)
                strange = [one for one in xy if tuple(_units(one[None])[0]) not in known]
                ends = [one for one in strange if np.abs(one[0] % 360.0 - 180.0) > EDGE]
                off = [one for one in ends if np.abs(crossed - one).max(axis=1).min() > EDGE]
                faults += [f"{layer} at {x:g}, {y:g}" for x, y in off]
    return no_fault(f"{number} corners and {len(shown['cities'])} cities", faults)


def _box(result: Evidence) -> FloatArray:
    """The map of a result and as much again on each side: west, south, east, north [deg]."""
    low, high = np.array(result.scene["bounds"], float)
    sides = [np.linspace(low[i], high[i], 9) for i in (0, 1)]
    grid = np.stack(np.meshgrid(*sides), axis=-1).reshape(-1, 2)
    lon, lat = on_earth(result.scene["crs"], np.vstack([(low + high)[None] / 2, grid]))
    lon = lon[0] + (lon - lon[0] + 180.0) % 360.0 - 180.0
    reach = min(np.ptp(lon), (360.0 - np.ptp(lon)) / 2)
    south, north = lat.min() - np.ptp(lat), lat.max() + np.ptp(lat)
    return np.array([lon.min() - reach, max(south, -89.0), lon.max() + reach, min(north, 89.0)])


def _known_corners(table: Any, layer: str, box: FloatArray) -> tuple[set[tuple[int, int]], FloatArray]:
    """Places of a layer, and places (n, 2) [deg] where it crosses the edges of a box, with its corners."""
    places, ends = _table_places(table, layer)
    a, b = np.delete(places, ends, axis=0), np.delete(places, np.append(0, ends[:-1] + 1), axis=0)
    found = [np.array([[x, y] for x in box[::2] for y in box[1::2]])]
    for axis, edge in ((0, box[0]), (0, box[2]), (1, box[1]), (1, box[3])):
        for turn in (-360.0, 0.0, 360.0) if axis == 0 else (0.0,):
            at = edge - turn
            across = (a[:, axis] - at) * (b[:, axis] - at) <= 0.0
            across &= a[:, axis] != b[:, axis]
            share = (at - a[across, axis]) / (b[across, axis] - a[across, axis])
            crossing = a[across] + share[:, None] * (b[across] - a[across])
            shifts = (turn,) if axis == 0 else (-360.0, 0.0, 360.0)
            found += [crossing + np.array([shift, 0.0]) for shift in shifts]
    return {tuple(place) for place in _units(places).tolist()}, np.concatenate(found)


def _units(places: Any) -> Any:
    """Places (n, 2) [deg] as whole units of the table, without turns round the Earth."""
    lon, lat = np.round(np.asarray(places, float) * UNITS).T.astype(int)
    return np.column_stack([(lon + 180 * UNITS) % (360 * UNITS), lat])


def _table_places(table: Any, layer: str) -> tuple[FloatArray, IntArray]:
    """All places (n, 2) [deg] of a layer, and the numbers of the last places of its lines.

    Each line has a length, a first place and the steps after it.
    """
    lower, upper = table[f"{layer}_steps"].astype(int)
    steps = lower + 256 * upper - 65536 * (upper >= 128)
    lines, at = [], 0
    for size, *first in table[f"{layer}_begins"].tolist():
        lines.append(np.array(first) + np.cumsum(steps[:, at : at + size].T, axis=0))
        at += size
    return np.concatenate(lines) / UNITS, np.cumsum(table[f"{layer}_begins"][:, 0]) - 1


def other_data(result: Evidence) -> Verdict:
    """Names, law, departure, tight places, uncovered errors and the flights that the page draws."""
    data, plan, zero = page_data(result), result.plan, result.scene["time_zero"]
    medium = page_texts.medium_of(result)._asdict()
    wanted: dict[str, Any] = {
        "name": result.settings["name"], "formula": result.automaton["formula"], "law": result.planned_law,
        "notCovered": plan.get("not_covered", ""), "medium": medium,
        "onEarth": result.scene["crs"] is not None, "judge": str(result.settings["fidelity"]["judge"]),
        "places": page_texts.tight_places(result) if not page_texts.alarmed(result) else data.get("places"),
    }  # fmt: skip
    if (height := plan.get("height")) is not None:
        ofsea = height["above_sea"] or height["metres"] < 0.0
        about = {"metres": height["metres"], "aboveSea": height["above_sea"], "ofSea": ofsea}
        wanted["height"] = about | {"sentence": height_text(result)}
    if zero is not None and plan["time_utc"] is not None:
        wanted["timeZero"] = plan["time_utc"][0]
    faults = unlike(data, {key: value for key, value in wanted.items() if key in data})
    faults += [f"{key} is missing" for key in wanted if key not in data]
    flights, stored = data.get("flights"), result.flights if result.has("deployments.npz") else {}
    law = result.planned_law
    if flights is not None and f"{law}/x" in stored:
        rate = page_texts.deployed(result, law)
        counted = {"law": law, "runs": rate["runs"], "failures": round(rate["failure"] * rate["runs"])}
        faults += [f"flights: {fault}" for fault in unlike(flights, counted)]
        drawn = np.array(flights["at"], float)
        x = np.asarray(stored[f"{law}/x"], float)[: len(drawn)]
        if drawn.shape != x.shape or _off(result, data, drawn.reshape(-1, 2), x.reshape(-1, 2)):
            faults.append("places of flights")
        failed = np.array(flights["failed"]) >= 0
        known = np.asarray(result.ground.failed(x), bool)
        faults += ["which flights fail"] * bool((failed != known).any())
    return no_fault(f"{len(data)} entries", faults)


# --- its texts ------------------------------------------------------------------------------------


def headline(result: Evidence) -> Verdict | None:
    """The rate in large letters is the promise of plan.json, with its interval and its winds."""
    matches = HEADLINE.findall(read_text(result.directory / PAGE))
    if result.plan["promise"] is None:
        return None
    value, note = page_texts.headline(result)
    if len(matches) != 1:
        return Verdict(f"{len(matches)} rates", f"{value}, {note}", False)
    rate, stated = map(unescape, matches[0])
    holds = rate == value and stated.startswith(note)
    return Verdict(f"{rate}, {stated}", f"{value}, {note}", holds)


class Texts(HTMLParser):
    """The visible texts of a page, one for each piece between two tags."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.found: list[str] = []
        self.hidden = ""
        self.feed(page)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:  # noqa: ARG002 - HTMLParser's
        """Remember an element whose text is not seen."""
        self.hidden = tag if tag in INVISIBLE else self.hidden

    def handle_endtag(self, tag: str) -> None:
        """Forget it at its end."""
        self.hidden = "" if tag == self.hidden else self.hidden

    def handle_data(self, data: str) -> None:
        """Collect a text without repeated spaces."""
        if text := " ".join(data.split()):
            self.found += [] if self.hidden else [text]


def title_of(result: Evidence) -> str:
    """The title of the page: the mission in words, or its formula."""
    return unescape("".join(TITLE.findall(read_text(result.directory / PAGE))[:1]))


def whole_page(result: Evidence) -> Verdict:
    """Every text is derived from the records or stands on every page; style and script are unchanged.

    The template of this installation says which texts stand on every page. Pages of other versions of the
    code may have other ones: there, every derived text must be on the page.
    """
    page, texts = read_text(result.directory / PAGE), page_texts.page_texts(result, title_of(result))
    faults = [f"{word!r} in the title" for word in _strange_words(result, texts["title"])]
    derived = [text for text in _strings(texts) if " ".join(text.split())]
    seen = Texts(page).found
    joined = "\n".join([" ".join(seen), *seen])
    lacking = [text for text in derived if " ".join(text.split()) not in joined]
    if not same_code(result) or page_texts.foreign_costs(result):
        return no_fault(f"{len(derived)} texts", faults, (f"{text!r} is missing" for text in lacking))
    wanted = _rendered(texts, DATA.findall(page)[0])
    faults += [f"{text!r} is not derived" for text in strange_texts(seen, Texts(wanted).found)]
    faults += [f"{text!r} is missing" for text in strange_texts(Texts(wanted).found, seen)]
    return no_fault(f"{len(seen)} texts", faults, {"another style, script or element": page != wanted})


def strange_texts(some: Iterable[str], others: Iterable[str]) -> list[str]:
    """The texts of ``some`` that ``others`` does not have, or not as often."""
    left = list(others)
    found = []
    for text in some:
        if text in left:
            left.remove(text)
        else:
            found.append(text)
    return found


def _strange_words(result: Evidence, title: str) -> list[str]:
    """The words of the title that are neither words of missions, nor numbers, nor names of the map."""
    if title == result.automaton["formula"] or title == result.settings["name"]:
        return []
    left = title.replace("“", " ").replace("”", " ")
    for name in sorted((*result.dfa.atoms, *result.scene["regions"]), key=len, reverse=True):
        left = re.sub(rf"(?<!\w){re.escape(name)}(?!\w)", " ", left, flags=re.IGNORECASE)
    words = re.findall(r"[^\W\d][\w'-]*", left)
    return [word for word in words if not {word, word.lower()} & WORDS]


def _strings(nested: Any) -> list[str]:
    """All texts of the sections that follow from the records: facts, rates, limits, errors, origin."""
    keys = ("facts", "verdicts", "covered", "not_covered", "origin")
    rows = [nested[key] for key in keys]
    limits = nested["limits"]
    if limits is not None:
        rows += [limits[key] for key in ("prices", "segments", "breach")]
        rows += [[one["change"], one["worst"], one["fails"]] for one in limits["remedies"]]
    return [text for row in rows for text in _leaves(row)]


def _leaves(nested: Any) -> list[str]:
    if isinstance(nested, Mapping):
        return [text for value in nested.values() for text in _leaves(value)]
    if isinstance(nested, list | tuple):
        return [text for value in nested for text in _leaves(value)]
    return [nested]


def _rendered(texts: Mapping[str, Any], data: str) -> str:
    """The page that the template makes of ``texts`` and of the ``data`` of its script."""
    from jinja2 import Environment, StrictUndefined
    from markupsafe import Markup

    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    parts = (EXPORT.sub("", IMPORT.sub("", read_text(PACKAGE / name))) for name in SCRIPTS)
    style = "".join(read_text(PACKAGE / name) for name in STYLES)
    shown = {"style": Markup(style), "script": Markup('"use strict";\n' + "\n".join(parts)), "data": data}
    return environment.from_string(read_text(PACKAGE / "page" / "page.html")).render(**texts, **shown)


FILES = (PAGE, *PLAN, "wind.nc", "cells.json", "automaton.json")
CLAIMS: tuple[Claim, ...] = (
    Claim("page: points of the front", (PAGE, "front.csv", "plan.json"), points),
    Claim("page: paths and promise", (*FILES, "front.csv", "front.npz"), paths),
    Claim("page: map", (PAGE, *PLAN), drawn_map),
    Claim("page: coasts and cities", FILES, geography),
    Claim("page: other numbers", FILES, other_data),
    Claim("page: rate in the headline", (PAGE, "plan.json"), headline),
    Claim("page: all texts", FILES, whole_page),
)
