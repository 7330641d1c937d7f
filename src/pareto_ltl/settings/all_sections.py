"""All settings of a run: the sections of the planner, and those that installed packages add."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

from declared_settings import SEEDS, AllSettings, check_folder_name, setting, with_added_sections
from flight_quantities.heights import FlownAir, Height
from flight_quantities.medium import WATER, Medium, medium_of
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
from pareto_ltl.support import extensions
from pareto_ltl.support.resources import CONF


@dataclass
@with_added_sections(extensions.SETTINGS)
class Settings(AllSettings):
    """All settings of a run, one section for each part of the program.

    ``settings[MyConfig]`` is the section of a type that another package adds.
    """

    choices = CONF

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

    @property
    def border(self) -> str:
        """``wall`` if leaving the map is a failure, else ``open``; a map file may set it differently."""
        return self.fidelity.border if self.scene.border == "auto" else self.scene.border

    @property
    def search_seed(self) -> int:
        """Seed of the search for paths: ``refine.seed``; without sampled refinement the seed of the run."""
        own = self.refine.seed
        return self.seed if own is None or self.fidelity.refine != "sampled" else own

    def with_seed(self, seed: int) -> Settings:
        """The same with another seed, which the search has, too."""
        return replace(self, seed=seed, refine=replace(self.refine, seed=None))

    @classmethod
    def values_of(cls, section: str, value: Any) -> Any:
        """The keys and values of a choice or a mapping.

        Values of ``fidelity`` override its preset, values of ``wind`` the choice of its source, which has
        other bounds for a current than for a wind.
        """
        if section == "wind" and isinstance(value, Mapping):
            source = str(value.get("source"))
            return CONF.values(section, source) | dict(value) if source in CONF.names("wind") else value
        if section == "fidelity" and isinstance(value, Mapping):
            name = str(value.get("name", FidelityConfig.name))
            # A name that is not a preset is refused later, when all values are checked.
            base = preset(name) if name in PRESETS else FidelityConfig()
            return {f.name: getattr(base, f.name) for f in fields(base)} | dict(value)
        return super().values_of(section, value)

    @staticmethod
    def preset(name: str) -> FidelityConfig:
        """The section ``fidelity`` of the preset ``name``: ``paper`` or ``full``."""
        return preset(name)

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
