"""One small plan and its files, shared by the suites of the formats."""

from __future__ import annotations

from dataclasses import replace

import pytest
from numpy.random import SeedSequence

import pareto_ltl
from exported_plans import EXPORTS, SMALL, Flown, settings_named
from pareto_ltl_apps.exports.exported import exported_plan
from pareto_ltl_apps.exports.formats import write_exports


@pytest.fixture(scope="session")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Flown:
    result = pareto_ltl.plan("phi1", "F(a & F b & F c)", **SMALL)
    exported = exported_plan(settings_named("phi1"), result.problem, result.plan, SeedSequence(5))
    exported = replace(exported, name="phi1 <&>")  # signs that XML quotes
    folder = tmp_path_factory.mktemp("exported")
    write_exports(exported, EXPORTS.formats, folder)
    return Flown(result, exported, folder)
