"""Cores and memory that this process may use, and errors for settings that need more than is free."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from pathlib import Path
from threading import Lock
from typing import Any, TypeVar

from careful_io.errors import ConfigError
from careful_io.messages import shown_value

GIVEN = ("OMP_NUM_THREADS", "SLURM_CPUS_PER_TASK")  # set by launchers of sweeps, and by SLURM
GIGABYTE = 1e9
KERNEL_THREADS = "NUMBA_NUM_THREADS"
SMALL = 2**28  # [bytes] smaller requests are not checked
CGROUPS = (  # files of the limit and of the memory in use, in version 2 and in version 1 of cgroups
    ("memory.max", "memory.current"),
    ("memory/memory.limit_in_bytes", "memory/memory.usage_in_bytes"),
)
CGROUP_FOLDER = Path("/sys/fs/cgroup")
Made = TypeVar("Made")


def cores() -> int:
    """Number of cores from the first variable of :data:`GIVEN` that is set, else of this process."""
    for name in GIVEN:
        value = os.environ.get(name, "")
        if value.isdecimal() and int(value) > 0:
            return int(value)
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def check_kernel_threads() -> None:
    """Raise ConfigError if ``NUMBA_NUM_THREADS`` is set and no whole number from 1."""
    value = os.environ.get(KERNEL_THREADS, "")
    if value and not (value.isascii() and value.isdecimal() and int(value) > 0):
        raise ConfigError(
            f"{KERNEL_THREADS} must be a whole number from 1, got {shown_value(value)}: "
            "unset it for all cores"
        )


def on_all_cores(make: Callable[..., Made], *arguments: Iterable[Any]) -> list[Made]:
    """What ``make`` returns for each of the ``arguments``, in their order, as ``map``; in a thread a core."""
    from concurrent.futures import ThreadPoolExecutor

    with ThreadPoolExecutor(cores()) as pool:
        return list(pool.map(make, *arguments))


def made_once(make: Callable[[], Made]) -> Callable[[], Made]:
    """``make``, which is called once, by the first thread that needs what it returns."""
    lock, cached = Lock(), cache(make)

    def made() -> Made:
        with lock:
            return cached()

    return made


def available_memory() -> float:
    """Bytes that this process can still use: the least of machine, container and ``ulimit -v``."""
    import psutil

    return max(0.0, min([float(psutil.virtual_memory().available), *container_room(), *_own_room()]))


def require_memory(each: float, setting: str, count: int, what: str, also: str = "") -> None:
    """Raise an error if ``count`` times ``each`` bytes are more than the available memory.

    Parameters
    ----------
    each : float
        Memory of one item [bytes].
    setting : str
        The setting whose value is ``count``; the message states the largest value that fits.
    what : str
        The items, for the message, e.g. ``"10 trees"``.
    also : str
        Another setting that can be lowered instead, for the message.

    Raises
    ------
    ConfigError
        If the memory does not suffice.
    """
    needed = each * count
    if needed < SMALL or needed <= (free := available_memory()):
        return
    largest = int(free / each)
    fits = f"at most {largest} fits" if largest else "no value fits"
    other = f", or lower {also}" if also else ""
    raise ConfigError(
        f"{setting}={count} needs {needed / GIGABYTE:.3g} GB of memory for {what}, and "
        f"{free / GIGABYTE:.3g} GB are free: {fits}{other}"
    )


def container_room() -> Iterator[float]:
    """Memory that is free under each limit of the container [bytes]; no values without a limit."""
    for limit, used in CGROUPS:
        try:
            numbers = [int((CGROUP_FOLDER / name).read_text()) for name in (limit, used)]
        except (OSError, ValueError):  # no such file, or "max": no limit
            continue
        yield float(numbers[0] - numbers[1])


def _own_room() -> Iterator[float]:
    """Memory that is free under ``ulimit -v`` [bytes]; no values without such a limit."""
    import psutil

    try:
        import resource
    except ImportError:
        return
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    if limit != resource.RLIM_INFINITY:
        yield float(limit - psutil.Process().memory_info().vms)
