"""Predicted against realised failure rates of plans flown in real winds: reliability, sharpness, scores.

A row is a plan: its mission, its kind, the promised probabilities (columns ``bound_*`` and ``simulated_*``)
and the share of flights that failed (``failure``). Flights of one mission share one wind, and its plans one
map: a mission is one trial. Its plans in a group are averaged, and the interval counts as many trials as
there are missions.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from pareto_ltl.settings import preset
from pareto_ltl.studies import skill
from pareto_ltl.studies.statistics import Columns, mean_chance_columns
from pareto_ltl.studies.tables import markdown_table, rate_cell
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.display import interval_text, probability_text

KEYS = ("fidelity", "kind")  # rows of a group agree in these
FRONT, CHOSEN = "front", "chosen"
SMALLEST = 0.5 / 500  # least probability in a log score: half a failure of 500 flights

Rows = Sequence[Columns]


def promises(row: Mapping[str, Any]) -> list[str]:
    """Columns that promise a probability of failure."""
    return [name for name in row if name.startswith(("bound_", "simulated_"))]


def reliability(rows: Rows, bins: int, keys: Sequence[str] = KEYS) -> list[Columns]:
    """Reliability of each promise, for rows that agree in ``keys``, in ``bins`` equal groups by promise."""
    table = []
    for head, name, known in _promised(rows, keys):
        parts = np.array_split(np.arange(len(known)), max(1, min(bins, len(known))))
        table += [head | _group(name, [known[k] for k in part]) for part in parts if len(part)]
    return table


def scorecard(rows: Rows, keys: Sequence[str] = KEYS) -> list[Columns]:
    """Mean promise, mean realised rate and scores of all plans that agree in ``keys``.

    With p promised and f realised, the Brier score is the mean of f (1 - p)² + (1 - f) p², the log score the
    mean of -f ln p - (1 - f) ln(1 - p); both are least where p = f. ``promised_sd`` is the sharpness. The
    other columns are explained in ``studies/skill.py``, where rows name their departure and situation.
    """
    table = []
    for head, name, known in _promised(rows, keys):
        p, f = (np.array([row[key] for row in known], float) for key in (name, "failure"))
        entry = head | _group(name, known) | {"brier": skill.brier_score(p, f)}
        entry |= {"log_score": log_score(p, f), "promised_sd": float(p.std())}
        entry |= {"above_promise": float((f > p).mean())} | skill.brier_parts(p, f)
        table.append(entry | _skill_columns(p, f, known))
    return table


def _skill_columns(p: FloatArray, f: FloatArray, rows: Rows) -> Columns:
    """Skill against two simple promises, and the interval by weather situations."""
    if not all(row.get("departure") and row.get("situation") for row in rows):
        return {}
    before = skill.persistence(f, [row["departure"] for row in rows])
    return {
        "skill_climatology": skill.skill(p, f, skill.climatology(f)),
        "skill_persistence": skill.skill(p, f, before),
        **skill.situation_columns(f, [row["situation"] for row in rows]),
    }


def log_score(promised: FloatArray, realised: FloatArray) -> float:
    """Mean of -f ln p - (1 - f) ln(1 - p); p counts as at least ``SMALLEST`` and at most 1 - ``SMALLEST``."""
    p = np.clip(promised, SMALLEST, 1 - SMALLEST)
    return float(-(realised * np.log(p) + (1 - realised) * np.log1p(-p)).mean())


def _promised(rows: Rows, keys: Sequence[str]) -> Iterable[tuple[Columns, str, list[Columns]]]:
    """Values of the keys, name of a promise, and the rows that have it, sorted by it."""
    for values in dict.fromkeys(tuple(row[key] for key in keys) for row in rows):
        mine = [row for row in rows if tuple(row[key] for key in keys) == values]
        for name in dict.fromkeys(name for row in mine for name in promises(row)):
            known = [row for row in mine if math.isfinite(row.get(name, math.nan))]
            if known:
                yield (
                    dict(zip(keys, values, strict=True)),
                    name,
                    sorted(known, key=lambda row: float(row[name])),
                )


def _group(name: str, rows: Rows) -> Columns:
    chances: dict[int, list[float]] = {}
    for row in rows:
        chances.setdefault(row["mission"], []).append(row["failure"])
    total = math.fsum(float(np.mean(values)) for values in chances.values())
    promised = [row[name] for row in rows]
    group: Columns = {"promise": name, "plans": len(rows), "missions": len(chances)}
    group |= {
        "promised": float(np.mean(promised)),
        "promised_least": promised[0],
        "promised_most": promised[-1],
    }
    group |= mean_chance_columns("realised", total, len(chances))
    return group | {"kept": group["promised"] >= group["realised_low"]}


# --- texts -----------------------------------------------------------------------------------


def promise_text(fidelity: str, promise: str) -> str:
    """Text for a column of promises, with its wind law: ``V + R, coherent winds``."""
    kind, _, law = promise.partition("_")
    if promise == "bound_paper":
        planned = preset(fidelity).law
        same = planned == "independent"
        return "f_o + R, independent winds" if same else f"f_o, independent winds, + R, {planned} winds"
    return f"{'V + R' if kind == 'bound' else kind}, {law} winds"


def score_table(title: str, cards: Rows, keys: Sequence[str] = KEYS) -> str:
    """The scorecard in Markdown; ``keys`` are its first columns."""
    heads = {"fidelity": "planner", "kind": "plans"}
    first = {heads.get(key, key): partial(_key_text, key) for key in keys}
    return markdown_table(
        title,
        first
        | {
            "foreseen by": _foreseen_by,
            "foreseen, mean": lambda card: probability_text(card["promised"]),
            "failed in the full fields": lambda card: rate_cell(card, "realised"),
            "plans above it": lambda card: probability_text(card["above_promise"]),
            "Brier score": lambda card: f"{card['brier']:.4f}",
            "log score": lambda card: f"{card['log_score']:.3f}",
            "skill over climatology, persistence": _skill_text,
        },
        cards,
    )


def situations_text(card: Columns) -> str:
    """Number of weather situations of a card, and the lowest rate that it can claim; empty if not known."""
    if "situations" not in card:
        return ""
    n, between = card["situations"], interval_text(card["by_situation_low"], card["by_situation_high"])
    return (
        f"Weather situations: {n}; missions of one share its weather. With a situation as one trial, the "
        f"95 % interval of the failed share is {between}. No calibrated rate below 1/({n} + 1) = "
        f"{probability_text(card['floor'])} can be claimed."
    )


def _skill_text(card: Columns) -> str:
    skills = (card.get(f"skill_{name}", math.nan) for name in ("climatology", "persistence"))
    return ", ".join("-" if math.isnan(value) else f"{value:.2f}" for value in skills)


def bin_table(title: str, groups: Rows) -> str:
    """Reliability bins in Markdown."""
    return markdown_table(
        title,
        {
            "planner": lambda group: group["fidelity"],
            "foreseen by": _foreseen_by,
            "missions": lambda group: f"{group['missions']}",
            "foreseen, least to most": lambda group: interval_text(
                group["promised_least"], group["promised_most"]
            ),
            "foreseen, mean": lambda group: probability_text(group["promised"]),
            "failed": lambda group: rate_cell(group, "realised"),
            "kept": lambda group: "yes" if group["kept"] else "no",
        },
        groups,
    )


def _key_text(key: str, row: Columns) -> str:
    return str(row[key])


def _foreseen_by(row: Columns) -> str:
    return promise_text(row["fidelity"], row["promise"])
