"""A budget of time for work that gets better the longer it goes on, and Ctrl-C as its early end."""

from __future__ import annotations

import logging
import math
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

LOG = logging.getLogger(__name__)


class Budget:
    """How long several pieces of work may take together.

    Without ``seconds`` nothing looks at the clock, so that results do not depend on it.

    Attributes
    ----------
    seconds : float or None
        What there is to spend [s].
    asked : bool
        Whether the user asked for the end.
    heeded : bool
        Whether the work that the budget is for goes on, so that Ctrl-C is about it.
    """

    def __init__(self, seconds: float | None = None) -> None:
        self.seconds = seconds
        self.asked = False
        self.heeded = False
        self._began: float | None = None

    def begin(self) -> None:
        """Start the clock, where it does not run yet."""
        if self._began is None:
            self._began = time.perf_counter()

    def left(self, share: float = 1.0) -> float:
        """Seconds until this share of the budget is spent; never below 0, without end where there is none."""
        if self.asked:
            return 0.0
        if self.seconds is None:
            return math.inf
        spent = 0.0 if self._began is None else time.perf_counter() - self._began
        return max(share * self.seconds - spent, 0.0)

    def over(self, share: float = 1.0) -> bool:
        """Whether this share of the budget is spent, or the user asked for the end."""
        return self.left(share) <= 0.0

    def end(self) -> None:
        """The user asks for the end."""
        self.asked = True

    @contextmanager
    def ends_at_key(self) -> Iterator[None]:
        """In the block, while it is ``heeded``, the first Ctrl-C ends a budget; others end the run as ever.

        Outside the main thread, where Python allows no signal handlers, and without a budget, the block is
        only run.
        """
        if self.seconds is None or threading.current_thread() is not threading.main_thread():
            yield
            return
        before = signal.getsignal(signal.SIGINT)

        def end_early(_number: int, _frame: FrameType | None) -> None:
            if not self.heeded or self.asked:
                raise KeyboardInterrupt
            LOG.warning("stopping: the front is made from the paths found so far; Ctrl-C again ends the run")
            self.end()

        signal.signal(signal.SIGINT, end_early)
        try:
            yield
        finally:
            signal.signal(signal.SIGINT, before)


UNLIMITED = Budget()

__all__ = ["UNLIMITED", "Budget"]
