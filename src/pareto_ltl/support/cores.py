"""The number of cores that a run may use, which can be fewer than the machine has."""

from __future__ import annotations

import os

GIVEN = ("OMP_NUM_THREADS", "SLURM_CPUS_PER_TASK")  # set by launchers of sweeps, and by SLURM


def cores() -> int:
    """Number of cores from the first variable of :data:`GIVEN` that is set, else of this process."""
    for name in GIVEN:
        value = os.environ.get(name, "")
        if value.isdecimal() and int(value) > 0:
            return int(value)
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
