"""The stages of the application: those of a plan, those of the studies, and those of other packages."""

from __future__ import annotations

from pareto_ltl.run.stage_table import StageTable, with_extension_stages
from pareto_ltl.run.stages import PLAN_STAGES
from pareto_ltl.settings import Settings
from pareto_ltl.studies.stages import STUDY_STAGES


def application_stages(settings: Settings) -> StageTable:
    """The table of stages for a run with ``settings``; it loads those of other packages that it lists."""
    return with_extension_stages((*PLAN_STAGES, *STUDY_STAGES), settings.pipelines.stages)
