"""Turns a composed configuration into :class:`Settings`; what is wrong in it is one line."""

from __future__ import annotations

import copy
import re
import sys
from typing import Any

from hydra.core.config_loader import ConfigLoader
from hydra.core.override_parser.types import ChoiceSweep, Override, QuotedString
from hydra.errors import HydraException, MissingConfigException, OverrideParseException
from omegaconf import DictConfig, OmegaConf, open_dict
from omegaconf.errors import (
    ConfigAttributeError,
    ConfigKeyError,
    MissingMandatoryValue,
    OmegaConfBaseException,
    ValidationError,
)

from careful_io.error_lines import one_line
from careful_io.messages import shown_text, shown_value
from pareto_ltl import Settings
from pareto_ltl.support.errors import ConfigError
from pareto_ltl_apps.cli.output import EXPECTED_ERRORS

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
GROUPS_WITHOUT_SECTION = ("experiment", "sweep")  # groups without a section of the settings


def settings_from(config: DictConfig) -> Settings:
    """The composed configuration as settings, with types and ranges checked; ``config`` is not changed."""
    if "hydra" in config:
        config = copy.deepcopy(config)
        with open_dict(config):
            del config["hydra"]
    values: Any = OmegaConf.to_container(config, resolve=True, throw_on_missing=True)
    return Settings.of_values(values)


def refuse_unknown_key(override: Override, loader: ConfigLoader) -> None:
    """Raise ConfigError for a key that is neither a setting nor a group, with the closest one that exists."""
    key = override.key_or_group
    if key == "hydra" or override.is_hydra_override():
        return
    _refuse_huge_number(key, None if override.is_sweep_override() else override.value())
    if "." not in key and (choices := loader.get_group_options(key)):  # 10 ms, and no group has a dot
        _refuse_odd_choice(override, choices)
        return
    known, section = Settings.by_key(), ""
    for part in key.split("."):
        if section and not known[section[:-1]].is_section:
            return  # inside a mapping or a list: values are checked when they are merged
        if section + part not in known:
            names = [one.rpartition(".")[2] for one in known if one.rpartition(".")[0] == section[:-1]]
            groups = [] if section else [g for g in GROUPS_WITHOUT_SECTION if loader.get_group_options(g)]
            raise Settings.unknown(section, part, [*names, *groups])
        section = f"{section}{part}."


def _refuse_huge_number(key: str, value: Any) -> None:
    """Raise ConfigError for an integer too large for a float: OmegaConf raises OverflowError for it."""
    if isinstance(value, list | dict):
        for item in value.values() if isinstance(value, dict) else value:
            _refuse_huge_number(key, item)
    elif isinstance(value, int) and abs(value) > sys.float_info.max:
        raise ConfigError(
            f"{key} has a number with {len(hex(value)) * 6 // 5} digits, which is too many for a setting"
        )


def _refuse_odd_choice(override: Override, choices: list[str]) -> None:
    """Raise ConfigError for a group that is set to a number or to null, which Hydra does not expect."""
    value = override.value()
    if override.is_delete() or (override.is_sweep_override() and not isinstance(value, ChoiceSweep)):
        return
    names = ", ".join(choices)
    for one in value.list if isinstance(value, ChoiceSweep) else [value]:
        if not isinstance(one, str | list | QuotedString):
            key = override.key_or_group
            raise ConfigError(f"{key} must be one of {names} (a choice), got {shown_value(one)}")


# --- errors of Hydra and OmegaConf in one line ------------------------------------------------


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
    key = str(getattr(error, "full_key", None) or place)
    _, resolved, refusal = _first_line(error).partition(OF_A_RESOLVER)
    if resolved:
        return f"{key}: {refusal}"
    setting = key.partition("[")[0]  # the list of an item
    known = Settings.by_key().get(setting)
    reason = shown_text(_first_line(error), LINE_WIDTH)
    if isinstance(error, ValidationError) and known is not None:
        return known.problem(error.value)
    if isinstance(error, ConfigKeyError | ConfigAttributeError) and key.rpartition(".")[0] in {
        "",
        *Settings.by_key(),
    }:
        return f"{shown_text(key)} is not there yet; write +{shown_text(key)}=... to add it"
    if known is not None:
        return f"{setting} must be {known.kind_text} ({reason})"
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
