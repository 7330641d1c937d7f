"""All settings of a run: the sections of the planner, and those that installed packages add."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, Self, TypeVar

from flight_quantities.heights import FlownAir, Height
from flight_quantities.medium import WATER, Medium, medium_of
from pareto_ltl.settings.checks import (
    SEEDS,
    CheckedSettings,
    Setting,
    check_folder_name,
    setting,
    settings_below,
)
from pareto_ltl.settings.fidelity import LAWS, PRESETS, FidelityConfig, preset
from pareto_ltl.settings.heights import flight_air, flight_height
from pareto_ltl.settings.mission import MissionConfig, RobotConfig, SceneConfig
from pareto_ltl.settings.planner import (
    DeploymentConfig,
    LogicConfig,
    PipelineConfig,
    PlannerConfig,
    RefineConfig,
    SelectionConfig,
    SmoothingConfig,
)
from pareto_ltl.settings.wind import WindConfig, usual_level, wind_sources
from pareto_ltl.support.errors import ConfigError
from pareto_ltl.support.extensions import SETTINGS_GROUP, load_all

Section = TypeVar("Section", bound=CheckedSettings)


def _are_sections(table: Any) -> bool:
    return isinstance(table, tuple) and all(
        isinstance(kind, type) and issubclass(kind, CheckedSettings) for kind in table
    )


def _with_added_sections(own: type[Section]) -> type[Section]:
    """``own`` with a field for each section that installed packages add; before it is made a dataclass."""
    names, added = list(own.__annotations__), dict[str, type]()
    for table in load_all(SETTINGS_GROUP, _are_sections):
        place = len(names)
        for section in table:
            name = section.section
            if hasattr(own, name):
                raise ConfigError(
                    f"settings {name!r} of {section.__module__}: the name is taken; uninstall it"
                )
            place = names.index(section.after) + 1 if section.after else place
            names.insert(place, name)
            place += 1
            setattr(own, name, field(default_factory=section))
            added[name] = section
    own.__annotations__ = {name: added.get(name) or own.__annotations__[name] for name in names}
    return own


@dataclass
@_with_added_sections
class Settings(CheckedSettings):
    """All settings of a run, one section for each part of the program.

    ``settings[MyConfig]`` is the section of a type that another package adds.
    """

    name: str = setting("plan", "name of the run, and of the folder of its results")
    seed: int = setting(0, "seed of all random numbers except in random maps", SEEDS)
    fidelity: FidelityConfig = field(default_factory=FidelityConfig)
    scene: SceneConfig = field(default_factory=SceneConfig)
    mission: MissionConfig = field(default_factory=MissionConfig)
    robot: RobotConfig = field(default_factory=RobotConfig)
    wind: WindConfig = field(default_factory=WindConfig)
    logic: LogicConfig = field(default_factory=LogicConfig)
    planner: PlannerConfig = field(default_factory=PlannerConfig)
    smoothing: SmoothingConfig = field(default_factory=SmoothingConfig)
    refine: RefineConfig = field(default_factory=RefineConfig)
    selection: SelectionConfig = field(default_factory=SelectionConfig)
    deployment: DeploymentConfig = field(default_factory=DeploymentConfig)
    pipelines: PipelineConfig = field(default_factory=PipelineConfig)

    PRESETS, LAWS = PRESETS, LAWS  # names of presets with their values, of wind laws

    def check_combinations(self) -> None:
        """Reject a name that cannot be a folder and two heights; replace the level ``auto`` by its value."""
        check_folder_name("name", self.name)
        for section in self.sections():
            section.complete(self)
        if self.wind.level == "auto":  # the records of a run hold the level itself
            self.wind = replace(self.wind, level=usual_level(self.wind.source, self.robot.level))
        flight_air(self, flight_height(self))

    def __getitem__(self, kind: type[Section]) -> Section:
        """The section of the type ``kind``."""
        found: Section = getattr(self, kind.section)
        return found

    def sections(self) -> Iterator[CheckedSettings]:
        """All sections, in order."""
        values = (getattr(self, item.name) for item in fields(self))
        return (value for value in values if isinstance(value, CheckedSettings))

    def with_sections(self, *sections: CheckedSettings) -> Self:
        """These settings with other ``sections``."""
        changes: dict[str, Any] = {section.section: section for section in sections}
        return replace(self, **changes)

    def inert(self) -> Self:
        """Settings that open no connection and continue no other run; no result depends on these."""
        return self.with_sections(*(section.inert() for section in self.sections()))

    @property
    def border(self) -> str:
        """``wall`` if leaving the map is a failure, else ``open``; a map file may set it differently."""
        return self.fidelity.border if self.scene.border == "auto" else self.scene.border

    @classmethod
    def of(cls, sections: Mapping[str, Any]) -> Settings:
        """Settings of ``sections``: mappings of keys, names of choices in ``conf/``, or settings objects."""
        from pareto_ltl.settings.building import build_settings

        return build_settings(sections)

    @classmethod
    def of_values(cls, values: Mapping[str, Any]) -> Settings:
        """Settings of keys and values alone; each section is a mapping of its keys."""
        from pareto_ltl.settings.building import settings_of

        return settings_of(values)

    @classmethod
    def of_file(cls, path: Path, changes: Mapping[str, Any] | None = None) -> Settings:
        """The settings that a run wrote as ``config_resolved.yaml``, with ``changes`` by ``section.key``."""
        from pareto_ltl.settings.building import read_settings_file

        return read_settings_file(path, changes)

    @staticmethod
    def unknown(section: str, name: str, known: Iterable[str]) -> ConfigError:
        """The error for ``name`` in ``section`` (``"planner."``), with the closest of the ``known`` names."""
        from pareto_ltl.settings.building import unknown_setting

        return unknown_setting(section, name, known)

    @classmethod
    def by_key(cls) -> Mapping[str, Setting]:
        """All settings and sections by their keys, with type, unit, range and meaning."""
        return _settings_by_key()

    @staticmethod
    def of_section(name: str, value: Any) -> Any:
        """The section ``name`` of a mapping of its keys, or of the name of a choice in ``conf/``."""
        from pareto_ltl.settings.building import section_of

        return section_of(name, value)

    @staticmethod
    def preset(name: str) -> FidelityConfig:
        """The section ``fidelity`` of the preset ``name``: ``paper`` or ``full``."""
        return preset(name)

    def as_yaml(self) -> str:
        """Every setting, as YAML."""
        import yaml

        text: str = yaml.safe_dump(asdict(self), sort_keys=False, default_flow_style=None, width=110)
        return text

    @property
    def flight_height(self) -> Height:
        """The height of the flight."""
        return flight_height(self)

    def flight_air(self, height: Height | None = None) -> FlownAir | None:
        """The air at ``height``, by default the height of the flight; None in water."""
        return flight_air(self, flight_height(self) if height is None else height)

    @property
    def medium(self) -> Medium:
        """Water for a current, whose level may lack the word depth, and for a robot at a depth; else air."""
        kind = wind_sources().get(self.wind.source)
        current = kind is not None and kind.current
        return WATER if current else medium_of(self.robot.level, self.wind.level)


@lru_cache
def _settings_by_key() -> dict[str, Setting]:
    return {one.key: one for one in settings_below(Settings)}
