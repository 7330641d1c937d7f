"""What other paths of the front would give, and why a path turns or comes back in a region, in sentences."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely

from careful_io.texts import distance_text
from pareto_ltl import Scene
from pareto_ltl.extend import Front, Plan, SelectionConfig
from pareto_ltl.support.arrays import FloatArray, IntArray
from pareto_ltl.support.display import flights_text
from pareto_ltl_apps.view.limits import chosen_number

SHORTER = (0.10, 0.03)  # shares of its length by which a path is worth naming: the first that there is
LEAST = SHORTER[-1]
COMPARED = "in the winds in which paths are compared"  # the promise of a plan has other winds
HALF_TURN = 180.0  # [deg] of all turns in a region that are a loop


def trade_lines(scene: Scene, front: Front, plan: Plan) -> list[str]:
    """The sentences of ``plan``; none where bounds judge, or where it is not on the front."""
    chosen = chosen_number(front, plan)
    return [] if chosen is None else Trade.of(scene, front, plan).lines(chosen)


@dataclass(frozen=True)
class Trade:
    """The paths of a front against each other, in the same winds.

    Attributes
    ----------
    floor : float
        The rate below which the data of the law cannot tell rates apart; 0: it tells all.
    """

    scene: Scene
    front: Front
    floor: float

    @classmethod
    def of(cls, scene: Scene, front: Front, plan: Plan | None) -> Trade:
        """With the floor of the promise of ``plan``; 0 without one."""
        return cls(scene, front, 0.0 if plan is None or plan.promise is None else plan.promise.floor)

    def paragraphs(self) -> list[str]:
        """The sentences of each point as one text."""
        return [" ".join(f"{line}." for line in self.lines(k)) for k in range(len(self.front.paths))]

    def lines(self, k: int) -> list[str]:
        """What shorter and longer paths give instead of point ``k``, and why it turns in a region."""
        if not self.front.rates:
            return []
        return [*self._shorter(k), *self._longer(k), *self._exchange(k), *self._loops(k)]

    @cached_property
    def lengths(self) -> FloatArray:
        """Of each path [m]."""
        return np.array([path.objectives.length for path in self.front.paths])

    @cached_property
    def rates(self) -> FloatArray:
        """Of each path, at least the floor."""
        return np.maximum([rate.failure for rate in self.front.rates], self.floor)

    @cached_property
    def looped(self) -> list[list[str]]:
        """The regions of each path in which it turns, or to which it comes back."""
        return [looped_regions(self.scene, path.x) for path in self.front.paths]

    def _shorter(self, k: int) -> Iterator[str]:
        """The best path that is a tenth shorter, or a little; the shortest one that is as good before it."""
        here = self.lengths[k]
        alike = np.flatnonzero((self.lengths <= (1.0 - LEAST) * here) & (self.rates <= self.rates[k]))
        if len(alike):
            yield self._said(int(alike[np.argmin(self.lengths[alike])]), k)
        found = (np.flatnonzero(self.lengths <= (1.0 - share) * here) for share in SHORTER)
        if len(some := next((some for some in found if len(some)), np.empty(0, int))):
            best = int(some[np.argmin(self.rates[some])])
            if self.rates[best] > self.rates[k]:
                yield self._said(best, k)

    def _longer(self, k: int) -> Iterator[str]:
        """The safest path that is longer, if it is safer."""
        some: IntArray = np.flatnonzero((self.lengths > self.lengths[k]) & (self.rates < self.rates[k]))
        if len(some):
            yield self._said(int(some[np.argmin(self.rates[some])]), k)

    def _exchange(self, k: int) -> Iterator[str]:
        """One per cent of length on both sides of point ``k``: the rule ``worth`` compares its effects.

        For the steepest way to a longer point and the flattest one to a shorter point, logarithms of
        failures (plus ``SelectionConfig.SMALL``) over logarithms of lengths.
        """
        fails, far = np.log(self.rates + SelectionConfig.SMALL), np.log(self.lengths)
        fewer, farther = fails[k] - fails, far - far[k]
        longer = np.flatnonzero((farther > 0.0) & (fewer > 0.0))
        shorter = np.flatnonzero((farther < 0.0) & (fewer < 0.0))
        slopes = np.divide(fewer, farther, out=np.zeros(len(far)), where=farther != 0.0)
        parts = list[str]()
        if len(longer):
            best = int(longer[np.argmax(slopes[longer])])
            parts.append(f"1 % more length saves at most {slopes[best]:.1f} % of the failures (point {best})")
        if len(shorter):
            best = int(shorter[np.argmin(slopes[shorter])])
            less = "1 % less" if parts else "1 % less length"
            to = "" if parts else " to the failures"
            parts.append(f"{less} adds at least {slopes[best]:.1f} %{to} (point {best})")
        if parts:
            yield ", ".join(parts)

    def _said(self, other: int, k: int) -> str:
        """``Point 2 is 250.0 km (13 %) shorter: 5.0 instead of 4.0 of 100 flights fail, ...``."""
        away = float(self.lengths[k] - self.lengths[other])
        share = f" ({100.0 * away / self.lengths[k]:.0f} %)" if away > 0.0 else ""
        than = f"Point {other} is {distance_text(abs(away))}{share} {'shorter' if away > 0.0 else 'longer'}"
        one, two = self.share(other), self.share(k)
        if one == two:
            known = f" ({self._counted(other)} instead of {self._counted(k)} of the simulated ones)"
            return f"{than}: {one} fail too{known if self.rates[k] <= self.floor else ''}"
        count, _, whole = one.partition(" of ")
        return (
            f"{than}: {count if whole == two.partition(' of ')[2] else one} instead of {two} fail, {COMPARED}"
        )

    def share(self, k: int) -> str:
        """``4.1 of 100 flights``; of a rate below the floor, what can be said of it."""
        rate = self.front.rates[k]
        if rate.failure < self.floor:
            return f"fewer than {flights_text(self.floor, self.floor, self.floor)[0]}"
        return flights_text(rate.failure, rate.low, rate.high)[0]

    def _counted(self, k: int) -> str:
        return f"{100.0 * self.front.rates[k].failure:.2g} %"

    def _loops(self, k: int) -> Iterator[str]:
        """Why the path turns in a region or comes back to it: the safest path that does not."""
        plain = [n for n, names in enumerate(self.looped) if not names]
        if not self.looped[k] or not plain:
            return
        best = min(plain, key=lambda n: (self.front.rates[n].failure, self.lengths[n]))
        if self.front.rates[best].failure <= self.front.rates[k].failure:
            return
        turns = f"It turns in {' and '.join(self.looped[k])}, so that more flights meet it"
        path = f"safest path without that (point {best}, {distance_text(float(self.lengths[best]))})"
        if self.rates[best] > self.rates[k]:
            yield f"{turns}: {self.share(k)} fail; of the {path} {self.share(best)}"
        else:
            both = self._counted(k), self._counted(best)
            yield (
                f"{turns}: of the simulated ones {both[0]} fail; of the {path} {both[1]}; "
                "the data of the law cannot tell these rates apart"
            )


def looped_regions(scene: Scene, x: FloatArray) -> list[str]:
    """Names of regions that the path ``x`` (T+1, 2) [m] enters twice, or turns in by 180 degrees or more."""
    found = []
    step = np.diff(x, axis=0)
    heading = np.unwrap(np.arctan2(step[:, 1], step[:, 0]))
    turns = np.append(0.0, np.append(np.abs(np.diff(heading)), 0.0))  # at each position
    for name, outlines in scene.regions.items():
        if name in scene.forbidden or not outlines:
            continue
        area = shapely.union_all([shapely.Polygon(outline).buffer(0.0) for outline in outlines])
        inside = shapely.contains_xy(area, x)
        entries = int(inside[0]) + int((inside[1:] & ~inside[:-1]).sum())
        if entries > 1 or np.rad2deg(turns[inside].sum()) >= HALF_TURN:
            found.append(name)
    return found
