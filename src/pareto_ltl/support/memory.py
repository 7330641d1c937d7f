"""Memory: what this process may still use, and the refusal of what does not fit, before it is allocated."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from pareto_ltl.support.errors import ConfigError

GIGABYTE = 1e9
SMALL = 2**28  # [bytes] requests below this are not looked at
CGROUPS = (  # limit and use of the group of processes, in version 2 and in version 1 of cgroups
    ("memory.max", "memory.current"),
    ("memory/memory.limit_in_bytes", "memory/memory.usage_in_bytes"),
)
CGROUP_FOLDER = Path("/sys/fs/cgroup")


def available_memory() -> float:
    """Bytes that this process may still use: of the machine, of its container and of its own limit."""
    import psutil

    return max(0.0, min([float(psutil.virtual_memory().available), *container_room(), *_own_room()]))


def require_memory(each: float, setting: str, count: int, what: str, also: str = "") -> None:
    """Refuse ``count`` times ``each`` bytes where that is more than there is.

    Parameters
    ----------
    setting : str
        The setting whose value ``count`` is; the message says the largest value that fits.
    what : str
        What takes the memory, e.g. ``"10 trees"``.
    also : str
        Another setting that helps, for the message.

    Raises
    ------
    ConfigError
        If it does not fit.
    """
    needed = each * count
    if needed < SMALL or needed <= (free := available_memory()):
        return
    most = int(free / each)
    fits = f"at most {most} fits" if most else "no value fits"
    other = f", or lower {also}" if also else ""
    raise ConfigError(
        f"{setting}={count} needs {needed / GIGABYTE:.3g} GB of memory for {what}, and "
        f"{free / GIGABYTE:.3g} GB are free: {fits}{other}"
    )


def container_room() -> Iterator[float]:
    """What the limits of the container leave [bytes], one for each limit there is."""
    for limit, used in CGROUPS:
        try:
            numbers = [int((CGROUP_FOLDER / name).read_text()) for name in (limit, used)]
        except (OSError, ValueError):  # no such file; "max" where there is no limit
            continue
        yield float(numbers[0] - numbers[1])


def _own_room() -> Iterator[float]:
    """What ``ulimit -v`` leaves; nothing on systems that have no such limit."""
    import psutil

    try:
        import resource
    except ImportError:
        return
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    if limit != resource.RLIM_INFINITY:
        yield float(limit - psutil.Process().memory_info().vms)


__all__ = ["available_memory", "require_memory"]
