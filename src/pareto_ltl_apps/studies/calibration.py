"""Predicted against realised failure rates of plans flown in real winds: reliability, sharpness, scores.

A row is a plan: its mission, its kind, the promised probabilities (columns ``bound_*`` and ``simulated_*``)
and the share of flights that failed (``failure``). Flights of one mission share one wind, and its plans one
map: a mission is one trial. Its plans in a group are averaged, and the interval counts as many trials as
there are missions. Missions that depart in one weather situation (a period of successive fields) share its
weather. Intervals by situations count a situation as one trial.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from careful_io.texts import interval_text, probability_text
from pareto_ltl import Settings
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.counts import clopper_pearson
from pareto_ltl_apps.studies.tables import Columns, markdown_table, mean_chance_columns, rate_cell

KEYS = ("fidelity", "kind")  # rows of a group agree in these
FRONT, CHOSEN = "front", "chosen"
SMALLEST = 0.5 / 500  # least probability in a log score: half a failure of 500 flights
LEVEL = 0.95  # of intervals by weather situations

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
    columns of :func:`skill` and :func:`situation_columns` need rows that name departure and situation.
    """
    table = []
    for head, name, known in _promised(rows, keys):
        p, f = (np.array([row[key] for row in known], float) for key in (name, "failure"))
        entry = head | _group(name, known) | {"brier": brier_score(p, f)}
        entry |= {"log_score": log_score(p, f), "promised_sd": float(p.std())}
        entry |= {"above_promise": float((f > p).mean())} | brier_parts(p, f)
        table.append(entry | _skill_columns(p, f, known))
    return table


def _skill_columns(p: FloatArray, f: FloatArray, rows: Rows) -> Columns:
    """Skill against two simple promises, and the interval by weather situations."""
    if not all(row.get("departure") and row.get("situation") for row in rows):
        return {}
    before = persistence(f, [row["departure"] for row in rows])
    return {
        "skill_climatology": skill(p, f, climatology(f)),
        "skill_persistence": skill(p, f, before),
        **situation_columns(f, [row["situation"] for row in rows]),
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
                ordered = sorted(known, key=lambda row: float(row[name]))
                yield dict(zip(keys, values, strict=True)), name, ordered


def _group(name: str, rows: Rows) -> Columns:
    """The columns of plans in the order of their promise ``name``."""
    chances: dict[int, list[float]] = {}
    for row in rows:
        chances.setdefault(row["mission"], []).append(row["failure"])
    total = math.fsum(float(np.mean(values)) for values in chances.values())
    promised = [row[name] for row in rows]
    group: Columns = {"promise": name, "plans": len(rows), "missions": len(chances)}
    group |= {"promised": float(np.mean(promised)), "promised_least": promised[0]}
    group |= {"promised_most": promised[-1]} | mean_chance_columns("realised", total, len(chances))
    return group | {"kept": group["promised"] >= group["realised_low"]}


# --- scores ----------------------------------------------------------------------------------


def brier_scores(promised: FloatArray, realised: FloatArray) -> FloatArray:
    """f (1 - p)² + (1 - f) p² for each promise p and realised rate f."""
    return np.asarray(realised * (1 - promised) ** 2 + (1 - realised) * promised**2, float)


def brier_score(promised: FloatArray, realised: FloatArray) -> float:
    """The mean of :func:`brier_scores`."""
    return float(brier_scores(promised, realised).mean())


def isotonic_rates(promised: FloatArray, realised: FloatArray) -> FloatArray:
    """The rates that do not fall with the promise and have the least Brier score, one for each promise.

    They are the reliability diagram without bins (Dimitriadis, Gneiting and Jordan 2021,
    doi:10.1073/pnas.2016191118).
    """
    from sklearn.isotonic import IsotonicRegression

    return np.asarray(IsotonicRegression().fit(promised, realised).predict(promised), float)


def brier_parts(promised: FloatArray, realised: FloatArray) -> Columns:
    """Brier score = miscalibration - discrimination + uncertainty, from the isotonic rates."""
    fitted = brier_score(isotonic_rates(promised, realised), realised)
    usual = brier_score(np.full(len(realised), realised.mean()), realised)
    return {
        "miscalibration": brier_score(promised, realised) - fitted,
        "discrimination": usual - fitted,
        "uncertainty": usual,
    }


def climatology(realised: FloatArray) -> FloatArray:
    """For each mission the mean rate of all others; 1/2 for a single one."""
    n = len(realised)
    return np.full(1, 0.5) if n == 1 else (realised.sum() - realised) / (n - 1)


def persistence(realised: FloatArray, departures: Sequence[str]) -> FloatArray:
    """For each mission the mean rate of the latest earlier departure; of the first one, climatology."""
    _, place = np.unique(np.array(departures), return_inverse=True)
    means = np.bincount(place, realised) / np.bincount(place)
    return np.where(place == 0, climatology(realised), means[np.maximum(place - 1, 0)])


def skill(promised: FloatArray, realised: FloatArray, reference: FloatArray) -> float:
    """1 - Brier score of the promises / Brier score of ``reference``; NaN if the latter is 0."""
    usual = brier_score(reference, realised)
    return 1.0 - brier_score(promised, realised) / usual if usual > 0.0 else math.nan


def mean_interval(values: FloatArray, situations: Sequence[str]) -> tuple[int, float, float]:
    """Number n of situations, and the 95 % interval of the mean with a situation as one trial.

    Student's t of n - 1 degrees of freedom for the mean of clusters; infinite for one situation.
    """
    from scipy.stats import t

    _, place = np.unique(np.array(situations), return_inverse=True)
    n, mean = int(place.max()) + 1, float(values.mean())
    if n == 1:
        return 1, -math.inf, math.inf
    sums = np.bincount(place, values - mean)
    half = float(t.ppf(0.5 + LEVEL / 2, n - 1) * np.sqrt(n / (n - 1) * (sums**2).sum()) / len(values))
    return n, mean - half, mean + half


def situation_columns(realised: FloatArray, situations: Sequence[str]) -> Columns:
    """The number n of situations, the 95 % interval of the mean rate by them, and ``floor`` = 1 / (n + 1).

    One situation says nothing. No rate that is calibrated on n situations can be claimed to be below the
    floor: the next situation is the worst of n + 1 with that probability.
    """
    n, low, high = mean_interval(realised, situations)
    # Rates that are all near 0 or 1 have no spread from which an interval follows: the exact one of n trials.
    events = float(realised.mean()) * n
    if events < 1.0:
        high = max(high, clopper_pearson(math.ceil(events), n)[1])
    if events > n - 1.0:
        low = min(low, clopper_pearson(math.floor(events), n)[0])
    ends = {"by_situation_low": max(0.0, low), "by_situation_high": min(1.0, high)}
    return {"situations": n} | ends | {"floor": 1.0 / (n + 1)}


# --- texts -----------------------------------------------------------------------------------


def promise_text(fidelity: str, promise: str) -> str:
    """Text for a column of promises, with its wind law: ``V + R, coherent winds``."""
    kind, _, law = promise.partition("_")
    if promise == "bound_paper":
        planned = Settings.preset(fidelity).law
        same = planned == "independent"
        return "f_o + R, independent winds" if same else f"f_o, independent winds, + R, {planned} winds"
    return f"{'V + R' if kind == 'bound' else kind}, {law} winds"


def score_table(title: str, cards: Rows, keys: Sequence[str] = KEYS) -> str:
    """The scorecard in Markdown; ``keys`` are its first columns."""
    heads = {"fidelity": "planner", "kind": "plans"}
    return markdown_table(
        title,
        {
            **{heads.get(key, key): key for key in keys},
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
            "planner": "fidelity",
            "foreseen by": _foreseen_by,
            "missions": "missions",
            "foreseen, least to most": lambda group: interval_text(
                group["promised_least"], group["promised_most"]
            ),
            "foreseen, mean": lambda group: probability_text(group["promised"]),
            "failed": lambda group: rate_cell(group, "realised"),
            "kept": lambda group: "yes" if group["kept"] else "no",
        },
        groups,
    )


def _foreseen_by(row: Columns) -> str:
    return promise_text(row["fidelity"], row["promise"])
