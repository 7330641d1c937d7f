"""Errors of Hydra and OmegaConf in one line."""

from __future__ import annotations

from hydra.errors import HydraException, MissingConfigException, OverrideParseException
from omegaconf.errors import MissingMandatoryValue, OmegaConfBaseException

from pareto_ltl.cli.arguments import EXPECTED_ERRORS
from pareto_ltl.run.provenance import one_line

CONFIGURATION_ERRORS: tuple[type[Exception], ...] = (
    *EXPECTED_ERRORS,
    HydraException,
    OmegaConfBaseException,
)
QUOTES = "a value with spaces or ( ) & | ! needs two pairs of quotes: \"mission.formula='F(a & F b)'\""


def explain_error(error: BaseException) -> str:
    """What was wrong, in one line."""
    if isinstance(error, MissingConfigException) and error.options:
        group, _, choice = (error.missing_cfg_file or "").rpartition("/")
        return f"there is no {group.removesuffix('s')} {choice!r}; there are {', '.join(error.options)}"
    if isinstance(error, OverrideParseException):
        return f"cannot read {error.override!r} ({_first_line(error)}); {QUOTES}"
    if isinstance(error, MissingMandatoryValue):
        return f"a setting is missing: {_first_line(error)}"
    if isinstance(error, HydraException) and isinstance(error.__cause__, OmegaConfBaseException):
        return f"{_full_key(error.__cause__) or _first_line(error)}: {_first_line(error.__cause__)}"
    if isinstance(error, OmegaConfBaseException):
        return f"{_full_key(error)}: {_first_line(error)}" if _full_key(error) else _first_line(error)
    if isinstance(error, HydraException):
        return " ".join(str(error).split("full_key:")[0].split())
    return one_line(error)


def _first_line(error: BaseException) -> str:
    lines = str(error).strip().splitlines()
    return lines[0].strip() if lines else type(error).__name__


def _full_key(error: OmegaConfBaseException) -> str:
    return str(getattr(error, "full_key", None) or "")
