"""Sizes that cannot fit are refused before anything is made, each with the setting to change."""

from __future__ import annotations

from typing import Any

import pytest

from careful_io import machine
from pareto_ltl.extend import Record
from pareto_ltl.run.pipeline import check_sizes, known_stages
from pareto_ltl.settings import Settings
from pareto_ltl.support.errors import ConfigError
from pareto_ltl_apps.studies.kinds import STUDIES as STUDY_KINDS

STUDIES = [kind.name for kind in STUDY_KINDS.values() if kind.many_missions]
PLAN = ("forest", "front", "plan", "deployment")


@pytest.fixture(autouse=True)
def _two_gigabytes_free(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine, "available_memory", lambda: 2e9)


def listed(names: tuple[str, ...]) -> list[Record[Any]]:
    return [stage for stage in known_stages() if stage.name in names or stage.stage in names]


@pytest.mark.parametrize(
    ("sections", "stages", "words"),
    [
        (
            {"planner": {"n_max": 10_000_000}},
            PLAN,
            ("planner.n_max=10000000 needs 15 GB", "at most 1333333 fits"),
        ),
        ({"deployment": {"runs": 10**8}}, PLAN, ("deployment.runs=100000000 needs", "at most 15625000 fits")),
        (
            {"planner": {"n_max": 10**6}, "evaluation": {"jobs": 4}},
            ("comparison",),
            ("in each of 4 processes (evaluation.jobs)", "333333 fits"),
        ),
        ({"convergence": {"sizes": [10, 10**8]}}, ("convergence",), ("convergence.sizes=100000000",)),
    ],
)
def test_a_size_that_cannot_fit_is_refused(
    sections: dict[str, Any], stages: tuple[str, ...], words: tuple[str, ...]
) -> None:
    with pytest.raises(ConfigError) as caught:
        check_sizes(Settings.of(sections), listed(stages))
    assert not [word for word in words if word not in str(caught.value)], str(caught.value)


@pytest.mark.parametrize(
    "stages",
    [PLAN, *((name,) for name in STUDIES)],
)
def test_the_defaults_fit(stages: tuple[str, ...]) -> None:
    check_sizes(Settings(), listed(stages))


def test_a_setting_that_no_stage_uses_is_not_looked_at() -> None:
    check_sizes(Settings.of({"planner": {"n_max": 10**8}}), listed(("readings", "table")))
