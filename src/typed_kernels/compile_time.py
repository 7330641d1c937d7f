"""How long a first run still compiles: the costs of its kernels, less those whose code is there already."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from threading import RLock

PRIOR = 10.0  # [s] of work at the measured speed that count beside what this machine has shown
LOOK = 1.0  # [s] between two looks at the disk, where a second process writes
SMALLEST = 0.05  # share of a kernel's cost that is left while it is compiled


class CompileTime:
    """The work of a first run, from the first kernel that is compiled.

    Parameters
    ----------
    costs : mapping
        CPU time of each kernel [s].
    has_code : callable
        Whether there is code of a kernel on disk.
    workers : int
        Processes that compile.
    clock : callable
        The time [s].
    """

    def __init__(
        self, costs: Mapping[str, float], has_code: Callable[[str], bool], workers: int = 1,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:  # fmt: skip
        self._has_code, self._workers, self._clock = has_code, workers, clock
        self._began = self._looked = clock()
        self._missing = {kernel: cost for kernel, cost in costs.items() if not has_code(kernel)}
        self._whole = sum(self._missing.values())
        self._speed = float(workers)
        self._current: dict[str, float] = {}  # kernels at work, and when they began
        self._lock = RLock()  # a thread draws
        self.total, self.done = len(self._missing), 0

    @property
    def busy(self) -> bool:
        """Whether something is compiled in this process."""
        return bool(self._current)

    def begins(self, kernel: str) -> None:
        """``kernel`` is compiled in this process from now on."""
        with self._lock:
            self.total += kernel not in self._missing
            self._current[kernel] = self._clock()

    def ends(self, kernel: str) -> None:
        """The code of ``kernel`` is there."""
        with self._lock:
            if self._current.pop(kernel, None) is not None:
                self._missing.pop(kernel, None)
                self.done += 1
                self._measure(self._clock())

    def share(self) -> float:
        """Share of the time that is over."""
        passed = self._clock() - self._began
        return passed / max(passed + self.left(), 1e-9)

    def left(self) -> float:
        """Seconds until all is compiled, at the speed of what was compiled."""
        with self._lock:
            return self._left(self._clock())

    def _left(self, now: float) -> float:
        if now - self._looked >= LOOK:
            self._looked = now
            for kernel in [k for k in self._missing if k not in self._current and self._has_code(k)]:
                self.done += 1
                del self._missing[kernel]
                self._measure(now)
        share = self._speed / self._workers  # of a kernel that is compiled here
        current = sum(
            min(share * (now - began), (1 - SMALLEST) * self._missing.get(kernel, 0.0))
            for kernel, began in self._current.items()
        )
        return max(sum(self._missing.values()) - current, 0.0) / self._speed

    def _measure(self, now: float) -> None:
        """The speed so far, when a kernel ends: CPU seconds of work a second."""
        done, passed = self._whole - sum(self._missing.values()), now - self._began
        self._speed = (done + self._workers * PRIOR) / (passed + PRIOR)


def seconds_text(seconds: float) -> str:
    """A time to wait, no more exact than it is known.

    >>> seconds_text(3), seconds_text(74), seconds_text(200)
    ('some seconds', 'about 70 s', 'about 3 min')
    """
    if seconds < 5:
        return "some seconds"
    return f"about {5 * round(seconds / 5)} s" if seconds < 60 else _longer(seconds)


def _longer(seconds: float) -> str:
    return f"about {10 * round(seconds / 10)} s" if seconds < 120 else f"about {round(seconds / 60)} min"
