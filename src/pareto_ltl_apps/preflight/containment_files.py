"""What ``pareto-ltl contain`` prints and writes: lines, documents, volumes for maps, the figure."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as Xml

import shapely

from careful_io.files import plain_data, write_bytes, write_json, write_text
from careful_io.fingerprints import file_fingerprint
from careful_io.texts import distance_text, interval_text, plain_power, probability_text
from pareto_ltl import ConfigError, Run, Scene
from pareto_ltl.extend import FailureRate
from pareto_ltl_apps.exports.degrees import polygon_parts
from pareto_ltl_apps.exports.formats import holds_pole
from pareto_ltl_apps.exports.geojson import feature, listed_json
from pareto_ltl_apps.exports.settings import ExportsConfig
from pareto_ltl_apps.exports.xml_files import boundary, coordinates_text, element, kml_bytes, style_of
from pareto_ltl_apps.preflight.containment import HOUR, NOT_COVERED, Containment, Level, floor_sentence
from pareto_ltl_apps.preflight.leaving import Area
from pareto_ltl_apps.view.settings import ReportConfig

SCHEMA = "pareto_ltl.containment/1"
FOLDER = "containment"  # in the results directory
COLOURS = ("ff3c8c3c", "ff00a5ff", "ff1e1eb4")  # of the outlines of the levels in KML: aabbggrr
Band = tuple[float, float] | None  # lowest and highest height above the WGS 84 ellipsoid [m]


# --- lines ------------------------------------------------------------------------------------------


def containment_lines(found: Containment, flows: str) -> Iterator[str]:
    """The answer for a person."""
    yield f"flight of {found.hours:.3g} h in {found.law} {flows}; samples of {found.flights:,} flights"
    for area, rate in found.areas:
        yield f"leave the {area.name}: {probability_text(rate.failure)} (95 %: {_ends(rate)}) of flights,"
        yield f"  {hourly_text(found, rate)} per flight hour{_sample_text(rate)}"
    for level in found.levels:
        rate = level.rate
        allowed = probability_text(level.in_all)
        allowed = f"{plain_power(level.per_hour)} per flight hour ({allowed} of flights)"
        yield f"volumes for {allowed}:"
        yield (
            f"  {probability_text(rate.failure)} (95 %: {_ends(rate)}) leave them, "
            f"{hourly_text(found, rate)} per flight hour{_sample_text(rate)}"
        )
        yield (
            f"  {area_time_text(level.volumes.volume_time)}, {100.0 * level.share:.0f} % of a fixed buffer "
            f"of {distance_text(level.radius)} that as many leave"
        )
    for reason in found.skipped:
        yield f"not shown: {reason}"
    if sentence := floor_sentence(found):
        yield sentence
    yield f"Not in these figures: {'; '.join(NOT_COVERED)}."


def hourly_text(found: Containment, rate: FailureRate) -> str:
    """A rate per flight hour with its interval: ``9.1e-4 (8e-4 to 1e-3)``."""
    low, middle, high = (value / found.hours for value in (rate.low, rate.failure, rate.high))
    return f"{plain_power(middle)} ({plain_power(low)} to {plain_power(high)})"


def area_time_text(volume_time: float) -> str:
    """Area times time [m² s] as text: ``1,234 km² h``, or in m² h below 1 km² h."""
    if volume_time < 1e6 * HOUR:
        return f"{volume_time / HOUR:,.0f} m² h"
    return f"{volume_time / (1e6 * HOUR):,.4g} km² h"


def _ends(rate: FailureRate) -> str:
    return interval_text(rate.low, rate.high)


def _sample_text(rate: FailureRate) -> str:
    return " (weighted flights)" if rate.weighted else ""


# --- the document -----------------------------------------------------------------------------------


def containment_document(found: Containment) -> dict[str, Any]:
    """The content of ``containment.json``."""
    return {
        "schema": SCHEMA,
        "law": found.law,
        "hours": found.hours,
        "flights": found.flights,
        "floor": found.floor or None,
        "floor_per_hour": found.floor / found.hours or None,
        "floor_says": floor_sentence(found) or None,
        "areas": [_area_document(found, area, rate) for area, rate in found.areas],
        "levels": [_level_document(found, level) for level in found.levels],
        "skipped": list(found.skipped),
        "not_covered": list(NOT_COVERED),
    }


def _rate_document(found: Containment, rate: FailureRate) -> dict[str, Any]:
    """A rate of flights, and per flight hour."""
    ends = {"rate": rate.failure, "low": rate.low, "high": rate.high}
    return {
        **ends,
        "per_hour": {name: value / found.hours for name, value in ends.items()},
        "runs": rate.runs,
        "method": rate.method,
        "for_comparison": rate.failure < found.floor,
    }


def _area_document(found: Containment, area: Area, rate: FailureRate) -> dict[str, Any]:
    about: dict[str, Any] = {"name": area.name, "width_m": 2.0 * area.half_width or None}
    if area.name.startswith("volume "):
        about["within"] = [
            {"first_step": first, "last_step": last, "rings_m": _rings(shape)}
            for first, last, shape in _spans(area)
        ]
    return about | {"left": _rate_document(found, rate)}


def _spans(area: Area) -> Iterator[tuple[int, int, Any]]:
    """First and last step of each shape of an area."""
    first = 0
    for k, shape in enumerate(area.within):
        if k + 1 == len(area.within) or area.within[k + 1] is not shape:
            yield first, k, shape
            first = k + 1


def _rings(shape: Any) -> list[Any]:
    """The rings of all polygons of a shapely area, inside where an odd number of them is around."""
    rings = (ring for part in shapely.get_parts(shape) for ring in (part.exterior, *part.interiors))
    return [shapely.get_coordinates(ring)[:-1].tolist() for ring in rings]


def _level_document(found: Containment, level: Level) -> dict[str, Any]:
    return {
        "per_hour": level.per_hour,
        "in_all": level.in_all,
        "left": _rate_document(found, level.rate),
        "volume_time_m2_s": level.volumes.volume_time,
        "buffer": {
            "radius_m": level.radius,
            "volume_time_m2_s": level.buffer_volume_time,
            "left": _rate_document(found, level.buffer_rate),
        },
        "share_of_buffer": level.share,
        "volumes": [
            {"leg": k, "start_s": start, "end_s": end, "corners_m": corners.tolist()}
            for k, (corners, (start, end)) in enumerate(
                zip(level.volumes.outlines, pairwise(found.t.tolist()), strict=True)
            )
        ],
    }


# --- files ------------------------------------------------------------------------------------------


def write_containment(run: Run, found: Containment, folder: Path, band: Band = None) -> None:
    """Write ``containment.json``, ``containment.txt``, the figure, and volumes for maps if there is a place.

    Raises
    ------
    ConfigError
        If ``band`` is given, and the map has no place on Earth or the plan no times in UTC.
    """
    from pareto_ltl_apps.view.axes import save_figures
    from pareto_ltl_apps.view.containment import containment_figure

    scene, medium = found.scene, run.settings.medium
    lower, upper = run.settings[ExportsConfig].altitude_lower, run.settings[ExportsConfig].altitude_upper
    usable = scene.crs is not None and scene.frame.utc(found.t) is not None
    if band is not None and not usable:
        raise ConfigError(
            "contain: --between needs a map with a place on Earth and times in UTC; set scene.centre and "
            "mission.start_time, or leave it out"
        )
    if band is None and lower is not None and upper is not None:
        band = lower, upper
    folder.mkdir(parents=True, exist_ok=True)
    document = containment_document(found)
    if run.directory is not None:
        document["plan_sha256"] = file_fingerprint(run.place / "plan.json")
    write_json(folder / "containment.json", plain_data(document))
    lines = list(containment_lines(found, medium.flows))
    write_text(folder / "containment.txt", "\n".join(lines) + "\n")
    levels = [(level.per_hour, level.volumes.outlines) for level in found.levels]
    chart = [
        (
            level.per_hour, level.rate.failure / found.hours, level.volumes.volume_time,
            level.buffer_rate.failure / found.hours, level.buffer_volume_time,
        )
        for level in found.levels
    ]  # fmt: skip
    if levels:
        heading = f"Air for {run.plan.formula}, {found.law} {medium.flows}"
        draw = partial(containment_figure, scene, run.plan, heading, levels, chart, found.floor / found.hours)
        save_figures(folder, run.settings[ReportConfig], {"containment": draw})
    if scene.crs is not None and not holds_pole(scene):
        about = " ".join(lines)
        write_bytes(folder / "volumes.geojson", volumes_geojson(scene, found, about))
        write_bytes(folder / "volumes.kml", volumes_kml(scene, found, about))
    if usable and band is not None:
        for level in found.levels:
            name = f"operational_intent_{plain_power(level.per_hour)}.json"
            write_bytes(folder / name, intent_json(scene, found, level, band, " ".join(lines)))


def _times(found: Containment) -> tuple[str, ...] | None:
    return found.scene.frame.utc(found.t)


def volumes_geojson(scene: Scene, found: Containment, about: str) -> bytes:
    """A polygon for each level and leg, with its times."""
    features = []
    utc = _times(found)
    for level in found.levels:
        for k, corners in enumerate(level.volumes.outlines):
            parts = polygon_parts([scene.frame.outline_degrees(corners)])
            reported = {
                "role": "volume", "per_hour": level.per_hour, "leg": k,
                "start_s": found.t[k], "end_s": found.t[k + 1],
                "time_start": utc and utc[k], "time_end": utc and utc[k + 1],
            }  # fmt: skip
            kind = "Polygon" if len(parts) == 1 else "MultiPolygon"
            features.append(feature(kind, parts[0] if len(parts) == 1 else parts, reported))
    head = {"type": "FeatureCollection", "name": "containment", "description": about}
    return listed_json(head, "features", features)


def volumes_kml(scene: Scene, found: Containment, about: str) -> bytes:
    """A folder for each level, a placemark for each leg with its span of time."""
    styles = [style_of(f"level{n}", colour, 2, "30" + colour[2:]) for n, colour in enumerate(COLOURS)]
    utc, folders = _times(found), []
    for n, level in enumerate(found.levels):
        marks = [
            _placemark(scene, k, corners, f"#level{min(n, len(COLOURS) - 1)}", utc)
            for k, corners in enumerate(level.volumes.outlines)
        ]
        folders.append(
            element("Folder", element("name", f"{plain_power(level.per_hour)} per flight hour"), *marks)
        )
    return kml_bytes("containment", about, *styles, *folders)


def _placemark(scene: Scene, k: int, corners: Any, style: str, utc: tuple[str, ...] | None) -> Xml.Element:
    span = None
    if utc is not None:
        span = element("TimeSpan", element("begin", utc[k]), element("end", utc[k + 1]))
    ring = boundary(coordinates_text(scene.frame.outline_degrees(corners)))
    shape = element("Polygon", element("tessellate", "1"), ring)
    return element("Placemark", element("name", f"leg {k}"), span, element("styleUrl", style), shape)


def intent_json(
    scene: Scene, found: Containment, level: Level, band: tuple[float, float], about: str
) -> bytes:
    """Volumes as OperationalIntentDetails of ASTM F3548-21 has them."""
    utc = _times(found)
    assert utc is not None
    lower, upper = ({"value": h, "reference": "W84", "units": "M"} for h in band)
    volumes = []
    for corners, times in zip(level.volumes.outlines, pairwise(utc), strict=True):
        places = scene.frame.lonlat(corners).tolist()
        outline = {"vertices": [{"lng": lon, "lat": lat} for lon, lat in places]}
        start, end = ({"value": time, "format": "RFC3339"} for time in times)
        volume = {"outline_polygon": outline, "altitude_lower": lower, "altitude_upper": upper}
        volumes.append({"volume": volume, "time_start": start, "time_end": end})
    note = f"Volumes for {plain_power(level.per_hour)} per flight hour. {about}"
    head = {"pareto_ltl": {"note": note}, "priority": 0, "off_nominal_volumes": []}
    return listed_json(head, "volumes", plain_data(volumes))
