"""The page of results: figures of the whole corpus, then one row for each mission, without scripts."""

from __future__ import annotations

import json
import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import jinja2
import numpy as np

from corpus.judging import Judged, Row, ended, ending, endings, percent, summary

WIDTH, HEIGHT = 240, 40  # of the dots [px]
SIDE = 120  # of a map [px]
LEAST = 1e-4  # left end of the axis of failure rates
TICKS = ((1e-4, "0.01"), (1e-3, "0.1"), (1e-2, "1"), (1e-1, "10"), (1.0, "100 %"))
LEVELS = {"full": 12, "quick": 22, "bare": 32}  # of the dots [px]


def across(rate: float) -> float:
    """Place of a failure rate on the logarithmic axis [px]."""
    share = math.log10(max(rate, LEAST) / LEAST) / -math.log10(LEAST)
    return 6 + share * (WIDTH - 12)


def dots(judged: Judged) -> list[dict[str, Any]]:
    """One dot for each run with a plan, and its interval."""
    planned = [row for rows in judged.rows.values() for row in rows if row["code"] == 0]
    return [
        {
            **{key: across(row[name]) for key, name in (("x", "promise"), ("low", "low"), ("high", "high"))},
            "y": LEVELS[row["variant"]],
            "variant": row["variant"],
            "said": f"{row['variant']}, seed {row['seed']}: {percent(row['promise'])}",
        }
        for row in planned
    ]


def picture(record: Mapping[str, Any], paths: Sequence[np.ndarray]) -> dict[str, Any]:
    """The map and the planned paths as SVG points; ``paths`` (P, 2) are latitudes and longitudes [deg]."""
    lat, lon = record["tags"]["middle"]
    shrink = math.cos(math.radians(lat))
    drawn = [
        (role, geometry, (np.array(points) - [lon, lat]) * [shrink, -1.0])
        for role, geometry, points in record["sketch"]
    ]
    for path in paths:
        east = (path[:, 1] - lon + 180.0) % 360.0 - 180.0
        drawn.append(("path", "LineString", np.column_stack([east * shrink, lat - path[:, 0]])))
    reach = 1.03 * max(np.abs(points).max() for _, _, points in drawn)
    scaled = [(role, geometry, (points / reach + 1.0) * SIDE / 2) for role, geometry, points in drawn]
    shapes = [
        {
            "role": role,
            "element": "polygon" if geometry == "Polygon" else "polyline",
            "points": " ".join(f"{x:.1f},{y:.1f}" for x, y in points),
        }
        for role, geometry, points in scaled
        if geometry != "Point"
    ]
    start = next(points[0] for role, _, points in scaled if role == "start")
    order = ("border", "region", "landmark", "obstacle", "path")
    return {"shapes": sorted(shapes, key=lambda shape: order.index(shape["role"])), "start": start}


def planned_paths(judged: Judged, out: Path) -> list[np.ndarray]:
    """Latitudes and longitudes of the plans of all seeds; without those whose files are gone."""
    files = [out / "runs" / f"{judged.name}-full-{row['seed']}" / "plan.json" for row in judged.planned]
    plans = [json.loads(file.read_text()) for file in files if file.exists()]
    return [np.column_stack([plan["lat"], plan["lon"]]) for plan in plans]


def span(values: Sequence[float], digits: int = 3) -> str:
    """Least and largest value."""
    if not values:
        return ""
    low, high = (f"{value:.{digits}g}" for value in (min(values), max(values)))
    return low if low == high else f"{low} – {high}"


def remarks(judged: Judged) -> list[tuple[str, bool]]:
    """Lines about the runs of a mission, and whether they are bad; equal endings are one line."""
    ends: dict[tuple[str, str], list[Row]] = defaultdict(list)
    for variant, rows in judged.rows.items():
        for row in rows:
            if row["code"]:
                ends[variant, ending(row)].append(row)
    found = [
        (f"{variant}, {_seeds([row['seed'] for row in rows])}: {ended(rows[0])[:200]}", rows[0]["code"] != 2)
        for (variant, _), rows in ends.items()
    ]
    for variant, name in (("quick", "quick"), ("bare", "without landmarks")):
        if worse := judged.worse.get(variant, {}):
            example = next(iter(worse.values()))
            found.append((f"worse than {name}, {_seeds(list(worse))}, e.g. {example}", True))
    rough = [row for row in judged.planned if "refined" not in row["origin"]]
    if rough:
        found.append((f"not refined: {_seeds([row['seed'] for row in rough])}", False))
    orders = sorted({row["order"] for row in judged.planned})
    if len(orders) > 1:
        found.append((f"orders {', '.join(orders)}", False))
    return found


def _seeds(seeds: Sequence[int]) -> str:
    return f"seed{'s' if len(seeds) > 1 else ''} {', '.join(map(str, seeds))}"


def mission_row(judged: Judged, record: Mapping[str, Any], out: Path) -> dict[str, Any]:
    """What the template shows of one mission."""
    full = judged.rows.get("full", [])
    several = len(full) > 1 and bool(judged.planned)
    return {
        "name": judged.name,
        "tags": judged.tags,
        "picture": picture(record, planned_paths(judged, out)),
        "dots": dots(judged),
        "promise": span([100 * row["promise"] for row in judged.planned]),
        "length": span([row["length"] / 1e3 for row in judged.planned]),
        "front": span([len(row["front"]) for row in judged.planned]),
        "volume": f"{min(judged.volumes):.2f}" if judged.volumes else "",
        "spread": "" if judged.spread is None else f"{judged.spread:.2f}",
        "seeds": f"{len(judged.planned)} of {len(full)} seeds" if len(judged.planned) < len(full) else "",
        "equal": f"{max(judged.ratios):.2f}" if judged.ratios else "",
        "apart": not judged.equal,
        "disagrees": several and not judged.agrees,
        "misses": several and not judged.covers,
        "cpu": span(judged.cpu, 2),
        "remarks": remarks(judged),
    }


def write_page(judged: Sequence[Judged], out: Path, unit: float | None, words: Sequence[str]) -> Path:
    """Write ``out``/index.html."""
    records = {
        one.name: json.loads((out / "missions" / one.name / "mission.json").read_text()) for one in judged
    }
    loader = jinja2.FileSystemLoader(Path(__file__).parent)
    template = jinja2.Environment(loader=loader, autoescape=True, trim_blocks=True).get_template("page.html")
    page = out / "index.html"
    page.write_text(
        template.render(
            goals=summary(judged, unit),
            endings=endings(judged),
            missions=[mission_row(one, records[one.name], out) for one in judged],
            ticks=[(across(rate), text) for rate, text in TICKS],
            words=" ".join(words),
            size=(WIDTH, HEIGHT, SIDE),
        ),
        encoding="utf-8",
    )
    return page
