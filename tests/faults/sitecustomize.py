"""On ``PYTHONPATH`` of a test's processes: a stage ``trouble`` that fails as the folder ``$TROUBLE`` asks.

``kill_3`` there: the job of seed 3 kills itself, once. ``kill_always_3``: every time. ``full_3``: nothing
can be written any more. ``none_3``: there is no plan. ``slow``: every job takes half a second more.
"""

from __future__ import annotations

import errno
import os
import signal
import time
from pathlib import Path
from typing import Any


def trouble(settings: Any, directory: Path) -> int:
    from pareto_ltl.support import files
    from pareto_ltl.support.errors import InfeasibleError

    asked = Path(os.environ["TROUBLE"])
    with (asked / "begun.txt").open("a") as file:
        file.write(f"{settings.seed}\n")
    if (asked / "slow").exists():
        time.sleep(0.5)
    once = asked / f"kill_{settings.seed}"
    if once.exists() or (asked / f"kill_always_{settings.seed}").exists():
        once.unlink(missing_ok=True)
        os.kill(os.getpid(), signal.SIGKILL)
    if (asked / f"none_{settings.seed}").exists():
        raise InfeasibleError("no way from a to b; raise planner.n_max")
    real = files.write_bytes

    def write_bytes(path: Path, data: bytes) -> None:
        if path.parent == directory and (asked / f"full_{settings.seed}").exists():
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        real(path, data)

    files.write_bytes = write_bytes
    return settings.seed


if "TROUBLE" in os.environ:
    from pareto_ltl.run import stages

    stages.STAGES["trouble"] = trouble
