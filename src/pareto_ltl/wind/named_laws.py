"""Laws of wind errors by the names of settings, or in files of users."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from careful_io.reading import Advice
from pareto_ltl.settings.wind import LAW_WORDS
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl.support.schemas import read_document
from wind_laws.documents import first_law, law_of, packaged_law, packaged_laws
from wind_laws.error_law import ErrorLaw
from wind_laws.forecast_error import FORECAST_ERROR_SCHEMA
from wind_laws.law_of_parts import LAW_OF_PARTS_SCHEMA, OWN, LawOfParts

AUTO, NONE, ONE_PART, CURRENTS = "auto", "none", "gfs_one_part", "currents"
LAW_FILE = Advice(
    damaged="expected a file of `pareto-ltl wind-error`", missing="name a file of `pareto-ltl wind-error`"
)
SCHEMAS = {FORECAST_ERROR_SCHEMA: "forecast_error", LAW_OF_PARTS_SCHEMA: "forecast_error_2"}


def law_named(name: str) -> ErrorLaw:
    """The law of a value of ``wind.forecast_error`` other than ``auto``: a packaged one, or one in a file.

    Raises
    ------
    ConfigError
        If there is neither a law nor a file of this name.
    DataError
        If the file is not a valid law.
    """
    if name in packaged_laws():
        return packaged_law(name)
    if name in (NONE, ONE_PART):
        law = first_law()
        return law.without_forecasts() if name == NONE else law
    path = Path(name).expanduser()
    if path.suffix != ".json" and not path.exists():
        raise ConfigError(
            f"wind.forecast_error={name} is neither a law nor a file; laws: {', '.join(LAW_WORDS)}; "
            f"{LAW_FILE.missing}"
        )
    return read_law(path)


def law_of_parts_named(name: str) -> LawOfParts:
    """The packaged law of parts ``name``, or the one in the file of that name; DataError for version 1."""
    law = law_named(name)
    if not isinstance(law, LawOfParts):
        raise DataError(
            f"{name} is a law of version 1 ({FORECAST_ERROR_SCHEMA}), which has no tails to compare with a "
            f"table; expected one of {', '.join(packaged_laws())}, or a file of `pareto-ltl wind-error TABLE`"
        )
    return law


def law_of_newer_runs(name: str) -> ErrorLaw:
    """The law of a value of ``wind.forecast_error`` without what winds of newer runs cannot show.

    ``auto`` is ``gfs``.
    """
    law = law_named("gfs" if name == AUTO else name)
    return replace(law, parts=law.seen_by(OWN)) if isinstance(law, LawOfParts) else law


def read_law(path: Path) -> ErrorLaw:
    """The law in a file of `pareto-ltl wind-error`; DataError if it is not valid."""
    document = read_document(path, SCHEMAS, LAW_FILE)
    try:
        law = law_of(document)
        if isinstance(law, LawOfParts) and not law.parts:
            raise ValueError("a law has one to four parts, got none")
    except ValueError as error:
        raise DataError(f"{path}: {error}; {LAW_FILE.damaged}") from None
    return law
