"""Claims about ``report.html``: its numbers agree with ``front.csv`` and ``plan.json``."""

from __future__ import annotations

import re
from html import unescape
from typing import Any

import numpy as np

from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.display import interval_text, probability_text
from pareto_ltl.support.errors import DataError
from pareto_ltl.support.reading import parse_json, read_text
from pareto_ltl_verify.claims.exports import in_plane
from pareto_ltl_verify.claims.verdict import Claim, Verdict, close, no_fault
from pareto_ltl_verify.evidence import Evidence

PAGE = "report.html"
DATA = re.compile(r'<script type="application/json" id="page-data">(.*?)</script>', re.DOTALL)
HEADLINE = re.compile(
    r'<div class="fact main"><dt>fails</dt><dd>(.*?)<small>(.*?)</small></dd></div>', re.DOTALL
)
COLUMNS = (
    "failure", "failure_low", "failure_high", "length_m", "mission_risk", "collision_risk", "duration_s",
)  # fmt: skip
ROUNDED = 1e-3  # largest allowed error of a position in the page, as a share of the map's longer side


def _text(result: Evidence) -> str:
    return read_text(result.directory / PAGE)


def page_data(result: Evidence) -> Any:
    """The JSON data that the script of the page reads; DataError unless there is exactly one set."""
    blocks = DATA.findall(_text(result))
    if len(blocks) != 1:
        raise DataError(f"{PAGE}: has {len(blocks)} sets of numbers; one was expected")
    return parse_json(blocks[0].encode(), PAGE)


def points(result: Evidence) -> Verdict:
    """Each point of the scatter plot is a row of front.csv; without rates its failure is the bound."""
    stated, rows = page_data(result)["points"], result.table("front.csv")
    if len(stated) != len(rows):
        return no_fault(f"{len(stated)} points", [f"{len(rows)} rows"])
    faults = []
    for k, (point, row) in enumerate(zip(stated, rows, strict=True)):
        wanted = {name: float(row[name]) if row[name] else None for name in COLUMNS}
        if wanted["failure"] is None:
            wanted["failure"] = min(1.0, float(row["mission_risk"]) + float(row["collision_risk"]))
        faults += [f"point {k}: {name}" for name, value in wanted.items() if not _equal(point[name], value)]
        faults += [f"point {k}: {point['law']} winds"] * (point["law"] != (row["law"] or result.planned_law))
    return no_fault(f"{len(stated)} points", faults)


def _equal(stated: Any, wanted: float | None) -> bool:
    if stated is None or wanted is None:
        return stated is None and wanted is None
    return close(float(stated), wanted, 1e-9, 1e-12)


def chosen(result: Evidence) -> Verdict:
    """The chosen path and its promise agree with plan.json."""
    data, plan = page_data(result), result.plan
    way = data["paths"][str(data["chosen"])]
    x, size = _positions(result, data), float(np.ptp(np.array(result.scene["bounds"], float), axis=0).max())
    faults = [] if x.shape == result.x.shape else [f"{len(x)} positions"]
    if not faults and np.abs(x - result.x).max() > ROUNDED * size:
        faults.append("positions of the path")
    faults += ["automaton states"] * (way["q"] != plan["q"]) + ["times"] * (way["utc"] != plan["time_utc"])
    promise, wanted = data["promise"], plan["promise"]
    if (promise is None) != (wanted is None):
        faults.append(f"promise {promise}")
    elif promise is not None:
        faults += [f"promise: {key}" for key, value in promise.items() if wanted[key] != value]
    return no_fault(f"point {data['chosen']}", faults)


def _positions(result: Evidence, data: Any) -> FloatArray:
    """The positions of the chosen path (T+1, 2) [m]: the page has degrees for a map on the Earth."""
    places = np.array(data["paths"][str(data["chosen"])]["line"], float)
    return in_plane(result, places) if data["map"]["earthly"] else places


def headline(result: Evidence) -> Verdict | None:
    """The rate in large letters is the promise of plan.json, with its interval and its wind law."""
    matches = HEADLINE.findall(_text(result))
    promise = result.plan["promise"]
    if promise is None:
        return None
    value = probability_text(promise["failure"])
    begin = f"{interval_text(promise['low'], promise['high'])} (95 %), under {promise['law']}"
    notes = tuple(f"{begin} {flows}" for flows in _flows(result))
    if len(matches) != 1:
        return Verdict(f"{len(matches)} rates", f"{value}, {notes[0]}", False)
    stated = tuple(unescape(part) for part in matches[0])
    holds = stated[0] == value and stated[1].startswith(notes)
    return Verdict(", ".join(stated), f"{value}, {notes[0]}", holds)


def _flows(result: Evidence) -> tuple[str, ...]:
    """What moves the robot; pages of earlier versions call currents winds."""
    wind, flown = result.settings["wind"], result.settings["robot"].get("level") or ""
    water = wind["source"] == "currents" or any(text.endswith("depth") for text in (wind["level"], flown))
    return ("currents", "winds") if water else ("winds",)


CLAIMS = (
    Claim("page: points of the front", (PAGE, "front.csv", "plan.json"), points),
    Claim("page: path and promise", (PAGE, "plan.json", "scene.json"), chosen),
    Claim("page: rate in the headline", (PAGE, "plan.json"), headline),
)
