"""The file of `pareto-ltl wind-error`: an estimate of forecast errors as a law for planning."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.fingerprints import file_fingerprint
from pareto_ltl.wind.block_bootstrap import Interval
from pareto_ltl.wind.error_estimate import ErrorEstimate, ErrorTable
from pareto_ltl.wind.forecast_error import ForecastError
from pareto_ltl.wind.readings import HOUR, iso


def estimated_law(estimate: ErrorEstimate, name: str, usual: ForecastError) -> ForecastError:
    """The estimated law; missing values are taken from ``usual``.

    ``usual`` is scaled to the spread of the winds if its level differs.
    """
    law = replace(usual.for_winds(estimate.level, estimate.spread), name=name, spread=estimate.spread)
    law = replace(law, lags=estimate.change.at, change_sd=_values(estimate.change))
    if estimate.forecast is not None:
        leads = np.concatenate([[0.0], estimate.forecast.at])
        law = replace(law, leads=leads, forecast_sd=np.concatenate([[0.0], _values(estimate.forecast)]))
    if (length := estimate.forecast_length.length) is not None:
        law = replace(law, forecast_length=length.value)
    if (length := estimate.change_length.length) is not None:
        law = replace(law, change_length=length.value)
    if (persistence := estimate.persistence).value is not None:
        law = replace(law, persistence=persistence.value.value, persistence_time=persistence.step)
    return law


def error_document(
    estimate: ErrorEstimate,
    law: ForecastError,
    usual: str,
    files: Sequence[Path],
    analysis_error: Mapping[str, Any] | str,
) -> dict[str, Any]:
    """The content of the file: the law, intervals, numbers of pairs, origin of each number, source files.

    Parameters
    ----------
    usual : str
        Name of the law whose values are used where the data do not suffice.
    """
    document = law.document()
    forecast, change = document["forecast"], document["change"]
    if estimate.forecast is not None:
        forecast |= _columns(estimate.forecast, zero=True)
    forecast |= _ends("length", estimate.forecast_length.length)
    forecast |= _ends("persistence", estimate.persistence.value)
    change |= _columns(estimate.change, zero=False) | _ends("length", estimate.change_length.length)
    head = {key: document[key] for key in ("schema", "name")} | {"origin": origin_text(estimate, usual)}
    return (
        head
        | {key: value for key, value in document.items() if key not in head}
        | {"analysis_error": analysis_error, "files": {file.name: file_fingerprint(file) for file in files}}
    )


def origin_text(estimate: ErrorEstimate, usual: str) -> str:
    """Text on the origin of the numbers, and on the numbers that are not from the data."""
    first, last = (iso(moment) for moment in estimate.period)
    sentences = [
        f"{estimate.cycles} cycles from {first} to {last}, {estimate.nodes} nodes; errors are differences "
        "from analyses; 95 % intervals by a block bootstrap over cycles"
    ]
    if (table := estimate.forecast) is not None:
        ways = "; ".join(f"e({at / HOUR:g} h) by {way}" for at, way in zip(table.at, table.ways, strict=True))
        sentences.append(ways)
    assumed = [f"{what} taken from {usual}, since {why}" for what, why in unknown_parts(estimate).items()]
    return ". ".join([*sentences, *assumed, *estimate.notes])


def unknown_parts(estimate: ErrorEstimate) -> dict[str, str]:
    """The values that could not be estimated, each with the reason."""
    parts: dict[str, str] = {}
    if estimate.forecast is None:
        parts["error of forecasts"] = estimate.forecast_length.reason
    for name, fit in (
        ("length of the error", estimate.forecast_length),
        ("length of the change", estimate.change_length),
    ):
        if fit.length is None:
            parts[name] = fit.reason
    if estimate.persistence.value is None:
        parts["persistence"] = estimate.persistence.reason
    return parts


def _values(table: ErrorTable) -> FloatArray:
    return np.array([sd.value for sd in table.sd])


def _columns(table: ErrorTable, *, zero: bool) -> dict[str, list[Any]]:
    """Intervals, pairs and methods; with ``zero``, a first entry for lead 0, which is 0 by definition."""
    first: list[Any] = [0.0] if zero else []
    return {
        "sd_low": first + [sd.low for sd in table.sd],
        "sd_high": first + [sd.high for sd in table.sd],
        "pairs": ([None] if zero else []) + table.pairs.tolist(),
        "ways": (["by definition"] if zero else []) + list(table.ways),
    }


def _ends(name: str, found: Interval | None) -> dict[str, float | None]:
    return {
        f"{name}_low": None if found is None else found.low,
        f"{name}_high": None if found is None else found.high,
    }
