"""The sections of the settings that applications add, in their order."""

from __future__ import annotations

from pareto_ltl_apps.branching.settings import BranchConfig
from pareto_ltl_apps.exports.settings import ExportsConfig
from pareto_ltl_apps.formats.settings import IngestConfig
from pareto_ltl_apps.preflight.settings import LimitsConfig
from pareto_ltl_apps.studies.settings import (
    AblationConfig,
    CompareConfig,
    ConvergenceConfig,
    DepartureConfig,
    EvaluationConfig,
    ForecastTestConfig,
    HindcastConfig,
    LevelsConfig,
    ReplanningConfig,
    SitlConfig,
    SweepConfig,
)
from pareto_ltl_apps.view.settings import ReportConfig

SECTIONS = (
    ExportsConfig, ReportConfig, LimitsConfig, IngestConfig, EvaluationConfig, CompareConfig,
    ConvergenceConfig, AblationConfig, HindcastConfig, ForecastTestConfig, DepartureConfig, LevelsConfig,
    ReplanningConfig, SitlConfig, SweepConfig, BranchConfig,
)  # fmt: skip
