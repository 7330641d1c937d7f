"""Claims about the map, its cells and the automaton."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from careful_io.projections import refuse_files
from pareto_ltl_verify import formula
from pareto_ltl_verify.arrays import BoolArray, FloatArray
from pareto_ltl_verify.claims import Claim, Verdict, close, no_fault, same, true_of
from pareto_ltl_verify.evidence import Evidence
from pareto_ltl_verify.geometry import Convex, convex, deepest, outline_distance, signed_area, within
from pareto_ltl_verify.laws import fix_error

SAMPLES = 20_000  # points of the map at which cells, parts and polygons are compared
RELATIVE = 1e-9  # largest allowed relative difference of two coordinates
SIMPLIFIED = 0.002  # of the longer side of the map: how far outlines may move with scene.simplify=auto
OF_THE_SETTINGS = ("map: border", "map: projection", "map: scene.json is the map of the settings")


# --- the map ----------------------------------------------------------------------------------


def given_map(result: Evidence) -> bool:
    """Whether the map was given in Python, as a Scene: the settings then have none."""
    settings = result.settings["scene"]
    return not (settings["file"] or settings["bounds"] or settings["start"])


def _not_set(result: Evidence) -> bool:
    """Whether the map is in a file or was given in Python, and not in the settings."""
    return bool(result.settings["scene"]["file"]) or given_map(result)


def drawn_map(result: Evidence) -> Verdict | None:
    """scene.json is the map of the settings: bounds, start, regions, obstacles and landmarks.

    On a map with random places only the places that the settings name are compared, and the number of others.
    """
    settings, scene = result.settings["scene"], result.scene
    if _not_set(result):
        return None
    bounds, start = _metres(settings, settings["bounds"]), _metres(settings, [settings["start"]])
    moved, others = scene.get("simplified", 0.0), set(scene["regions"]) - set(settings["regions"])
    faults = {
        "bounds differs": not _same_outline(bounds, scene["bounds"]),
        "start differs": not _same_outline(start, [scene["start"]]),
        f"outlines moved by {moved:g} m": moved > _allowed(settings, scene) * (1 + RELATIVE),
        f"regions {sorted(others)} are not in the settings": len(others) != settings["random"]["regions"],
    }
    for name, corners in settings["regions"].items():
        drawn = [_outline(settings, part) for part in _parts(corners)]
        written = _parts(scene["regions"].get(name, []))
        faults[f"region {name} differs"] = not _same_region(result, name, drawn, written)
    areas = (_area_faults(result, kind) for kind in ("obstacles", "landmarks"))
    return no_fault("the outlines of the settings", faults, *areas, _fix_faults(result))


def border(result: Evidence) -> Verdict | None:
    """The border is scene.border, or with auto the border of the fidelity."""
    stated = result.settings["scene"]["border"]
    if stated == "auto" and _not_set(result):  # the map may name one
        return None
    return same(result.scene["border"], result.settings["fidelity"]["border"] if stated == "auto" else stated)


def projection(result: Evidence) -> Verdict | None:
    """The plane of the map touches the Earth at the centre that the settings name."""
    from pyproj import CRS

    centre, crs = result.settings["scene"]["centre"], result.scene["crs"]
    if _not_set(result):
        return None
    if crs is None or centre is None:
        return same(crs, centre)
    refuse_files(crs)
    plane = CRS.from_user_input(crs).coordinate_operation
    params = plane.params if plane else ()
    lat, lon = (next((p.value for p in params if p.name.startswith(w)), math.nan) for w in ("Lat", "Long"))
    turn = (lon - centre[1] + 180) % 360 - 180
    return Verdict(str(centre), f"[{lat}, {lon}]", abs(lat - centre[0]) + abs(turn) < 1e-6)


def departure(result: Evidence) -> Verdict:
    """The clock of the map begins at mission.start_time, if it is set; the clock of the wind is the same."""
    start_time, zero = result.settings["mission"]["start_time"], result.scene["time_zero"]
    units = "s" if zero is None else f"seconds since {zero}"
    if start_time is not None and start_time != zero:
        return same(start_time, zero)
    return same(result.wind.clock if result.has("wind.nc") else units, units)


def _metres(settings: Mapping[str, Any], corners: Any) -> FloatArray:
    """Coordinates of the settings in the plane of the map."""
    middle = np.mean(settings["bounds"], axis=0) if settings["centre"] else np.zeros(2)
    return np.asarray((np.array(corners, float) - middle) * settings["unit"], float)


def _outline(settings: Mapping[str, Any], corners: Any) -> FloatArray:
    """The outline without corners that repeat the one before."""
    points = _metres(settings, corners)
    return points[np.any(points != np.roll(points, 1, axis=0), axis=1)]


def _parts(listed: Any) -> list[FloatArray]:
    """The outlines of a region as a list; a single outline is written as its corners."""
    several = bool(listed) and isinstance(listed[0][0], list | tuple)
    return [np.array(part, float) for part in (listed if several else [listed] if listed else [])]


def _allowed(settings: Mapping[str, Any], scene: Mapping[str, Any]) -> float:
    """How far the settings let outlines move [m]."""
    limit = settings.get("simplify", 0.0)
    side = float(np.ptp(np.array(scene["bounds"], float), axis=0).max())
    return SIMPLIFIED * side if isinstance(limit, str) else float(limit)


def _only_avoided(result: Evidence, name: str) -> bool:
    """Whether a region occurs in the normal form of the formula, and nowhere without a negation."""
    nodes, signs = list[formula.Node](), set[str]()
    if not result.settings["mission"]["automaton"]:
        nodes.append(_meaning(str(result.automaton["formula"])))
    while nodes:
        operator, *args = nodes.pop()
        if operator in ("ap", "not"):
            signs |= {operator} if args == [name] else set()
        else:
            nodes += args
    return "ap" not in signs


def _same_region(result: Evidence, name: str, drawn: list[FloatArray], written: list[FloatArray]) -> bool:
    """Whether two lists of outlines are one area.

    On a simplified map it may be slightly smaller, or slightly larger if the mission only avoids it.
    """
    if not result.scene.get("simplified", 0.0) and len(drawn) == len(written) == 1:
        return _same_outline(drawn[0], written[0])
    return _same_area(result, drawn, written, drawn, _only_avoided(result, name))


def _same_area(
    result: Evidence, drawn: list[FloatArray], written: list[FloatArray], edges: list[FloatArray], grows: bool
) -> bool:
    """Whether two lists of outlines cover the same sample points of the map.

    Points near the outlines ``edges`` may differ by as much as the map is simplified, if the area only
    ``grows``, or else only becomes smaller.
    """
    points, moved = _sample_points(result), float(result.scene.get("simplified", 0.0))
    before, after, edge = _covered(drawn, points), _covered(written, points), _edge_distance(edges, points)
    careless = before & ~after if grows else after & ~before
    wrong = (before != after) & (edge > moved + result.grain) | careless & (edge > result.grain)
    return not wrong.any()


def _edge_distance(polygons: list[FloatArray], points: FloatArray) -> FloatArray:
    """Distance of each point to the nearest outline [m]."""
    none = np.full(len(points), np.inf)
    least: FloatArray = np.min([none, *(outline_distance(one, points) for one in polygons)], axis=0)
    return least


def _corners(drawn: Any) -> Any:
    """The corners of an area of the settings; landmarks may be mappings with corners and fix."""
    return drawn["corners"] if isinstance(drawn, Mapping) else drawn


def _fix_faults(result: Evidence) -> list[str]:
    """Landmarks whose outline agrees with the settings, and whose errors of fixes do not.

    The bearing is compared where the settings have one.
    """
    settings, scene, usual = result.settings["scene"], result.scene, result.settings["robot"]["fix_sd"]
    marks = scene.get("landmarks") or []
    fixes = scene.get("landmark_fixes") or [None] * len(marks)
    faults = ["landmark_fixes"] * (len(fixes) != len(marks))
    for number, drawn in enumerate(settings["landmarks"]):
        outline = _outline(settings, _corners(drawn))
        here = next((f for one, f in zip(marks, fixes, strict=False) if _same_outline(outline, one)), None)
        requested = drawn.get("fix") if isinstance(drawn, Mapping) else None
        if requested and not here and any(_same_outline(outline, one) for one in marks):
            faults.append(f"fix of landmark {number + 1} is missing")
        if not here:
            continue
        wanted = fix_error({"bearing": here.get("bearing", 0.0)} | dict(requested or {"sd": usual}), usual)
        if not np.allclose(wanted, fix_error(here, usual), rtol=1e-6):
            faults.append(f"fix of landmark {number + 1}")
    return faults


def _area_faults(result: Evidence, kind: str) -> Iterator[str]:
    """Obstacles or landmarks of the settings that are not in the map, and others in it.

    Outlines within the bounds are unchanged; those beyond are cut, those with many corners simplified,
    landmarks that are not convex cut up: these are compared at sample points.
    """
    settings, bounds = result.settings["scene"], np.array(result.scene["bounds"])
    low, high = bounds + np.array([[-result.grain], [result.grain]])
    written, rest = [np.array(corners) for corners in result.scene.get(kind) or []], []
    for number, one in enumerate(_outline(settings, _corners(area)) for area in settings[kind]):
        place = next((i for i, other in enumerate(written) if _same_outline(one, other)), None)
        unchanged = ((one >= low) & (one <= high)).all() and not result.scene.get("simplified")
        if place is not None:
            written.pop(place)
        elif unchanged and (kind == "obstacles" or _is_convex(one)):
            yield f"{kind} {number} differs"
        else:
            rest.append(one)
    if kind == "obstacles" and (drawn := settings["random"]["obstacles"]):
        if not rest and len(written) != drawn:
            yield f"{len(written)} obstacles that are not in the settings, and {drawn} at random places"
        return
    if not _same_area(result, rest, written, [*rest, *written], kind == "obstacles"):
        yield f"{kind} that are not in the settings"


def _is_convex(outline: FloatArray) -> bool:
    """Whether all corners turn the same way."""
    along = np.roll(outline, -1, axis=0) - outline
    after = np.roll(along, -1, axis=0)
    turns = along[:, 0] * after[:, 1] - along[:, 1] * after[:, 0]
    return bool((turns >= 0).all() or (turns <= 0).all())


def _covered(polygons: list[FloatArray], points: FloatArray) -> BoolArray:
    """Which points lie in any of the polygons."""
    nowhere = np.zeros(len(points), bool)
    return np.asarray(np.any([nowhere, *(within(polygon, points) for polygon in polygons)], axis=0), bool)


def _same_outline(one: FloatArray, other: Any) -> bool:
    """Whether two outlines have the same corners, whatever the first one and the direction."""
    written = np.array(other, float).reshape(-1, 2)
    tolerance = RELATIVE * max(float(np.abs(one).max()), 1.0)
    if len(written) != len(one):
        return False
    turns = (np.roll(way, k, axis=0) for way in (written, written[::-1]) for k in range(len(written)))
    return any(np.abs(one - turn).max() <= tolerance for turn in turns)


# --- its cells --------------------------------------------------------------------------------


def convex_parts(result: Evidence) -> Verdict:
    """The convex parts in cells.json cover exactly the polygons of scene.json."""
    scene, points = result.scene, _sample_points(result)
    groups = {name: (_parts(scene["regions"][name]), parts) for name, parts in result.regions.items()}
    outlines = [np.array(polygon) for polygon in scene["obstacles"]]
    groups["obstacles"] = (_outermost(outlines, result.grain), result.obstacles)
    faults = {f"region {name} is missing": name not in groups for name in scene["regions"]}
    for name, (polygons, parts) in groups.items():
        area = sum(abs(signed_area(polygon)) for polygon in polygons)
        computed = sum(signed_area(part.corners) for part in parts)
        apart = (deepest(parts, points) >= 0) != _covered(polygons, points)
        apart &= _edge_distance(polygons, points) > result.grain
        faults[f"{name}: area {computed:.6g} of {area:.6g} m2"] = not close(computed, area, 1e-7)
        faults[f"{name}: parts and polygon lie apart"] = apart.any()
    return no_fault(f"parts of {len(groups) - 1} regions and {len(outlines)} obstacles", faults)


def _outermost(polygons: list[FloatArray], grain: float) -> list[FloatArray]:
    """The polygons with a corner or middle of an edge outside each larger one."""

    def lies_in(own: FloatArray, other: FloatArray) -> bool:
        probes = np.concatenate([own, 0.5 * (own + np.roll(own, -1, axis=0))])
        inside = within(other, probes) | (outline_distance(other, probes) < grain)
        return bool(inside.all()) and abs(signed_area(other)) > abs(signed_area(own))

    return [own for own in polygons if not any(lies_in(own, other) for other in polygons if other is not own)]


def _sample_points(result: Evidence) -> FloatArray:
    low, high = np.array(result.scene["bounds"])
    drawn: FloatArray = low + (high - low) * np.random.default_rng(2).random((SAMPLES, 2))
    return drawn


def cell_cover(result: Evidence) -> Verdict:
    """Every point of the map lies in an obstacle or in exactly one cell, which has the label of the point."""
    points = _sample_points(result)
    cells = [convex(cell) for cell in result.cells["cells"]]
    depth = np.array([cell.depth(points) for cell in cells])
    inside = deepest(result.obstacles, points)
    clear = (np.abs(depth) > result.grain).all(axis=0) & (np.abs(inside) > result.grain)
    count = (depth > 0).sum(axis=0)
    wrong = clear & (count != (inside < 0))
    shown, labels = list(map(frozenset, result.cells["labels"])), result.ground.labels(points)
    own = depth.argmax(axis=0)
    return no_fault(
        f"{len(cells)} cells, {int(clear.sum())} places",
        (f"{points[i].round()} m lies in {count[i]} cells" for i in np.flatnonzero(wrong)),
        (
            f"{points[i].round()} m is {sorted(labels[i])}, its cell is not"
            for i in np.flatnonzero(clear & ~wrong & (inside < 0))
            if shown[own[i]] != labels[i]
        ),
    )


def doors(result: Evidence) -> Verdict:
    """Two cells have a door if and only if they share a piece of an edge."""
    cells = [convex(cell) for cell in result.cells["cells"]]
    stated = {(int(i), int(j)) for i, j in result.cells["doors"]}
    computed = {pair: length for pair, length in _contacts(cells, result.grain) if pair[0] < pair[1]}
    wide = {pair for pair, length in computed.items() if length > result.grain}
    return no_fault(
        f"{len(stated)} doors",
        (f"cells {i} and {j} share no edge" for i, j in sorted(stated - set(computed))),
        (f"cells {i} and {j} have no door" for i, j in sorted(wide - stated)),
    )


def _contacts(cells: Sequence[Convex], grain: float) -> Iterator[tuple[tuple[int, int], float]]:
    """Pairs of cells with edges on one line that face each other, and the length they share [m]."""
    owner = np.concatenate([np.full(len(cell.offsets), i) for i, cell in enumerate(cells)])
    first = np.concatenate([cell.corners for cell in cells])
    last = np.concatenate([np.roll(cell.corners, -1, axis=0) for cell in cells])
    normals = np.concatenate([cell.normals for cell in cells])
    offsets = np.concatenate([cell.offsets for cell in cells])
    for e in range(len(owner)):
        along = np.array([-normals[e, 1], normals[e, 0]])
        facing = (normals @ normals[e] < -1 + 1e-9) & (np.abs(offsets + offsets[e]) < grain)
        for other in np.flatnonzero(facing & (owner != owner[e])):
            start = max(first[e] @ along, last[other] @ along)
            length = float(min(last[e] @ along, first[other] @ along) - start)
            if length > 0:
                yield (int(owner[e]), int(owner[other])), length


# --- the mission ------------------------------------------------------------------------------


def letters(result: Evidence) -> Verdict:
    """The automaton reads every label that the map can show, and the empty one.

    With time windows it reads at least the letters at each step, and between steps, of the longest flight.
    """
    labels = [*map(frozenset, result.cells["labels"]), frozenset[str]()]
    table, ground, steps = result.timetable, result.ground, int(result.settings["planner"]["max_steps"])
    spans = {of(t) for t in range(steps + 1 if table.windows else 1) for of in (table.now, table.way)}
    shown = {ground.letter(label, holding) for label in labels for holding in spans}
    stated = set(map(frozenset, result.automaton["letters"]))
    stated = stated & shown if table.windows else stated
    return same(sorted(map(sorted, stated)), sorted(map(sorted, shown)))


def windows(result: Evidence) -> Verdict | None:
    """The automaton's time windows come from the map, and its clocks have the times in their names.

    The propositions that the map forbids are forbidden in the automaton too.
    """
    files, settings = (result.automaton, result.scene), result.settings["scene"]
    stated, drawn = (formula.windows_of(content.get("windows")) for content in files)
    forbidden, forbids = (set(content.get("forbidden", ())) for content in files)
    if not stated and not drawn:
        return None
    timed = [name for name in result.dfa.atoms if name in drawn or formula.clock_of(name) is not None]
    other = settings["file"] is None and set(settings.get("windows", {})) != set(drawn)
    return no_fault(
        f"{len(stated)} windows",
        (name for name, span in stated.items() if span != drawn.get(name, formula.clock_of(name))),
        (f"{name} has no window" for name in timed if name not in stated),
        sorted(forbidden ^ forbids),
        {"the settings have other windows": other},
    )


def whose_formula(result: Evidence) -> Verdict:
    """Settings, automaton and plan name the same formula."""
    settings = result.settings["mission"]
    names = {"automaton.json": result.automaton["formula"]}
    if result.has("plan.json"):
        names["plan.json"] = result.plan["formula"]
        if list(result.plan["atoms"]) != list(result.automaton["atoms"]):
            return Verdict("one list of atoms", "plan.json and automaton.json differ", False)
    if settings["formula"] and not settings["automaton"]:
        names["the settings"] = settings["formula"]
    meant = {_meaning(text) for text in names.values()} if not settings["automaton"] else set(names.values())
    return Verdict(str(result.automaton["formula"])[:44], " and ".join(names), len(meant) == 1)


def _meaning(text: str) -> formula.Node:
    return formula.normal_form(formula.read_formula(text))


def meaning(result: Evidence) -> Verdict | None:
    """The automaton accepts exactly the words that complete the formula."""
    if result.settings["mission"]["automaton"]:
        return None  # the mission is an automaton's file; its text is not a formula
    text = result.automaton["formula"]
    word = formula.first_difference(result.dfa, text, result.automaton.get("forbidden", ()))
    return Verdict(text[:44], "the same words" if word is None else f"differ on {word}"[:44], word is None)


def hoa(result: Evidence) -> Verdict:
    """automaton.hoa and automaton.json hold equivalent automata."""
    text, dfa = (result.directory / "automaton.hoa").read_text(encoding="utf-8"), result.dfa
    other = formula.read_hoa(text, dfa.letters)
    word = formula.unlike(dfa, other)
    alike = (other.initial, other.delta, set(other.atoms)) == (dfa.initial, dfa.delta, set(dfa.atoms))
    plain = re.sub(r"\\(.)", r"\1", text)
    faults = true_of({
        "names another formula": f'name: "{result.automaton["formula"]}"' not in plain,
        f"differs on {word}": word is not None,
        "other states": not alike,
    })  # fmt: skip
    return Verdict("automaton.hoa", faults[0] if faults else "the same", not faults)


def distance(result: Evidence) -> Verdict:
    """d_A is the fewest letters to acceptance."""
    stated = [math.inf if d is None else float(d) for d in result.automaton["d_A"]]
    return same(stated, formula.distances(result.dfa).tolist())


CLAIMS: tuple[Claim, ...] = (
    Claim("map: scene.json is the map of the settings", ("scene.json",), drawn_map),
    Claim("map: border", ("scene.json",), border),
    Claim("map: projection", ("scene.json",), projection),
    Claim("map: departure", ("scene.json",), departure),
    Claim("map: convex parts are the polygons", ("scene.json", "cells.json"), convex_parts),
    Claim("map: cells cover the free space once", ("scene.json", "cells.json"), cell_cover),
    Claim("map: doors join all cells that touch", ("cells.json", "scene.json"), doors),
    Claim("mission: one formula in all files", ("automaton.json",), whose_formula),
    Claim("mission: automaton follows from the formula", ("automaton.json",), meaning),
    Claim("mission: automaton.hoa is automaton.json", ("automaton.json", "automaton.hoa"), hoa),
    Claim("mission: letters are the labels of the map", ("automaton.json", "cells.json"), letters),
    Claim("mission: time windows come from the map", ("automaton.json", "scene.json"), windows),
    Claim("mission: distance to acceptance", ("automaton.json",), distance),
)
