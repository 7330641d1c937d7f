"""How a run ended, in words."""

from __future__ import annotations

from pathlib import Path

import pytest

from careful_io.locks import hold_lock
from pareto_ltl.support.run_status import RUN_LOCK, ending_text


@pytest.mark.parametrize("held", [False, True])
@pytest.mark.parametrize(
    ("status", "words"),
    [
        ("running", "its run was killed; plan again"),
        ("stopped", "its run was stopped"),
        ("failed", "its run failed, run.log says why"),
        ("infeasible", "its run found no plan"),
        ("odd", "its run ended as 'odd'"),
    ],
)
def test_a_run_is_at_work_only_while_its_lock_is_held(
    status: str, words: str, held: bool, tmp_path: Path
) -> None:
    if not held:
        assert ending_text(tmp_path, status).startswith(words)
        return
    with hold_lock(tmp_path / RUN_LOCK):
        told = ending_text(tmp_path, status)
    assert told.startswith("its run is still at work" if status == "running" else words)
