"""Laws of either version from their documents, and those that come with the package, by name."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from wind_laws.error_law import ErrorLaw
from wind_laws.forecast_error import ForecastError, forecast_error_of
from wind_laws.law_of_parts import LAW_OF_PARTS_SCHEMA, LawOfParts, law_of_parts_of

LAWS_FOLDER = Path(__file__).parent / "data"
PARTS_FOLDER = LAWS_FOLDER / "parts"


def law_of(document: Mapping[str, Any]) -> ErrorLaw:
    """The law of a document that fits its schema; ValueError if its numbers are not valid."""
    if document["schema"] == LAW_OF_PARTS_SCHEMA:
        return law_of_parts_of(document)
    return forecast_error_of(document)


def packaged_laws() -> tuple[str, ...]:
    """Names of the packaged laws of parts."""
    return tuple(sorted(path.stem for path in PARTS_FOLDER.glob("*.json")))


def packaged_law(name: str) -> LawOfParts:
    """The packaged law of parts ``name``, one of :func:`packaged_laws`."""
    return law_of_parts_of(_document(PARTS_FOLDER / f"{name}.json"))


def first_law() -> ForecastError:
    """The packaged law of version 1, of GFS."""
    return forecast_error_of(_document(LAWS_FOLDER / "gfs.json"))


def _document(path: Path) -> dict[str, Any]:
    document: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return document
