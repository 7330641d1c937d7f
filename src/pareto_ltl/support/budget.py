"""A time limit for computations that improve with time; the first Ctrl-C ends them early."""

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
    """A time limit that several computations share.

    If ``seconds`` is None, the clock is not read, so that results do not depend on it.

    Attributes
    ----------
    seconds : float or None
        The time limit [s]; None: no limit.
    asked : bool
        Whether the user asked to end early.
    heeded : bool
        Whether a computation with this limit is running, so that Ctrl-C ends it and not the run.
    """

    def __init__(self, seconds: float | None = None) -> None:
        self.seconds = seconds
        self.asked = False
        self.heeded = False
        self._began: float | None = None

    def begin(self) -> None:
        """Start the clock, unless it runs already."""
        if self._began is None:
            self._began = time.perf_counter()

    def left(self, share: float = 1.0) -> float:
        """Seconds until ``share`` (0 to 1) of the limit is used: at least 0, infinity without a limit."""
        if self.asked:
            return 0.0
        if self.seconds is None:
            return math.inf
        spent = 0.0 if self._began is None else time.perf_counter() - self._began
        return max(share * self.seconds - spent, 0.0)

    def over(self, share: float = 1.0) -> bool:
        """Whether ``share`` (0 to 1) of the limit is used, or the user asked to end early."""
        return self.left(share) <= 0.0

    def end(self) -> None:
        """Record that the user asks to end early."""
        self.asked = True

    def until(self, share: float) -> Budget:
        """The part of this limit until ``share`` (0 to 1) of it is used; shares of the part count from 0."""
        return _Part(self, share)

    @contextmanager
    def ends_at_key(self) -> Iterator[None]:
        """In the block, while ``heeded`` is set, the first Ctrl-C calls :meth:`end`; any other ends the run.

        Without a limit, and outside the main thread, where Python allows no signal handlers, Ctrl-C is not
        changed.
        """
        if self.seconds is None or threading.current_thread() is not threading.main_thread():
            yield
            return
        before = signal.getsignal(signal.SIGINT)

        def end_early(_number: int, _frame: FrameType | None) -> None:
            if not self.heeded or self.asked:
                raise KeyboardInterrupt
            LOG.warning("stopping: the front is made from the paths so far; Ctrl-C again ends the run")
            self.end()

        signal.signal(signal.SIGINT, end_early)
        try:
            yield
        finally:
            signal.signal(signal.SIGINT, before)


class _Part(Budget):
    """The first ``share`` of another limit."""

    def __init__(self, whole: Budget, share: float) -> None:
        super().__init__(whole.seconds)
        self.whole, self.share = whole, share

    def left(self, share: float = 1.0) -> float:
        return self.whole.left(share * self.share)


UNLIMITED = Budget()
