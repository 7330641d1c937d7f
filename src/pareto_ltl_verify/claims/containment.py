"""Claims of ``pareto-ltl contain``: volumes, their size, and how often flights leave them and the border."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from itertools import pairwise
from typing import Any
from xml.etree import ElementTree

import numpy as np
from scipy.stats import binom

from careful_io.fingerprints import file_fingerprint
from pareto_ltl_verify.areas import drawn_fault, rings_of, segment_distance
from pareto_ltl_verify.arrays import BoolArray, FloatArray
from pareto_ltl_verify.claims import Claim, Verdict, close, far_apart, likely, no_fault
from pareto_ltl_verify.claims.exports import xml_root
from pareto_ltl_verify.claims.flights import MAX_FLIGHTS, SEEN
from pareto_ltl_verify.claims.outlines import SAG
from pareto_ltl_verify.evidence import Evidence
from pareto_ltl_verify.flights import RARE
from pareto_ltl_verify.geometry import in_plane, signed_area

FILE = "containment/containment.json"
GEOJSON, KML = "containment/volumes.geojson", "containment/volumes.kml"
RUNS, SEED = 20_000, 20181013  # new flights of a batch
BETWEEN = 8  # places on each step of a new flight that are looked at, where an area is not convex
EDGE = 1e-3  # [m] a position this close to an edge is inside
HOUR = 3600.0
WORDS = ("compl" + "iant", "certif" + "ied")  # a simulation is neither


Leaves = Callable[[FloatArray], BoolArray]  # which of the flights leave an area


def _flown(result: Evidence, batch: int = 0) -> FloatArray:
    """A batch of new flights (n, T+1, 2) [m] of the plan; several claims share the first."""
    if batch:
        return result.fly(result.planned_law, result.x, result.u, RUNS, SEED, batch)
    made = result.remembered.get(FILE)
    if made is None:
        made = result.fly(result.planned_law, result.x, result.u, RUNS, SEED)
        result.remembered[FILE] = made
    assert isinstance(made, np.ndarray)
    return made


def record(result: Evidence) -> Verdict:
    """Plan, law, duration, the floor of the law and rates per flight hour follow from the other files."""
    stated, hours = result.document(FILE), len(result.u) * result.robot.dt / HOUR
    error = result.wind.error
    floor = 0.0 if error is None else error.floor or 0.0
    faults = {
        "another plan": stated.get("plan_sha256") != file_fingerprint(result.directory / "plan.json"),
        f"law {stated['law']}": stated["law"] != result.planned_law,
        f"hours {stated['hours']}": not close(stated["hours"], hours, 1e-9),
        f"floor {stated['floor']}": not close(stated["floor"] or 0.0, floor, 1e-9),
        "floor per hour": not close((stated["floor_per_hour"] or 0.0) * hours, floor, 1e-9),
        "no sentence on the floor": bool(floor) != bool(stated["floor_says"]),
        "nothing is left out": not stated["not_covered"],
    }
    text = (result.directory / FILE).read_text(encoding="utf-8").lower()
    faults |= {f"the word {word}": word in text for word in WORDS}
    return no_fault(f"{hours:.3g} h", faults, _rate_faults(stated, hours, floor))


def _rate_faults(stated: Mapping[str, Any], hours: float, floor: float) -> Iterator[str]:
    for name, rate in _rates(stated):
        ends = ("low", "rate", "high")
        if not 0.0 <= rate["low"] <= rate["rate"] <= rate["high"] <= 1.0:
            yield f"{name}: interval"
        off = far_apart(rate["per_hour"], {end: rate[end] / hours for end in ends}, 1e-9)
        yield from (f"{name}, per hour: {fault}" for fault in off)
        if rate["for_comparison"] != (rate["rate"] < floor):
            yield f"{name}: for_comparison {rate['for_comparison']}"
    for level in stated["levels"]:
        if not close(level["in_all"], level["per_hour"] * hours, 1e-9):
            yield f"{level['per_hour']} per hour is {level['in_all']} in all"


def _rates(stated: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """All rates with their names."""
    yield from ((area["name"], area["left"]) for area in stated["areas"])
    for level in stated["levels"]:
        yield f"volumes {level['per_hour']}", level["left"]
        yield f"buffer {level['per_hour']}", level["buffer"]["left"]


# --- flights --------------------------------------------------------------------------------------


def left_areas(result: Evidence) -> Verdict:
    """Border, corridors and the given volume are left as often as by new flights."""
    stated = result.document(FILE)
    if not stated["areas"] or stated["areas"][0]["name"] != "border":
        return Verdict("no border", "the border is the first area", False)
    areas = [(area["left"], partial(_leaves_area, result, area)) for area in stated["areas"]]
    return _agrees(result, areas, f"{len(areas)} areas")


def _leaves_area(result: Evidence, area: Mapping[str, Any], x: FloatArray) -> BoolArray:
    if area["name"] == "border":
        low, high = np.array(result.scene["bounds"], float)
        return np.asarray(((x < low - EDGE) | (x > high + EDGE)).any(axis=(1, 2)), bool)
    if area["width_m"]:
        return _leaves_corridor(result.x, 0.5 * area["width_m"], x)
    left = np.zeros(len(x), bool)
    for span in area["within"]:
        rings = [np.array(ring, float) for ring in span["rings_m"]]
        for k in range(span["first_step"], span["last_step"] + 1):
            for place in _along(x, k):
                left |= ~_inside(rings, place)
    return left


def _along(x: FloatArray, k: int) -> Iterator[FloatArray]:
    """Places (n, 2) on step k of each flight, the ends among them."""
    for share in np.linspace(0.0, 1.0, BETWEEN + 1).tolist():
        yield (1.0 - share) * x[:, k] + share * x[:, k + 1]


def _leaves_corridor(route: FloatArray, half: float, x: FloatArray) -> BoolArray:
    """Which flights have a place farther than ``half`` [m] from every leg of the ``route``."""
    left = np.zeros(len(x), bool)
    for k in range(len(route) - 1):
        rows = np.flatnonzero(~left)
        for place in _along(x[rows], k):
            beyond = np.arange(len(place))  # the legs about the one that is flown hold most places
            for j in sorted(range(len(route) - 1), key=lambda j: abs(j - k)):
                begin, end = (np.broadcast_to(route[i], (len(beyond), 2)) for i in (j, j + 1))
                beyond = beyond[segment_distance(place[beyond], begin, end) > half + EDGE]
                if not len(beyond):
                    break
            left[rows[beyond]] = True
    return left


def _inside(rings: Sequence[FloatArray], points: FloatArray) -> BoolArray:
    """Which of ``points`` (n, 2) have an odd number of ``rings`` around them."""
    odd = np.zeros(len(points), bool)
    for ring in rings:
        for a, b in pairwise([*ring, ring[0]]):
            rises = (a[1] > points[:, 1]) != (b[1] > points[:, 1])
            with np.errstate(divide="ignore", invalid="ignore"):
                across = a[0] + (points[:, 1] - a[1]) / (b[1] - a[1]) * (b[0] - a[0])
            odd ^= rises & (points[:, 0] < across)
    return odd


def left_volumes(result: Evidence) -> Verdict:
    """Volumes and fixed buffers are left as often as by new flights, the volumes at most as allowed."""
    stated, faults = result.document(FILE), []
    areas: list[tuple[Mapping[str, Any], Leaves]] = []
    for level in stated["levels"]:
        volumes = [np.array(volume["corners_m"], float) for volume in level["volumes"]]
        areas.append((level["left"], partial(leaves_volumes, volumes)))
        radius = level["buffer"]["radius_m"]
        areas.append((level["buffer"]["left"], partial(_leaves_buffer, result.x, radius)))
        if level["left"]["low"] > level["in_all"]:
            faults.append(f"volumes {level['per_hour']}: left more often than allowed")
    if faults:
        return no_fault("volumes", faults)
    return _agrees(result, areas, f"{len(stated['levels'])} levels")


def leaves_volumes(volumes: Sequence[FloatArray], x: FloatArray) -> BoolArray:
    """Which flights ``x`` (n, T+1, 2) have an end of step k outside of the convex polygon k."""
    left = np.zeros(len(x), bool)
    for k, corners in enumerate(volumes):
        along = np.roll(corners, -1, axis=0) - corners
        sides = np.linalg.norm(along, axis=1)
        normal = np.column_stack([along[:, 1], -along[:, 0]])[sides > 0] / sides[sides > 0, None]
        offset = (normal * corners[sides > 0]).sum(axis=1)
        for t in (k, k + 1):
            left |= (x[:, t] @ normal.T > offset + EDGE).any(axis=1)
    return left


def _leaves_buffer(route: FloatArray, radius: float, x: FloatArray) -> BoolArray:
    left = np.zeros(len(x), bool)
    for k, (a, b) in enumerate(pairwise(route)):
        for t in (k, k + 1):
            begin, end = np.broadcast_to(a, (len(x), 2)), np.broadcast_to(b, (len(x), 2))
            left |= segment_distance(x[:, t], begin, end) > radius + EDGE
    return left


def _agrees(result: Evidence, areas: Sequence[tuple[Mapping[str, Any], Leaves]], checked: str) -> Verdict:
    """Whether the numbers of new flights that leave are likely for some rate within each interval.

    The rarer a rate, the more flights: 20,000 do not contradict a rate of 8e-4 told as 1e-6. They come in
    batches, and end with the first that contradicts a rate; of all looks together at most :data:`RARE` of
    honest records are contradicted.
    """
    wanted = [math.ceil(min(SEEN / max(rate["high"], SEEN / MAX_FLIGHTS), MAX_FLIGHTS)) for rate, _ in areas]
    looks = max(1, math.ceil(max(wanted, default=0) / RUNS))
    counts, runs = np.zeros(len(areas), int), np.zeros(len(areas), int)
    chances = np.ones(len(areas))
    for batch in range(looks):
        x = _flown(result, batch)
        for k, (rate, leaves) in enumerate(areas):
            if batch == 0 or wanted[k] > runs[k]:
                counts[k] += int(leaves(x).sum())
                runs[k] += len(x)
                chances[k] = _chance(rate, int(counts[k]), int(runs[k]))
        if chances.min(initial=1.0) * len(areas) < RARE / looks:
            break
    worst = int(np.argmin(chances))
    told = (
        f"{checked}; {areas[worst][0]['rate']:.3g} of flights, "
        f"of {runs[worst]:,} new ones {counts[worst] / runs[worst]:.3g}"
    )
    return likely(told, min(1.0, float(chances[worst]) * len(areas)), RARE / looks)


def _chance(rate: Mapping[str, Any], count: int, runs: int) -> float:
    """p value of ``count`` for the rate of its interval that fits it best, of a sample as large as stated."""
    mean = count / runs
    if rate["low"] <= mean <= rate["high"]:
        return 1.0
    end = rate["low"] if mean < rate["low"] else rate["high"]
    tail = binom.cdf(count, runs, end) if mean < end else binom.sf(count - 1, runs, end)
    slack = abs(rate["rate"] - end) / 1.96  # the interval itself misses the rate once in twenty
    farther = abs(mean - rate["rate"]) / max(math.hypot(slack, math.sqrt(max(end, 1e-12) / runs)), 1e-12)
    return max(float(tail), math.erfc(farther / math.sqrt(2.0)))


# --- volumes --------------------------------------------------------------------------------------


def volumes(result: Evidence) -> Verdict:
    """Volumes are convex, one for each leg and its time; their size and the size of the buffers follow."""
    stated, dt, faults = result.document(FILE), result.robot.dt, []
    lengths = np.linalg.norm(np.diff(result.x, axis=0), axis=1)
    for level in stated["levels"]:
        name, drawn, buffer = level["per_hour"], level["volumes"], level["buffer"]
        outlines = [np.array(volume["corners_m"], float) for volume in drawn]
        radius = buffer["radius_m"]
        numbers = {
            "volume_time_m2_s": dt * sum(map(signed_area, outlines)),
            "buffer": float(dt * (2.0 * radius * lengths + math.pi * radius**2).sum()),
        }
        claimed = {"volume_time_m2_s": level["volume_time_m2_s"], "buffer": buffer["volume_time_m2_s"]}
        faults += [f"level {name}: {fault}" for fault in far_apart(claimed, numbers)]
        share = numbers["volume_time_m2_s"] / numbers["buffer"]
        faults += [f"level {name}: share {level['share_of_buffer']}"] * (
            not close(level["share_of_buffer"], share, 1e-6)
        )
        times = [(volume["leg"], volume["start_s"], volume["end_s"]) for volume in drawn]
        wanted = [(k, k * dt, (k + 1) * dt) for k in range(len(result.u))]
        if len(times) != len(wanted) or not np.allclose(times, wanted, rtol=1e-9, atol=1e-6):
            faults.append(f"level {name}: times of the legs")
        faults += [f"level {name}: leg {k} is not convex" for k in _bent(outlines)]
        inside = ~leaves_volumes(outlines, result.x[None])
        faults += [f"level {name}: the route leaves its volumes"] * (not inside[0])
    return no_fault(f"{len(stated['levels'])} levels of {len(result.u)} legs", faults)


def _bent(outlines: Sequence[FloatArray]) -> list[int]:
    """The outlines that turn right somewhere."""
    bent = []
    for k, corners in enumerate(outlines):
        along = np.roll(corners, -1, axis=0) - corners
        after = np.roll(along, -1, axis=0)
        turn = along[:, 0] * after[:, 1] - along[:, 1] * after[:, 0]
        if (turn < -1e-6 * np.abs(along).max() ** 2).any():
            bent.append(k)
    return bent


def geojson(result: Evidence) -> Verdict:
    """Each feature is the volume of its level and leg."""
    features, drawn = result.document(GEOJSON)["features"], _all_volumes(result)
    if len(features) != len(drawn):
        return no_fault(f"{len(features)} shapes", [f"{len(drawn)} volumes are expected"])
    return no_fault(f"{len(features)} shapes", _shape_faults(result, features, drawn))


def _all_volumes(result: Evidence) -> list[tuple[float, Mapping[str, Any]]]:
    return [
        (level["per_hour"], volume)
        for level in result.document(FILE)["levels"]
        for volume in level["volumes"]
    ]


def _shape_faults(
    result: Evidence, features: Sequence[Any], drawn: Sequence[tuple[float, Mapping[str, Any]]]
) -> Iterator[str]:
    for one, (level, volume) in zip(features, drawn, strict=True):
        about, name = one["properties"], f"{level} leg {volume['leg']}"
        wanted = {"per_hour": level, **{key: volume[key] for key in ("leg", "start_s", "end_s")}}
        yield from (f"{name}: {key}" for key in wanted if about[key] != wanted[key])
        fault = drawn_fault(
            result.scene["crs"], rings_of(one["geometry"]), [np.array(volume["corners_m"], float)], SAG
        )
        if fault:
            yield f"{name}: {fault}"


def kml(result: Evidence) -> Verdict:
    """Each polygon of the KML file is the volume of its level and leg."""
    rings = [
        np.array([place.split(",")[:2] for place in (node.text or "").split()], float)
        for node in _coordinates(xml_root(result, KML))
    ]
    drawn = _all_volumes(result)
    if len(rings) != len(drawn):
        return no_fault(f"{len(rings)} polygons", [f"{len(drawn)} volumes are expected"])
    faults = (
        f"{level} leg {volume['leg']}: {fault}"
        for ring, (level, volume) in zip(rings, drawn, strict=True)
        if (fault := drawn_fault(result.scene["crs"], [ring], [np.array(volume["corners_m"], float)], SAG))
    )
    return no_fault(f"{len(rings)} polygons", faults)


def _coordinates(root: ElementTree.Element) -> Iterator[ElementTree.Element]:
    return (node for node in root.iter() if node.tag.rpartition("}")[2] == "coordinates")


def intents(result: Evidence) -> Verdict | None:
    """The operational intents have the corners of the volumes."""
    faults, count = [], 0
    for level in result.document(FILE)["levels"]:
        name = f"containment/operational_intent_{_power(level['per_hour'])}.json"
        if not result.has(name):
            continue
        count += 1
        stated = result.document(name)["volumes"]
        if len(stated) != len(level["volumes"]):
            faults.append(f"{name}: {len(stated)} volumes")
            continue
        for one, volume in zip(stated, level["volumes"], strict=True):
            vertices = one["volume"]["outline_polygon"]["vertices"]
            places = in_plane(result.scene["crs"], np.array([(v["lng"], v["lat"]) for v in vertices]))
            corners = np.array(volume["corners_m"], float)
            if places.shape != corners.shape or np.abs(places - corners).max() > SAG:
                faults.append(f"{name}: leg {volume['leg']}")
    return no_fault(f"{count} files", faults) if count else None


def _power(level: float) -> str:
    digits, power = f"{level:.1e}".split("e")
    return f"{level:.2g}" if level >= 0.1 else f"{digits.removesuffix('.0')}e{int(power)}"


CLAIMS: tuple[Claim, ...] = (
    Claim("containment: plan, law, hours and floor", (FILE,), record),
    Claim("containment: border, corridors and given volumes", (FILE, "wind.nc"), left_areas),
    Claim("containment: volumes are left as seldom as claimed", (FILE, "wind.nc"), left_volumes),
    Claim("containment: volumes and their size", (FILE,), volumes),
    Claim("containment: volumes.geojson", (FILE, GEOJSON), geojson),
    Claim("containment: volumes.kml", (FILE, KML), kml),
    Claim("containment: operational intents", (FILE,), intents),
)
