"""Errors of Hydra and OmegaConf in one line."""

from __future__ import annotations

import re

from hydra.errors import HydraException, MissingConfigException, OverrideParseException
from omegaconf.errors import (
    ConfigAttributeError,
    ConfigKeyError,
    MissingMandatoryValue,
    OmegaConfBaseException,
    ValidationError,
)

from pareto_ltl.cli.output import EXPECTED_ERRORS
from pareto_ltl.run.provenance import one_line
from pareto_ltl.settings import Settings
from pareto_ltl.settings.checks import kind_at, kind_problem, kind_text
from pareto_ltl.support.messages import shown_text, shown_value

CONFIGURATION_ERRORS: tuple[type[Exception], ...] = (
    *EXPECTED_ERRORS,
    HydraException,
    OmegaConfBaseException,
    RecursionError,
    MemoryError,
)
OF_A_RESOLVER = "ConfigError raised while resolving interpolation: "  # what OmegaConf writes before it
LINE_WIDTH = 300  # characters of a message of Hydra that are shown
LETTERS = "letters beyond ASCII need two pairs of quotes: "
SMALLER = "lower planner.n_max, planner.trees, deployment.runs or report.dpi"
QUOTES = "a value with spaces or ( ) [ ] { } & | ! needs two pairs of quotes: "
EXAMPLE = "\"mission.formula='F(a & F b)'\""
LONGEST_EXAMPLE = 100  # characters of a setting that is repeated with its quotes


def explain_error(error: BaseException) -> str:
    """The error in one line."""
    if isinstance(error, MissingConfigException) and error.options:
        group, _, choice = (error.missing_cfg_file or "").rpartition("/")
        known = ", ".join(error.options)
        return f"there is no {group.removesuffix('s')} {shown_value(choice)}; there are {known}"
    if isinstance(error, OverrideParseException):
        return f"cannot read {shown_value(error.override)}; {_cure_of(str(error.override or ''))}"
    if isinstance(error, MemoryError):
        return f"there is not enough memory ({shown_text(str(error)) or 'out of memory'}); {SMALLER}"
    if isinstance(error, RecursionError):
        return "a setting or a file of settings is nested too deeply to be read; use fewer brackets"
    if isinstance(error, MissingMandatoryValue):
        return f"a setting is missing: {_first_line(error)}"
    if isinstance(error, HydraException) and isinstance(error.__cause__, OmegaConfBaseException):
        return _explain_value(error.__cause__, _overridden_key(error))
    if isinstance(error, OmegaConfBaseException):
        return _explain_value(error, "")
    if isinstance(error, HydraException):
        return shown_text(" ".join(str(error).split("full_key:")[0].split()), LINE_WIDTH)
    return one_line(error)


def _overridden_key(error: HydraException) -> str:
    """The key of a setting that could not be merged, or Hydra's text if it has no key."""
    found = re.search(r"override '?[+~]*([\w.]+)", _first_line(error))
    return found[1] if found else shown_text(_first_line(error))


def _explain_value(error: OmegaConfBaseException, place: str) -> str:
    """The error of a value, with the words of the settings if its key is one of them."""
    key = _full_key(error) or place
    _, resolved, refusal = _first_line(error).partition(OF_A_RESOLVER)
    if resolved:
        return f"{key}: {refusal}"
    setting = key.partition("[")[0]  # the list of an item
    kind = kind_at(Settings, setting) if setting else None
    reason = shown_text(_first_line(error), LINE_WIDTH)
    if isinstance(error, ValidationError) and kind is not None:
        return kind_problem(setting, error.value, kind)
    if (
        isinstance(error, ConfigKeyError | ConfigAttributeError)
        and kind_at(Settings, key.rpartition(".")[0]) is not None
    ):
        return f"{shown_text(key)} is not there yet; write +{shown_text(key)}=... to add it"
    if kind is not None:
        return f"{setting} must be {kind_text(kind)} ({reason})"
    return f"{key}: {reason}" if key else reason


def _cure_of(override: str) -> str:
    """Advice for a setting that Hydra cannot read: the setting itself in quotes, if it has none."""
    key, equals, value = override.partition("=")
    plain = override.isprintable() and len(override) <= LONGEST_EXAMPLE and not {*"'\"\\"} & {*override}
    shown = f"\"{key}='{value}'\"" if plain and equals and value else EXAMPLE
    return f"{LETTERS if not (override.isascii() and override.isprintable()) else QUOTES}{shown}"


def _first_line(error: BaseException) -> str:
    lines = str(error).strip().splitlines()
    return lines[0].strip() if lines else type(error).__name__


def _full_key(error: OmegaConfBaseException) -> str:
    return str(getattr(error, "full_key", None) or "")
