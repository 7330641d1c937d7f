"""Laws of either version from their documents, as JSON files hold them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from wind_laws.error_law import ErrorLaw
from wind_laws.forecast_error import forecast_error_of
from wind_laws.law_of_parts import LAW_OF_PARTS_SCHEMA, law_of_parts_of


def law_of(document: Mapping[str, Any]) -> ErrorLaw:
    """The law of a document that fits its schema; ValueError if its numbers are not valid."""
    if document["schema"] == LAW_OF_PARTS_SCHEMA:
        return law_of_parts_of(document)
    return forecast_error_of(document)
