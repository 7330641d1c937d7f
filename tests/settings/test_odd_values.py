"""Every setting of every section, set to what nobody should set it to, as the command line and Python do.

The cases come from the declarations, so that a new setting is covered when it is written.
"""

from __future__ import annotations

import copy
import typing
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, is_dataclass
from functools import cache
from typing import Any

import pytest
from hydra.errors import ConfigCompositionException
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from declared_settings import field_kinds, fits_kind
from levels import AT_NIGHT
from pareto_ltl.settings import Settings
from pareto_ltl.support.errors import ConfigError
from pareto_ltl_apps.cli.setting_keys import CONFIGURATION_ERRORS, explain_error, settings_from

LONGEST_LINE = 400
NUMBERS = [
    float("nan"),
    float("inf"),
    float("-inf"),
    1e300,
    -1e300,
    1e-300,
    -1,
    0,
    10**30,
    -(10**30),
    10**200,
]
NO_NUMBERS = [[float("nan")], [float("inf")], [1e300], [-1e300], [None], ["x"], [[]]]  # nor lists of them
NO_VALUES = ["", "many", [[]], {}, {"x": 1}]
OTHERS = [*NO_VALUES, *NO_NUMBERS, None, "nan", True, [], {"x": None}]
TEXTS = ["x" * 100_000, "\x00", "a\nb", "\u202e", "CON", "yesterday"]
ODD = [*NUMBERS, *OTHERS, *TEXTS]


@dataclass(frozen=True)
class Case:
    """One setting."""

    path: tuple[str, ...]
    kind: Any

    @property
    def key(self) -> str:
        return ".".join(self.path)

    def read(self, settings: Any) -> Any:
        """The value in ``settings``."""
        for name in self.path:
            settings = getattr(settings, name)
        return settings


def cases(schema: type = Settings, path: tuple[str, ...] = ()) -> Iterator[Case]:
    for item in fields(schema):  # type: ignore[arg-type]
        kind = field_kinds(schema)[item.name]
        if is_dataclass(kind):
            yield from cases(typing.cast(type, kind), (*path, item.name))
        yield Case((*path, item.name), kind)


CASES = [pytest.param(case, place, id=case.key) for place, case in enumerate(cases())]
EVERY = 1 if AT_NIGHT else 3  # of three neighbours, which often have one type, each is set to another third
pytestmark = pytest.mark.no_cover  # tracing takes a minute, and other tests run the same lines


@cache
def section_alone(name: str) -> DictConfig:
    """The section, or the setting outside of sections, ``name`` of all settings, with its defaults."""
    return OmegaConf.masked_copy(OmegaConf.structured(Settings), name)


def typed(case: Case, value: Any) -> Settings:
    """What the command line makes of ``KEY=VALUE``, without Hydra's choices."""
    config = copy.deepcopy(section_alone(case.path[0]))  # to copy all sections takes twenty times as long
    try:
        OmegaConf.update(config, case.key, value, merge=True)
        return settings_from(config)
    except OmegaConfBaseException as error:
        raise ConfigCompositionException(f"Error merging override {case.key}=...") from error


def built(case: Case, value: Any) -> Settings:
    """What Python makes of it."""
    for name in reversed(case.path):
        value = {name: value}
    return Settings.of(value)


def refusal(make: Callable[[Case, Any], Settings], case: Case, value: Any) -> str | None:
    """The message for ``value``, None if it is taken; then it has the type of the setting."""
    try:
        settings = make(case, value)
    except CONFIGURATION_ERRORS as error:
        return explain_error(error)
    if not is_dataclass(case.kind):
        assert fits_kind(case.read(settings), case.kind)
    return None


def refuses(case: Case, value: Any) -> bool:
    """Whether both ways refuse ``value``, each in one short line that begins with the key."""
    lines = [refusal(make, case, value) for make in (typed, built)]
    for line in lines:
        if line is not None:
            assert "\n" not in line
            assert line.isprintable()
            assert len(line) < LONGEST_LINE
            assert case.key in line
    return all(line is not None for line in lines)


def must_refuse(kind: Any, value: Any) -> bool:
    """Whether no setting of ``kind`` can be ``value``."""
    if kind in (int, float, float | None) and type(value) in (int, float):
        return value not in (0, -1, 1e-300)
    if kind in (list[int], list[float], list[float] | None) and value in ([], *NO_NUMBERS):
        return True
    if kind in (int, float, bool, list[int], list[float], list[str]) and value in NO_VALUES:
        return True
    return value is None and kind is not Any and not fits_kind(None, kind)


@pytest.mark.parametrize(("case", "place"), CASES)
def test_an_odd_value_is_refused_in_one_line_or_has_the_type_of_the_setting(case: Case, place: int) -> None:
    """What means nothing for the type is refused: no number, no bound, nothing, another type.

    An empty list is taken where it is the default.
    """
    usual = case.read(Settings())
    taken = [value for value in ODD[place % EVERY :: EVERY] if not refuses(case, value) and value != usual]
    assert [value for value in taken if must_refuse(case.kind, value)] == []


def test_odd_values_leave_the_defaults_as_they_were() -> None:
    """Cases share the sections, so a case that changed one would change what the others test."""
    for case in cases():
        refuses(case, -1)
    for name, values in OmegaConf.to_container(OmegaConf.structured(Settings)).items():
        assert OmegaConf.to_container(section_alone(name)) == {name: values}


@pytest.mark.parametrize("key", ["mission.start_time", "ingest.first", "ingest.last"])
@pytest.mark.parametrize(
    "text", ["yesterday", "", "2018-13-01", "0001-01-01", "9999-12-31T23:59:59", "x" * 10_000]
)
def test_a_text_that_is_no_time_is_refused(key: str, text: str) -> None:
    section, _, name = key.partition(".")
    with pytest.raises(ConfigError, match=key) as caught:
        Settings.of({section: {name: text}})
    assert len(str(caught.value)) < 200
