"""What is made after a watched flight, from its journal: checks of the wind law, a picture, a search area.

A place that is r standard deviations from the estimate has the rank P = 1 - exp(-r²/2), which is uniform in
[0, 1] if the law is right. Ranks of fixes that were not used count as well: they are how a wrong law shows.

``follow.png`` shows the flight on the map, and its promise over time. ``search_area.geojson`` and
``search_area.kml`` are where to look for a robot after its last telemetry: the belief is carried on with the
controls of the plan, and the areas are ellipses of the linear law, one for each share and time.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from careful_io.files import write_bytes
from pareto_ltl import Run, Scene
from pareto_ltl.extend import Frame
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.counts import clopper_pearson
from pareto_ltl.support.errors import DataError
from pareto_ltl_apps.exports.corridor import FINEST
from pareto_ltl_apps.exports.ellipses import ellipse_outlines, ellipse_scale
from pareto_ltl_apps.exports.geojson import feature
from pareto_ltl_apps.exports.xml_files import (
    boundary,
    coordinates_text,
    element,
    kml_bytes,
    placemark,
    style_of,
)
from pareto_ltl_apps.flight.journal import NAME, read_journal
from pareto_ltl_apps.flight.lines import flows_of
from pareto_ltl_apps.flight.rules import Event
from pareto_ltl_apps.flight.telemetry import read_places
from pareto_ltl_apps.flight.watch import ELLIPSE
from pareto_ltl_apps.view.settings import ReportConfig

SHARES = (0.5, 0.9, 0.99)  # probabilities of ellipses and areas
BINS = 10


def true_distances(events: Iterable[Event], times: FloatArray, x: FloatArray) -> FloatArray:
    """Distances of the truth ``x`` (n, 2) [m] at ``times`` (n,) [s] from each estimate, in its sd.

    Estimates outside of the times are left out.
    """
    found = []
    for event in events:
        if event["event"] != "status" or not times[0] <= event["time"] <= times[-1]:
            continue
        true = np.array([np.interp(event["time"], times, x[:, k]) for k in range(2)])
        c, s = math.cos(event["angle"]), math.sin(event["angle"])
        along = np.array([[c, s], [-s, c]]) @ (true - [event["x"], event["y"]])
        axes = np.maximum(np.array([event["major"], event["minor"]]) / ELLIPSE, 1e-3)
        found.append(float(np.hypot(*(along / axes))))
    return np.array(found)


def truth_summary(folder: Path, truth: Path, scene: Scene) -> dict[str, Any]:
    """How often the ellipses of 50, 90 and 99 % held the truth of a table ``time,lat,lon`` (or ``x,y``).

    Estimates of one flight are not independent: the interval of many flights is wider than it looks.

    Raises
    ------
    DataError
        If the table cannot be used, or no estimate has its time.
    """
    times, places = read_places(truth, scene.time_zero, on_earth=scene.crs is not None)
    x = places if scene.crs is None else scene.frame.to_plane(places[:, 1], places[:, 0])
    far = true_distances(read_journal(folder / NAME), times, x)
    if not len(far):
        raise DataError(f"{truth}: no estimate lies within its times, {times[0]:g} to {times[-1]:g} s")
    inside = {f"{100 * p:.0f}": int((far <= ellipse_scale(p)).sum()) for p in SHARES}
    return {"estimates": len(far), "inside": inside, "largest_sd": float(far.max())}


def fix_ranks(folders: Sequence[Path]) -> dict[str, Any]:
    """Ranks of the position fixes of watched flights, in ``BINS`` equal parts of [0, 1].

    Raises
    ------
    DataError
        If a journal cannot be read.
    """
    events = chain.from_iterable(read_journal(folder / NAME) for folder in folders)
    far = [event["distance"] for event in events if event["event"] == "fix"]
    ranks = 1.0 - np.exp(-0.5 * np.array(far, float) ** 2)
    counts = np.histogram(ranks, bins=BINS, range=(0.0, 1.0))[0].tolist()
    return {
        "fixes": len(far), "counts": counts,
        "intervals": [clopper_pearson(count, len(far)) for count in counts] if far else [],
    }  # fmt: skip


# --- picture ------------------------------------------------------------------------------------


def draw_watch(results: Run, folder: Path) -> Path | None:
    """Draw the journal of ``folder`` on the map of ``results``; None without a status."""
    from pareto_ltl_apps.view.axes import save_figures
    from pareto_ltl_apps.view.plan_maps import watch_figure

    events = list(read_journal(folder / NAME))
    if not any(event["event"] in ("status", "end") for event in events):
        return None
    draw = partial(watch_figure, results.scene, results.plan, events, results.settings.medium)
    return save_figures(folder, results.settings[ReportConfig], {"follow": draw})[0]


# --- search area --------------------------------------------------------------------------------


CORNERS = 48
FILLS = {0.5: "900000c8", 0.9: "600078ff", 0.99: "4000c8ff"}  # aabbggrr


def write_search_area(scene: Scene, end: Event, folder: Path) -> tuple[Path, ...]:
    """Write the areas of an event ``end``; nothing on a map without a place on Earth, or after the plan."""
    if scene.crs is None or not end["ahead"]:
        return ()
    areas = search_areas(scene, end["ahead"])
    text = (
        f"Areas that hold the robot with 50, 90 and 99 % if it flies on as planned, {flows_of(end)}; last "
        f"telemetry {end['time']:.0f} s after departure."
    )
    geojson = {"type": "FeatureCollection", "description": text, "features": areas}
    paths = folder / "search_area.geojson", folder / "search_area.kml"
    write_bytes(paths[0], json.dumps(geojson).encode())
    write_bytes(paths[1], _kml(areas, text))
    return paths


def search_areas(scene: Scene, ahead: Sequence[Event]) -> list[dict[str, Any]]:
    """GeoJSON features: a polygon for each time and share."""
    crs = scene.crs
    assert crs is not None
    mean, cov = (np.array([row[key] for row in ahead]) for key in ("mean", "cov"))
    cov = cov + FINEST**2 * np.eye(2)  # the start of a plan is known exactly
    times = [float(row["time"]) for row in ahead]
    utc = scene.frame.utc(np.array(times))
    found = []
    for share in SHARES:
        scale = np.full(len(mean), ellipse_scale(share))
        for k, outline in enumerate(ellipse_outlines(mean, cov, scale, CORNERS)):
            about = {"probability": share, "t_s": times[k], "time_utc": None if utc is None else utc[k]}
            found.append(feature("Polygon", [np.round(Frame(crs).outline_degrees(outline), 7)], about))
    return found


def _kml(areas: Sequence[dict[str, Any]], text: str) -> bytes:
    def name(share: float) -> str:
        return f"p{100 * share:.0f}"

    styles = [style_of(name(share), None, 1, fill) for share, fill in FILLS.items()]
    places = []
    for area in reversed(areas):  # the widest first, below the others
        about, (ring,) = area["properties"], area["geometry"]["coordinates"]
        share, utc = about["probability"], about["time_utc"]
        shape = element("Polygon", boundary(coordinates_text(ring, digits=7)))
        places.append(placemark(f"{100 * share:.0f} %, {utc or about['t_s']}", name(share), shape, utc))
    return kml_bytes("search area", text, *styles, *places)
