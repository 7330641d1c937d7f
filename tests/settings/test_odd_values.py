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

from pareto_ltl.cli.error_lines import CONFIGURATION_ERRORS, explain_error
from pareto_ltl.cli.setting_keys import settings_from
from pareto_ltl.settings import Settings
from pareto_ltl.settings.building import build_settings
from pareto_ltl.settings.checks import check_folder_name, check_time
from pareto_ltl.settings.kinds import field_kinds, fits_kind, kind_problem
from pareto_ltl.support.errors import ConfigError

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
OTHERS = [
    None,
    "",
    "many",
    "nan",
    True,
    [],
    [[]],
    [None],
    ["x"],
    [float("nan")],
    [1e300],
    {},
    {"x": 1},
    {"x": None},
]
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


CASES = [pytest.param(case, id=case.key) for case in cases()]


@cache
def schema() -> DictConfig:
    """All settings with their defaults; to make them takes six times as long as to copy them."""
    return OmegaConf.structured(Settings)


def typed(case: Case, value: Any) -> Settings:
    """What the command line makes of ``KEY=VALUE``, without Hydra's choices."""
    config = copy.deepcopy(schema())
    try:
        OmegaConf.update(config, case.key, value, merge=True)
    except OmegaConfBaseException as error:
        raise ConfigCompositionException(f"Error merging override {case.key}=...") from error
    return settings_from(config)


def built(case: Case, value: Any) -> Settings:
    """What Python makes of it."""
    for name in reversed(case.path):
        value = {name: value}
    return build_settings(value)


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


@pytest.mark.parametrize("case", CASES)
def test_an_odd_value_is_refused_in_one_line_or_has_the_type_of_the_setting(case: Case) -> None:
    for value in ODD:
        refuses(case, value)


def kinds_of(*wanted: Any) -> list[Any]:
    return [case for case in CASES if case.values[0].kind in wanted]  # type: ignore[union-attr]


@pytest.mark.parametrize("case", kinds_of(int, float, float | None))
@pytest.mark.parametrize(
    "value",
    [v for v in NUMBERS if v not in (0, -1, 1e-300)],
    ids=lambda v: f"{v!r:.12}" if not isinstance(v, int) else f"{v.bit_length()} bits",
)
def test_a_number_that_is_none_or_has_no_bound_is_refused(case: Case, value: Any) -> None:
    assert refuses(case, value)


@pytest.mark.parametrize("case", kinds_of(list[int], list[float], list[float] | None))
@pytest.mark.parametrize("value", [float("nan"), float("inf"), 1e300, -1e300, None, "x", []])
def test_a_list_with_such_a_number_is_refused(case: Case, value: Any) -> None:
    assert refuses(case, [value])


@pytest.mark.parametrize("case", kinds_of(list[int], list[float], list[float] | None))
def test_a_list_of_numbers_is_not_empty(case: Case) -> None:
    assert refuses(case, [])


@pytest.mark.parametrize("case", [case for case in CASES if not fits_kind(None, case.values[0].kind)])  # type: ignore[union-attr]
def test_null_is_refused_where_it_means_nothing(case: Case) -> None:
    if case.kind is not Any:
        assert refuses(case, None)


@pytest.mark.parametrize("case", kinds_of(int, float, bool, list[int], list[float], list[str]))
@pytest.mark.parametrize("value", ["", "many", [[]], {}, {"x": 1}])
def test_a_value_of_another_type_is_refused(case: Case, value: Any) -> None:
    assert refuses(case, value)


@pytest.mark.parametrize("key", ["mission.start_time", "ingest.first", "ingest.last"])
@pytest.mark.parametrize(
    "text", ["yesterday", "", "2018-13-01", "0001-01-01", "9999-12-31T23:59:59", "x" * 10_000]
)
def test_a_text_that_is_no_time_is_refused(key: str, text: str) -> None:
    section, _, name = key.partition(".")
    with pytest.raises(ConfigError, match=key) as caught:
        build_settings({section: {name: text}})
    assert len(str(caught.value)) < 200


def test_a_time_is_taken_with_an_offset_or_without() -> None:
    for text in ("2018-10-09T18:00:00Z", "2018-10-09 18:00", "20181009T180000+02:00", None):
        check_time("key", text)


@pytest.mark.parametrize(
    "name", ["CON", "aux", "nul.txt", "Com1", "lpt9.tar.gz", "a.", "", "a/b", "..", "x" * 101, "é"]
)
def test_a_name_that_some_system_cannot_use_is_refused(name: str) -> None:
    with pytest.raises(ConfigError, match="name must") as caught:
        check_folder_name("name", name)
    assert len(str(caught.value)) < 250


@pytest.mark.parametrize("name", ["plan", "console", "a.b", "x" * 100, "7", "A-b_c"])
def test_a_name_that_every_system_can_use_is_taken(name: str) -> None:
    check_folder_name("name", name)


def test_a_whole_number_that_was_written_as_a_float_is_named_in_digits() -> None:
    assert (
        kind_problem("n", 1e7, int)
        == "n must be a whole number, got 10000000.0; write it in digits, 10000000"
    )
    assert kind_problem("n", 2.5, int) == "n must be a whole number, got 2.5"
