"""The settings: each has a meaning, and what is out of range is refused in one line."""

from __future__ import annotations

import math
import pickle
from collections.abc import Iterator
from dataclasses import asdict, fields, is_dataclass
from typing import Any

import pytest
import yaml
from omegaconf import OmegaConf

from declared_settings import CheckedSettings, Declaration, declarations
from declared_settings.declarations import interval_ends
from pareto_ltl.settings import (
    PRESETS,
    FidelityConfig,
    RandomSceneConfig,
    RobotConfig,
    SceneConfig,
    SelectionConfig,
    Settings,
    SmoothingConfig,
    WindConfig,
    preset,
)
from pareto_ltl.support.errors import ConfigError
from pareto_ltl.support.resources import CONF, resource_folder
from pareto_ltl_apps.formats.settings import IngestConfig
from pareto_ltl_apps.studies.settings import HindcastConfig


def sections(section: CheckedSettings) -> Iterator[CheckedSettings]:
    yield section
    for item in fields(section):  # type: ignore[arg-type]
        if is_dataclass(inner := getattr(section, item.name)):
            yield from sections(inner)  # type: ignore[arg-type]


ALL = list(sections(Settings()))
DECLARED = [
    pytest.param(section, item.name, declared, id=f"{section.section}.{item.name}".lstrip("."))
    for section in ALL
    for item, declared in declarations(section)
]
RANGED = [case for case in DECLARED if case.values[2].range_text() and not case.values[2].built_in]  # type: ignore[union-attr]


def made_with(section: CheckedSettings, name: str, value: Any) -> CheckedSettings:
    listed = isinstance(getattr(section, name), list)
    return type(section)(**{name: [value] if listed else value})


def test_every_setting_is_declared_or_a_section() -> None:
    for section in ALL:
        declared = {item.name for item, _ in declarations(section)}
        for item in fields(section):  # type: ignore[arg-type]
            assert item.name in declared or is_dataclass(getattr(section, item.name)), (section, item.name)


def test_a_section_knows_the_key_under_which_it_stands() -> None:
    for item in fields(Settings):
        inner = getattr(Settings(), item.name)
        assert not is_dataclass(inner) or inner.section == item.name  # type: ignore[attr-defined]
    assert Settings().scene.random.section == "scene.random"


@pytest.mark.parametrize(("section", "name", "declared"), DECLARED)
def test_every_setting_says_what_it_means(section: Any, name: str, declared: Declaration) -> None:
    assert declared.meaning
    assert not declared.meaning.endswith(".")
    assert "\n" not in declared.meaning


@pytest.mark.parametrize(
    ("section", "name", "declared"), [case for case in RANGED if not case.values[2].allows(-1)]
)
def test_a_negative_number_is_refused(section: Any, name: str, declared: Declaration) -> None:
    key = f"{section.section}.{name}".lstrip(".")
    with pytest.raises(ConfigError) as caught:
        made_with(section, name, -1)
    assert str(caught.value) == f"{key} must {declared.demand()}, got -1"


@pytest.mark.parametrize(("section", "name", "declared"), RANGED)
def test_the_ends_of_a_range_are_in_it_or_out_as_declared(
    section: Any, name: str, declared: Declaration
) -> None:
    for end, bracket in zip(
        interval_ends(declared.within), (declared.within[0], declared.within[-1]), strict=True
    ):
        assert declared.allows(end) == (bracket in "[]")


@pytest.mark.parametrize(
    ("section", "name", "declared"),
    [case for case in DECLARED if case.values[2].built_in],  # type: ignore[union-attr]
)
def test_a_word_that_is_no_choice_is_refused_with_the_choices(
    section: Any, name: str, declared: Declaration
) -> None:
    with pytest.raises(ConfigError) as caught:
        made_with(section, name, "elsewhere")
    listed = ", ".join(declared.built_in)
    assert str(caught.value) == f"{section.section}.{name} must be one of {listed}; got 'elsewhere'"


def test_nothing_given_is_allowed_where_it_is_the_default() -> None:
    assert Settings().planner.budget_seconds is None
    assert Settings().wind.rho is None


@pytest.mark.parametrize("weights", [[0.0, 0.0, 0.0], [1.0], []])
def test_weights_that_weigh_nothing_are_refused(weights: list[float]) -> None:
    with pytest.raises(ConfigError, match=r"selection\.weights must be three numbers >= 0, not all 0"):
        SelectionConfig(weights=weights)


@pytest.mark.parametrize(
    ("section", "changes", "line"),
    [
        (RandomSceneConfig, {"regions": 27}, "scene.random.regions must lie in [0, 26]"),
        (RandomSceneConfig, {"radius": [0.2, 0.1]}, "scene.random.radius must be [smallest, largest]"),
        (RandomSceneConfig, {"radius": [math.nan, 0.1]}, "scene.random.radius must lie between 0 and 0.5"),
        (SceneConfig, {"centre": [95.0, 0.0]}, "scene.centre must be [latitude, longitude]"),
        (RobotConfig, {"a": [[1.0, math.nan], [0, 1]]}, "robot.a must be a 2 x 2 matrix"),
        (RobotConfig, {"b": [[1, 2], [2, 4]]}, "robot.b must be invertible"),
        (
            RobotConfig,
            {"u_min": 31.0},
            "robot.u_min = 31 m/s is above robot.u_max = 30 m/s: lower the first",
        ),
        (RobotConfig, {"u_min": -1.0}, "robot.u_min must lie in [0, 10000]"),
        (WindConfig, {"source": "csv"}, "wind.path is missing: wind.source=csv"),
        (SmoothingConfig, {"weights": []}, "smoothing.weights is empty"),
        (IngestConfig, {"area": [[1.0]]}, "ingest.area must be a list of [longitude, latitude]"),
        (HindcastConfig, {"side": [1.0, math.inf]}, "hindcast.side must lie in [0, 1e7] [m]"),
        (HindcastConfig, {"side": [0.0, 1.0]}, "hindcast.side must be positive [m]"),
        (HindcastConfig, {"obstacles": [3]}, "hindcast.obstacles must be [least, most]"),
    ],
)
def test_values_that_do_not_fit_together_are_refused(section: Any, changes: Any, line: str) -> None:
    with pytest.raises(ConfigError) as caught:
        section(**changes)
    assert str(caught.value).startswith(line)


def test_the_files_of_conf_fidelity_are_the_presets() -> None:
    assert CONF.names("fidelity") == sorted(PRESETS)
    for name in PRESETS:
        written = yaml.safe_load((resource_folder("conf") / "fidelity" / f"{name}.yaml").read_text())
        assert written == {"name": name, **PRESETS[name]}
        assert preset(name) == FidelityConfig(**written)
        assert preset(name).label == name
    assert FidelityConfig(refine="none").label == "full with refine=none"


def test_the_schema_gives_the_settings_back() -> None:
    back = OmegaConf.to_object(OmegaConf.structured(Settings))
    assert back == Settings()
    assert pickle.loads(pickle.dumps(back)) == Settings()


def test_two_settings_share_no_list() -> None:
    one, two = Settings(), Settings()
    one.robot.a[0][0] = 2.0
    one.hindcast.area[0][0] = 0.0
    assert two == Settings()
    assert asdict(two) != asdict(one)
