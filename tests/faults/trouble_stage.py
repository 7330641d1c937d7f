"""A stage ``trouble`` that fails in the way that the files in the folder ``$TROUBLE`` name.

This folder is on ``PYTHONPATH`` of a test's processes; the metadata beside this file make the stage known.

``kill_3`` there: the job of seed 3 kills itself, once. ``kill_always_3``: every time. ``full_3``: nothing
can be written any more. ``none_3``: there is no plan. ``hold_3``: the job waits until this file is gone.
``slow_3``: every file takes half a second.
"""

from __future__ import annotations

import errno
import os
import signal
import time
from pathlib import Path

from pareto_ltl import Run
from pareto_ltl.extend import record


@record()
def trouble(run: Run) -> int:
    """The seed, unless a file in the folder ``$TROUBLE`` names a fault."""
    from careful_io import files
    from pareto_ltl.support.errors import InfeasibleError

    settings, directory = run.settings, run.directory
    asked = Path(os.environ["TROUBLE"])
    real = files.write_bytes

    def write_bytes(path: Path, data: bytes) -> None:
        if path.parent == directory and (asked / f"full_{settings.seed}").exists():
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        if (asked / f"slow_{settings.seed}").exists():
            time.sleep(0.5)
        real(path, data)

    files.write_bytes = write_bytes
    with (asked / "begun.txt").open("a") as file:
        file.write(f"{settings.seed}\n")
    while (asked / f"hold_{settings.seed}").exists():
        time.sleep(0.02)
    once = asked / f"kill_{settings.seed}"
    if once.exists() or (asked / f"kill_always_{settings.seed}").exists():
        once.unlink(missing_ok=True)
        os.kill(os.getpid(), signal.SIGKILL)
    if (asked / f"none_{settings.seed}").exists():
        raise InfeasibleError("no way from a to b; raise planner.n_max")
    return settings.seed
