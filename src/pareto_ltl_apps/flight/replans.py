"""New plans during a watch: ``pareto-ltl replan`` in a second process, after a fix or with a newer forecast.

The watch goes on with the old plan. A new plan is offered only if fewer of the same flights fail with it than
with the rest of the old one, from where the robot is now; the pilot decides, or ``auto`` does.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time as clock
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from careful_io.files import write_csv
from pareto_ltl.support.counts import paired_difference
from pareto_ltl_apps.flight.rules import Event, alarm, event_of
from pareto_ltl_apps.flight.telemetry import Typed
from pareto_ltl_apps.flight.watch import Watch

LONGEST = 120.0  # [s] to wait for a new plan when the telemetry has ended
TWICE = 2.0  # times the least failure rate that is known, above which a new plan is made
APART = 600.0  # [s] of flight between two plans that are made for that reason
LOOK = 2.0  # [s] between two looks at the folder of forecasts; a file that did not change is complete
INFORMED = 0.8  # share of the planned variance below which the belief knows more than the plan


@dataclass(frozen=True, slots=True)
class ReplanSettings:
    """When a new plan is made, and who decides.

    Attributes
    ----------
    enabled : bool
        Whether fixes and a high failure rate start a new plan.
    wind_folder : Path or None
        Folder whose new files are newer forecasts.
    auto : bool
        Whether a plan that is offered is flown without an answer.
    """

    enabled: bool = False
    wind_folder: Path | None = None
    auto: bool = False


class Replans:
    """Plans again, at most one process at a time, the newest information first.

    Parameters
    ----------
    directory : Path
        The result that is watched.
    folder : Path
        Gets ``fixes_N.csv`` and the results ``replan_N``.
    settings : ReplanSettings
        When.
    typed : Typed, optional
        Reads the answers of the pilot.
    earlier : iterable of Event
        Events of the journal that is continued.
    """

    def __init__(
        self, directory: Path, folder: Path, settings: ReplanSettings, typed: Typed | None = None,
        earlier: Iterable[Event] = (),
    ) -> None:  # fmt: skip
        self.directory, self.folder, self.settings, self.typed = directory, folder, settings, typed
        self.fixes = [_row(event) for event in earlier if _learnt(event)]
        self.count = len(list(folder.glob("replan_*")))
        self.planned = len(self.fixes)  # fixes that the last process knows
        self.process: subprocess.Popen[str] | None = None
        self.least, self.asked = np.inf, -np.inf
        self.forecasts = Forecasts(settings.wind_folder)
        self.newer: Path | None = None  # the forecast that the process uses
        self.offered: Event | None = None

    def answers(self, watch: Watch, event: Event) -> Iterator[Event]:
        """Start a process where there is news; yields the result of a finished one, and the switch to it."""
        ended = event["event"] == "end"
        if _learnt(event):
            self.fixes.append(_row(event))
        if self.process is not None and (self.process.poll() is not None or ended):
            yield from self._finished(watch, event["time"])
        if self.process is None and (words := self._news(watch, event)):
            self._start(words)
            if ended:
                yield from self._finished(watch, event["time"])
        agreed = self.settings.auto or (self.typed is not None and self.typed.agreed.is_set())
        if self.offered is not None and agreed and not ended and not watch.over:
            known = [row[0] for row in self.fixes[: self.planned]]
            offer = {key: self.offered[key] for key in ("directory", "at")}
            yield event_of("switched", event["time"], **offer, known=known)
        if self.typed is not None:
            self.typed.agreed.clear()

    # --- reasons ---

    def _news(self, watch: Watch, event: Event) -> list[str]:
        """The options of ``pareto-ltl replan`` that contain the news; none without news."""
        if watch.over and event["event"] != "end":
            return []
        on_earth, dt = watch.problem.scene.crs is not None, watch.problem.motion.dt
        now = ["--time", f"{watch.belief.step * dt:.17g}"]
        if (found := self.forecasts.newest()) is not None and not watch.over:
            self.newer = found
            return [*now, "--wind", str(found), *_known_place(watch)]
        if not self.settings.enabled:
            return []
        if len(self.fixes) > self.planned:
            self.planned = len(self.fixes)
            rows = self.folder / f"fixes_{self.count + 1}.csv"
            write_csv(rows, ["time", *(("lat", "lon") if on_earth else ("x", "y")), "sd_m"], self.fixes)
            return ["--fixes", str(rows)]
        if event["event"] == "status" and not watch.over:
            promised = event["promised"]
            self.least = min(self.least, np.inf if promised is None else promised)
            late = event["time"] > self.asked + APART
            if event["low"] > TWICE * self.least and late and (place := _known_place(watch)):
                self.asked = event["time"]
                return [*now, *place]
        return []

    # --- the process ---

    def _start(self, words: list[str]) -> None:
        self.count += 1
        command = [sys.executable, "-m", "pareto_ltl", "replan", str(self.directory), *words]
        self.process = subprocess.Popen(
            [*command, "--out", str(self._place())], stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE, text=True,
        )  # fmt: skip

    def _place(self) -> Path:
        return self.folder / f"replan_{self.count}"

    def _finished(self, watch: Watch, time: float) -> Iterator[Event]:
        """The event of a process that has ended, or ends within ``LONGEST``."""
        assert self.process is not None
        try:
            _, errors = self.process.communicate(timeout=LONGEST)
        except subprocess.TimeoutExpired:
            self.process.kill()
            errors = f"no new plan within {LONGEST:g} s"
            self.process.communicate()
        failed, self.process = self.process.returncode != 0, None
        newer, self.newer = self.newer, None
        if failed:
            why = (errors.strip().splitlines() or ["the process was ended"])[-1]
            yield alarm(time, "replan", f"no new plan: {why}")
            return
        document = json.loads((self._place() / "replan.json").read_text(encoding="utf-8"))
        old, new = _rate(document["old"]), _rate(document["new"])
        better = bool(document["difference"]) and document["difference"]["high"] < 0.0
        if newer is None and new is not None and not watch.over:
            old, new, better = self._compared(watch, round(document["step"]))
        found = event_of(
            "replanned", time, directory=str(self._place()), at=document["time_s"], old=old, new=new,
            better=better, alarms=document["alarms"],
            law=None if document["new"] is None else document["new"]["law"],
            medium=watch.medium.matter, wind=None if newer is None else str(newer),
        )  # fmt: skip
        self.least = np.inf if new is None else new
        self.offered = found if better else None
        yield found

    def _compared(self, watch: Watch, step: int) -> tuple[float, float, bool]:
        """Failure rates of both plans from now on in the same flights, and whether the new one is better."""
        from pareto_ltl import load_results

        path, other = watch.plan.path, load_results(self._place()).plan.path
        u, x = np.concatenate([path.u[:step], other.u]), np.concatenate([path.x[:step], other.x])
        if len(u) > len(watch.problem.laws["coherent"].wind.slot):
            return 1.0, 1.0, False  # beyond the wind that is known
        old, new = (watch.belief.rest_fails(*pair)[1] for pair in ((path.u, path.x), (u, x)))
        return float(old.mean()), float(new.mean()), bool(paired_difference(old, new)[2] < 0.0)

    def stop(self) -> None:
        """End a process that still runs, and close the pipe of one whose answer was not read."""
        if self.process is not None:
            self.process.kill()
            self.process.communicate()


class Forecasts:
    """New files of a folder, each once, when they are complete; those that are there at first are old."""

    def __init__(self, folder: Path | None) -> None:
        self.folder, self.looked = folder, clock.monotonic()
        self.seen: dict[Path, tuple[float, int]] = self._files()
        self.used = set(self.seen.items())

    def _files(self) -> dict[Path, tuple[float, int]]:
        found = {}
        for path in [] if self.folder is None else sorted(self.folder.glob("[!.]*")):
            try:
                stat = path.stat()
            except OSError:  # removed meanwhile
                continue
            if path.is_file() and path.suffix not in (".part", ".tmp", ".idx"):
                found[path] = (stat.st_mtime, stat.st_size)
        return found

    def newest(self) -> Path | None:
        """The newest file that is complete and was not given before."""
        if self.folder is None or clock.monotonic() < self.looked + LOOK:
            return None
        before, self.seen, self.looked = self.seen, self._files(), clock.monotonic()
        ready = [one for one in self.seen.items() if one not in self.used and before.get(one[0]) == one[1]]
        self.used |= set(ready)
        return max(ready, key=lambda one: one[1])[0] if ready else None


def _known_place(watch: Watch) -> list[str]:
    """The belief at the beginning of this step as a position fix of the planned law; none if it adds nothing.

    With Σ of the belief and P of the plan, both made round, the fix that leads from (μ, P) to (m, Σ) has the
    variance R = 1 / (1/Σ - 1/P) and the place R (m/Σ - μ/P).
    """
    belief, path, step = watch.belief, watch.plan.path, watch.belief.step
    known, planned = (0.5 * float(np.trace(c)) for c in (belief.cov[:2, :2], path.cov[step]))
    if known > INFORMED * planned:
        return []
    variance = 1.0 / (1.0 / known - 1.0 / planned)
    place = variance * ((belief.x + belief.z[:2]) / known - path.x[step] / planned)
    given = watch.placed(place)
    first, second = (given["lat"], given["lon"]) if "lat" in given else (given["x"], given["y"])
    return [f"--fix={first:.9f},{second:.9f},{variance**0.5:.3f}"]


def _learnt(event: Event) -> bool:
    return bool(event["event"] == "fix" and event["use"] == "learnt")


def _row(event: Event) -> tuple[float, ...]:
    """Time, the two coordinates as they were given, and standard deviation."""
    return (event["time"], *event["given"], event["sd"])


def _rate(rate: dict[str, Any] | None) -> float | None:
    return None if rate is None else float(rate["failure"])
