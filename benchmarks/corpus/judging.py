"""What the runs of a corpus show: mission by mission, and in all."""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from statistics import median
from typing import Any

import moocore
import numpy as np

from compare_fronts import LENGTHS, failures_at
from pareto_ltl.support.arrays import FloatArray

RARE = 0.01  # failure rates up to this one need not agree between seeds
SPREAD = 1.3  # largest promise over the median of the seeds
SHARE = 0.9  # of the hypervolume of all seeds together
EQUAL = 1.15  # largest failure at equal length over the median of the seeds
LEAST = 1e-4  # failure rates below count as this one where they are divided
LONGER = 1.01  # a path that is longer by less counts as no longer

Row = Mapping[str, Any]


@dataclass(slots=True)
class Judged:
    """The runs of one mission.

    Attributes
    ----------
    rows : dict of list
        Rows by variant, by increasing seed.
    volumes : list of float
        Hypervolume of the front of each run of ``full`` over the hypervolume of the fronts of all seeds.
    ratios : list of float
        Failure at equal length of each run of ``full`` over the median of all seeds.
    spread : float or None
        Worst promise over the median promise of ``full``; None for one seed or a median of 0.
    worse : dict of dict
        For ``quick`` and ``bare``, why ``full`` is worse beyond the noise, by the seeds for which it is.
    """

    name: str
    tags: Mapping[str, Any]
    rows: dict[str, list[Row]]
    volumes: list[float] = field(default_factory=list)
    ratios: list[float] = field(default_factory=list)
    spread: float | None = None
    worse: dict[str, dict[int, str]] = field(default_factory=dict)

    @property
    def planned(self) -> list[Row]:
        """The rows of ``full`` that have a plan."""
        return [row for row in self.rows.get("full", []) if row["code"] == 0]

    @property
    def agrees(self) -> bool:
        """Whether all seeds have a plan, and the worst promise is small or near the median."""
        promises = [row["promise"] for row in self.planned]
        if len(promises) < len(self.rows.get("full", [])):
            return False
        return bool(max(promises) <= max(RARE, SPREAD * median(promises)))

    @property
    def covers(self) -> bool:
        """Whether the worst seed has enough of the hypervolume of all."""
        return min(self.volumes, default=0.0) >= SHARE

    @property
    def equal(self) -> bool:
        """Whether no seed fails much more often at equal length than the median of them."""
        return max(self.ratios, default=1.0) <= EQUAL

    @property
    def cpu(self) -> list[float]:
        """CPU seconds of the runs of ``full`` that found their machine code on disk."""
        return [row["cpu"] for row in self.rows.get("full", []) if not row["cold"]]


def judge(rows: Sequence[Row], tags: Mapping[str, Mapping[str, Any]]) -> list[Judged]:
    """One record for each mission of ``rows``, in the order of their names."""
    grouped: dict[str, dict[str, list[Row]]] = defaultdict(lambda: defaultdict(list))
    for row in sorted(rows, key=lambda row: (row["mission"], row["seed"])):
        grouped[row["mission"]][row["variant"]].append(row)
    return [judge_mission(name, tags[name], variants) for name, variants in grouped.items()]


def judge_mission(name: str, tags: Mapping[str, Any], rows: dict[str, list[Row]]) -> Judged:
    """The runs of one mission."""
    judged = Judged(name, tags, rows)
    promises = [row["promise"] for row in judged.planned]
    if len(promises) > 1 and median(promises) > 0.0:
        judged.spread = max(promises) / median(promises)
    fronts = [row.get("front", []) for row in rows.get("full", [])]
    judged.volumes, judged.ratios = relative_volumes(fronts), relative_failures(fronts)
    for variant in ("quick", "bare"):
        others = {row["seed"]: row for row in rows.get(variant, [])}
        pairs = [(row, others[row["seed"]]) for row in rows.get("full", []) if row["seed"] in others]
        judged.worse[variant] = {row["seed"]: why for row, other in pairs if (why := why_worse(row, other))}
    return judged


def relative_volumes(fronts: Sequence[Sequence[Sequence[float]]]) -> list[float]:
    """Hypervolume of each front over the one of all together, below failure 1 and twice the longest path.

    Rows of a front are (failure, low, high, length [m]); an empty front has 0. The list is empty if all are.
    """
    points = [np.array([[row[0], row[3]] for row in front]).reshape(-1, 2) for front in fronts]
    union = np.concatenate([np.empty((0, 2)), *points])
    if not len(union):
        return []
    corner = [1.0, 2.0 * union[:, 1].max()]
    whole = moocore.hypervolume(union, ref=corner)
    if whole <= 0.0:
        return [1.0 for _ in fronts]
    return [float(moocore.hypervolume(part, ref=corner) / whole) if len(part) else 0.0 for part in points]


def relative_failures(fronts: Sequence[Sequence[Sequence[float]]]) -> list[float]:
    """Failure of each front that is not empty over the median of them at equal length.

    It is the geometric mean over lengths that all of them reach. The list is empty for fewer than two fronts,
    and if no length is on all of them.
    """
    points = [np.array([[max(row[0], LEAST), row[3]] for row in front]) for front in fronts if front]
    if len(points) < 2:
        return []
    shortest = max(part[:, 1].min() for part in points)
    longest = min(part[:, 1].max() for part in points)
    if shortest > longest:
        return []
    lengths = np.geomspace(shortest, longest, LENGTHS)
    logs: FloatArray = np.log([failures_at(part, lengths) for part in points])
    return [float(ratio) for ratio in np.exp((logs - np.median(logs, axis=0)).mean(axis=1))]


def why_worse(row: Row, other: Row) -> str:
    """Why ``row`` is worse than ``other`` beyond the noise of both 95 % intervals; empty if it is not."""
    if other["code"]:
        return ""
    if row["code"]:
        return f"exit code {row['code']}"
    if row["low"] > other["high"] and row["length"] * LONGER > other["length"]:
        return (
            f"promises {percent(row['promise'])} instead of {percent(other['promise'])} over no shorter path"
        )
    least, best = min(row["front"]), min(other["front"])
    if least[1] > best[2]:
        return f"least failure {percent(least[0])} instead of {percent(best[0])}"
    return ""


def missed_points(row: Row, other: Row) -> int:
    """Points of the front of ``other`` for which the front of ``row`` has none as safe and no longer."""
    return sum(
        not any(mine[1] <= theirs[2] and mine[3] <= LONGER * theirs[3] for mine in row["front"])
        for theirs in other["front"]
    )


def percent(rate: float) -> str:
    """A rate as text."""
    return f"{100.0 * rate:.3g} %"


@dataclass(frozen=True, slots=True)
class Goal:
    """One line of the summary; ``met`` is None if it is only information."""

    text: str
    value: str
    met: bool | None = None


def summary(judged: Sequence[Judged], unit: float | None) -> list[Goal]:
    """The figures of the whole corpus; ``unit`` [CPU s] is a warm default run of phi2."""
    cpu = [seconds for one in judged for seconds in one.cpu]
    every = [row for one in judged for rows in one.rows.values() for row in rows]
    known = [one for one in judged if one.planned]
    several = [one for one in known if len(one.rows["full"]) > 1]
    largest, usual = max(cpu, default=0.0), median(cpu) if cpu else 0.0
    codes = Counter(row["code"] for row in every)
    crashed = codes[1] + sum(number for code, number in codes.items() if code < 0)
    plans = [row for row in every if row["code"] == 0]
    found = [
        Goal("missions with a plan", f"{len(known)} of {len(judged)}"),
        Goal("runs by exit code", ", ".join(f"{code}: {number}" for code, number in sorted(codes.items()))),
        Goal(
            "plans that satisfy planner.epsilon",
            f"{sum(row.get('epsilon_kept', 1.0) == 1.0 for row in plans)} of {len(plans)}",
        ),
        Goal("runs with an internal error", str(crashed), crashed == 0),
        _share(
            f"worst seed promises at most {SPREAD} x the median", several, [one.agrees for one in several]
        ),
        _share(f"worst seed has {SHARE} of the hypervolume", several, [one.covers for one in several]),
        *_equal(several),
        _worse("full is worse than quick", judged, "quick"),
        _worse("landmarks hurt", judged, "bare"),
        Goal("points of a quick front that full misses", _missed(judged)),
        Goal("largest CPU time", f"{largest:.0f} s", largest <= 120.0),
    ]
    if unit is None:
        return [*found, Goal("median CPU time", f"{usual:.1f} s")]
    most = max((median(one.cpu) for one in judged if one.cpu), default=0.0)
    return [
        *found,
        Goal("median CPU time", f"{usual:.1f} s, {usual / unit:.1f} units of {unit:.1f} s"),
        Goal("slowest mission", f"{most / unit:.1f} units", most <= 3.0 * unit),
    ]


def _share(text: str, of: Sequence[Judged], good: Sequence[bool]) -> Goal:
    if not of:
        return Goal(text, "no mission with several seeds")
    return Goal(
        text, f"{sum(good)} of {len(of)} ({percent(sum(good) / len(of))})", sum(good) >= 0.95 * len(of)
    )


def _equal(several: Sequence[Judged]) -> Iterator[Goal]:
    """How far the fronts of the seeds lie apart: the goal, and what a reader may expect."""
    able = [one for one in several if one.ratios]
    worst = sorted(max(one.ratios) for one in able)
    least = sorted(min(one.volumes) for one in able)
    yield _share(
        f"worst seed fails at most {EQUAL} x the median at equal length", able, [o.equal for o in able]
    )
    if able:
        text = f"{median(worst):.2f} (median), {worst[-1]:.2f} (largest)"
        yield Goal("failure at equal length, worst seed over the median", text)
        text = f"{median(least):.3f} (median), {least[0]:.3f} (least)"
        yield Goal("hypervolume of the worst seed over that of all", text)


def _worse(text: str, judged: Sequence[Judged], variant: str) -> Goal:
    runs = sum(len(one.rows.get(variant, [])) for one in judged)
    number = sum(len(one.worse.get(variant, {})) for one in judged)
    return Goal(
        f"{text}, beyond the noise",
        f"{number} of {runs} runs" if runs else "not run",
        number == 0 if runs else None,
    )


def _missed(judged: Sequence[Judged]) -> str:
    missed = points = 0
    for one in judged:
        mine = {row["seed"]: row for row in one.planned}
        for other in one.rows.get("quick", []):
            if other["code"] == 0 and other["seed"] in mine:
                missed += missed_points(mine[other["seed"]], other)
                points += len(other["front"])
    return f"{missed} of {points}"


def ended(row: Row) -> str:
    """Exit code and last words of a run without a plan."""
    return f"exit code {row['code']}: {row['said'].removeprefix('pareto-ltl: ')}"


def ending(row: Row) -> str:
    """The first clause of :func:`ended` without its numbers, which is the same for runs that ended alike."""
    return re.sub(r"[\d.]+", "#", re.split("[;,]", ended(row))[0])


def endings(judged: Sequence[Judged]) -> list[tuple[str, int, list[str]]]:
    """What runs without a plan said: an example, number of runs and missions, the most frequent first."""
    said: dict[str, list[tuple[str, str]]] = defaultdict(list)
    for one in judged:
        for row in (row for rows in one.rows.values() for row in rows if row["code"]):
            said[ending(row)].append((ended(row), one.name))
    found = [(runs[0][0], len(runs), sorted({name for _, name in runs})) for runs in said.values()]
    return sorted(found, key=lambda entry: -entry[1])
