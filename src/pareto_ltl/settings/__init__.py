"""Settings of every stage, checked on construction.

The files of ``conf/`` hold values; these dataclasses are their schema. Each setting carries its unit, range
and meaning (:func:`declared_settings.setting`). ``cli`` turns a composed configuration into a
:class:`Settings`; no other package imports Hydra. Every error names the key as a user types it.

``Settings`` has the sections of the planner and those that applications and other packages add. Their modules
import this one, so it is put together when it is first asked for.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from pareto_ltl.settings.fidelity import PRESETS as PRESETS
from pareto_ltl.settings.fidelity import FidelityConfig as FidelityConfig
from pareto_ltl.settings.fidelity import preset as preset
from pareto_ltl.settings.mission import MissionConfig as MissionConfig
from pareto_ltl.settings.mission import PowerConfig as PowerConfig
from pareto_ltl.settings.mission import RandomSceneConfig as RandomSceneConfig
from pareto_ltl.settings.mission import RobotConfig as RobotConfig
from pareto_ltl.settings.mission import SceneConfig as SceneConfig
from pareto_ltl.settings.planner import DeploymentConfig as DeploymentConfig
from pareto_ltl.settings.planner import LogicConfig as LogicConfig
from pareto_ltl.settings.planner import PipelineConfig as PipelineConfig
from pareto_ltl.settings.planner import PlannerConfig as PlannerConfig
from pareto_ltl.settings.planner import RefineConfig as RefineConfig
from pareto_ltl.settings.planner import SelectionConfig as SelectionConfig
from pareto_ltl.settings.planner import SmoothingConfig as SmoothingConfig
from pareto_ltl.settings.wind import WindConfig as WindConfig

if TYPE_CHECKING:
    from pareto_ltl.settings.all_sections import Settings as Settings
else:

    def __getattr__(name: str) -> type:
        if name != "Settings":
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        from pareto_ltl.settings.all_sections import Settings

        return Settings
