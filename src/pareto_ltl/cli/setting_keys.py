"""Turns a composed configuration into :class:`Settings`; raises ConfigError for keys that do not exist."""

from __future__ import annotations

import copy
import sys
import typing
from dataclasses import is_dataclass
from typing import Any

from hydra.core.config_loader import ConfigLoader
from hydra.core.override_parser.types import ChoiceSweep, Override, QuotedString
from omegaconf import DictConfig, OmegaConf, open_dict

from pareto_ltl.settings import Settings
from pareto_ltl.settings.building import settings_of, unknown_setting
from pareto_ltl.settings.checks import field_kinds
from pareto_ltl.support.errors import ConfigError
from pareto_ltl.support.messages import shown_value

GROUPS_WITHOUT_SECTION = ("experiment", "sweep")  # groups without a section of the settings


def settings_from(config: DictConfig) -> Settings:
    """The composed configuration as settings, with types and ranges checked; ``config`` is not changed."""
    if "hydra" in config:
        config = copy.deepcopy(config)
        with open_dict(config):
            del config["hydra"]
    values: Any = OmegaConf.to_container(config, resolve=True, throw_on_missing=True)
    return settings_of(values)


def refuse_unknown_key(override: Override, loader: ConfigLoader) -> None:
    """Raise ConfigError for a key that is neither a setting nor a group, with the closest one that exists."""
    key = override.key_or_group
    if key == "hydra" or override.is_hydra_override():
        return
    _refuse_huge_number(key, None if override.is_sweep_override() else override.value())
    if "." not in key and (choices := loader.get_group_options(key)):  # 10 ms, and no group has a dot
        _refuse_odd_choice(override, choices)
        return
    known: Any = Settings
    section = ""
    for part in key.split("."):
        if not is_dataclass(known):
            return  # inside a mapping or a list: values are checked when they are merged
        types = field_kinds(typing.cast(type, known))
        if part not in types:
            groups = [] if section else [g for g in GROUPS_WITHOUT_SECTION if loader.get_group_options(g)]
            raise unknown_setting(section, part, [*types, *groups])
        known, section = types[part], f"{section}{part}."


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
