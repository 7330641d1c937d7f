"""One small result with its page, shared by the suites of the page."""

from __future__ import annotations

from pathlib import Path

import pytest

import pareto_ltl
from exported_plans import SMALL
from pareto_ltl.run.results import load_results
from pareto_ltl_apps.view.records import ShownRun
from pareto_ltl_apps.view.showing import shown_results
from shared import made_once

PAGE_ONLY = {"figures": False, "page": True}


@pytest.fixture(scope="session")
def page_result(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A results directory with ``report.html``."""
    sections = SMALL | {"deployment": {"runs": 120}, "report": PAGE_ONLY, "exports": {"flights": 300}}
    # The front of this small search has several points without errors of the robot, with this seed of a few.
    sections["robot"] = SMALL["robot"] | dict.fromkeys(("airspeed_sd", "heading_sd", "clock_sd"))

    def make(place: Path) -> None:
        pareto_ltl.plan("phi1", "F(a & F b & F c)", out=place / "result", seed=1, **sections)

    return made_once(tmp_path_factory, "page", make) / "result"


@pytest.fixture(scope="session")
def shown(page_result: Path) -> ShownRun:
    """The data from which the page is made."""
    return shown_results(load_results(page_result))
