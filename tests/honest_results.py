"""Small results of both presets, with all files, that tests of ``verify`` share and falsify."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import pareto_ltl
from careful_io.files import write_csv, write_json
from careful_io.times import seconds
from pareto_ltl.support.resources import SAMPLE_WINDS
from pareto_ltl.wind.named_laws import law_of_parts_named
from quick_wind import QUICK_WIND

SMALL = {
    "robot": {
        "dt": 1800.0,
        "u_min": 12.0,
        "power": {"kind": "wing", "base": 50.0, "drag": 0.02, "lift": 1000.0, "capacity": 50_000.0},
    },
    "planner": {"trees": 2, "n_max": 3000, "max_steps": 80},
    "smoothing": {"candidates": 1, "weights": [10.0, 100.0]},
    "selection": {"draws": 200, "runs": 1000},
    "wind": QUICK_WIND,
    "deployment": {"runs": 1000},
    "report": {"figures": False},
}
SHARE = 0.3  # of the packaged winds in the forecasts
PRESETS = ("paper", "full")


def honest_results(place: Path) -> dict[str, Path]:
    """A small result of each preset; with ``full`` an aircraft banks in a forecast, held at its end.

    The latter flies a short path of the front: where hardly any flight fails, no lie about failures is one.
    """
    forecast = {
        "source": "csv", "path": str(forecasts(place / "forecasts.csv")), "hold_last": True,
        "forecast_error": str(light_law(place / "law.json")),
    }  # fmt: skip
    turning = {"bank": 20.0, "turn_delay": 30.0}
    risky = {"rule": "threshold", "alpha": 0.06}
    for preset, more in (("paper", {}), ("full", {"wind": forecast, "robot": turning, "selection": risky})):
        settings = {section: values | more.get(section, {}) for section, values in SMALL.items()}
        pareto_ltl.plan("phi1", "F(a & F b & F c)", fidelity=preset, out=place / preset, **settings)
    return {preset: place / preset for preset in PRESETS}


def light_law(path: Path) -> Path:
    """A law of forecast errors for such winds."""
    law = law_of_parts_named("gfs")
    light = replace(law.shared(SHARE**2), name="light", change_sd=SHARE * law.change_sd)
    write_json(path, light.document())
    return path


def forecasts(path: Path, hours: float = 18.0, start: float = 3.0) -> Path:
    """Lighter packaged winds: analyses up to the start of a cycle ``start`` hours after the first time."""
    with SAMPLE_WINDS.open(newline="") as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    first = seconds(rows[0]["time"])
    leads = [(seconds(row["time"]) - first) / 3600 for row in rows]
    found = [
        row
        | {"u": SHARE * float(row["u"]), "v": SHARE * float(row["v"]), "lead_hours": max(lead - start, 0.0)}
        for row, lead in zip(rows, leads, strict=True)
        if lead <= hours
    ]
    write_csv(path, list(found[0]), (row.values() for row in found))
    return path
