"""How a run ended, in words: ``run.json`` of a killed run still has the status ``running``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from careful_io.locks import is_held
from careful_io.messages import shown_value

RUN_LOCK, RUN_LOG = "run.lock", "run.log"
ANSWERS = ("ok", "infeasible")  # a mission without a plan is an answer too


def ending_text(directory: Path, status: Any) -> str:
    """``its run was killed`` or the like, with what to do; ``status`` is the status in ``run.json``."""
    if status == "running" and is_held(directory / RUN_LOCK):
        return "its run is still at work; wait for its end"
    texts = {
        "running": "its run was killed; plan again with the same command",
        "stopped": "its run was stopped before its end; plan again with the same command",
        "failed": "its run failed, run.log says why; plan again",
        "infeasible": "its run found no plan, run.json says why",
    }
    return texts.get(status) or f"its run ended as {shown_value(status)}"
