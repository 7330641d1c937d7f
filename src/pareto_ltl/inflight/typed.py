"""What the pilot types during a flight: position fixes, and the answer to a new plan."""

from __future__ import annotations

import math
import threading
from collections import deque
from collections.abc import Callable
from typing import TextIO

HELP = "type fix LAT,LON,SD (or fix X,Y,SD) for a position [deg and m], or y to fly the new plan"


class Typed:
    """Reads ``stream`` line by line in a thread.

    Attributes
    ----------
    fixes : deque of (float, float, float)
        Positions with their standard deviations [m], which are not taken yet.
    agreed : threading.Event
        Whether ``y`` was typed; who takes it clears it.
    """

    def __init__(self, stream: TextIO, complain: Callable[[str], None]) -> None:
        self.stream, self.complain = stream, complain
        self.fixes: deque[tuple[float, float, float]] = deque(maxlen=100)
        self.agreed = threading.Event()

    def start(self) -> Typed:
        """Begin to read."""
        threading.Thread(target=self._read, daemon=True).start()
        return self

    def _read(self) -> None:
        for line in self.stream:
            self.take(line)

    def take(self, line: str) -> None:
        """Take one line; one that is not understood is answered with what can be typed."""
        word, _, rest = line.strip().partition(" ")
        if word == "y" and not rest:
            self.agreed.set()
            return
        try:
            first, second, sd = map(float, rest.split(","))
        except ValueError:
            word = ""
            first = second = sd = math.nan
        if word == "fix" and all(map(math.isfinite, (first, second, sd))) and sd > 0.0:
            self.fixes.append((first, second, sd))
        elif line.strip():
            self.complain(HELP)
