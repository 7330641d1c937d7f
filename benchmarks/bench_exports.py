"""Export budget: a plan of phi2 in all formats, with its corridors, within 0.5 s.

python -m pytest benchmarks/bench_exports.py
"""

from __future__ import annotations

from dataclasses import replace

import pytest
from numpy.random import SeedSequence

import pareto_ltl
from pareto_ltl_apps.exports.exported import exported_plan
from pareto_ltl_apps.exports.formats import write_exports
from pareto_ltl_apps.exports.kinds import FORMATS
from pareto_ltl_apps.exports.settings import ExportsConfig
from problems import MISSIONS

ALL = ExportsConfig(formats=list(FORMATS), altitude_lower=300.0, altitude_upper=400.0)


@pytest.fixture(scope="module")
def planned():
    """A plan of phi2 in the winds of the sample with default settings."""
    return pareto_ltl.plan("phi2", MISSIONS["phi2"], robot={"dt": 1800.0})


def arguments_of(planned):
    """Those of ``exported_plan``, for all formats."""
    return replace(planned.settings, exports=ALL), planned.problem, planned.plan, SeedSequence(1)


def test_all_formats_of_a_plan(benchmark, planned, tmp_path):
    def export():
        return write_exports(exported_plan(*arguments_of(planned)), ALL.formats, tmp_path)

    benchmark.extra_info["budget"] = 0.5
    paths = benchmark.pedantic(export, rounds=10, warmup_rounds=1)
    assert len(paths) == len(FORMATS)


def test_what_is_exported_of_a_plan(benchmark, planned):
    """Navigation log, corridors from 2,000 flights, and 2,000 flights that hold their course."""
    benchmark.extra_info["budget"] = 0.25
    exported = benchmark.pedantic(exported_plan, arguments_of(planned), rounds=10, warmup_rounds=1)
    assert exported.corridor.runs == 2000
