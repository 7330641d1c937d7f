"""Judgement of all claims of a results directory, one after another."""

from __future__ import annotations

import csv
import zlib
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from careful_io.errors import UserError
from pareto_ltl_verify.claims import (
    Claim,
    Verdict,
    branches,
    choice,
    containment,
    exports,
    flights,
    front,
    height,
    judged,
    legs,
    limits,
    missions,
    origin,
    outlines,
    page,
    plan,
    readings,
    record,
    replan,
    search,
    settings,
    texts,
    trades,
    units,
    wind,
    world,
)
from pareto_ltl_verify.evidence import Evidence, open_evidence

CLAIMS: tuple[Claim, ...] = (
    *record.CLAIMS, *settings.CLAIMS, *origin.CLAIMS, *world.CLAIMS, *wind.CLAIMS, *readings.CLAIMS,
    *plan.CLAIMS, *limits.CLAIMS, *search.CLAIMS, *front.CLAIMS, *choice.CLAIMS, *judged.CLAIMS,
    *flights.CLAIMS, *legs.CLAIMS, *exports.CLAIMS, *outlines.CLAIMS, *missions.CLAIMS, *height.CLAIMS,
    *texts.CLAIMS, *page.CLAIMS, *trades.CLAIMS, *units.CLAIMS, *replan.CLAIMS, *containment.CLAIMS,
    *branches.CLAIMS,
)  # fmt: skip
REPLANNED = "replan.json"  # file of a plan that begins during a flight (``pareto-ltl replan``)
OF_A_DEPARTURE = frozenset({
    "map: scene.json is the map of the settings",  # the start is the position of the fix
    "mission: time windows come from the map",  # clocks count from the first departure
    "wind: there are readings, or the air is calm",  # the wind was conditioned on the fix
    "wind: known until",
    "wind: law of forecast errors",
    "wind: modes of one slot match the next",
    *readings.NAMES,
    "settings: files that they name",  # of the first departure
})  # fmt: skip
UNUSABLE = (
    UserError, ArithmeticError, AttributeError, LookupError, OSError, RuntimeError, TypeError,
    ValueError, csv.Error, zlib.error,
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Finding:
    """Name of a claim, the claimed value, the value computed from the files, and whether they agree."""

    claim: str
    claimed: str
    derived: str
    holds: bool


def verify(directory: Path | str, source: Path | str | None = None) -> tuple[Finding, ...]:
    """Judge every claim that the results in ``directory`` make.

    Parameters
    ----------
    directory : path
        A results directory.
    source : path, optional
        A wind file that the run read, or the folder with such files, if they are no longer where they were.

    Raises
    ------
    DataError
        If there is no finished result of a plan, or ``source`` is none of its inputs.
    """
    return judge_evidence(open_evidence(Path(directory), None if source is None else Path(source)))


def judge_evidence(result: Evidence) -> tuple[Finding, ...]:
    """Judge every claim that ``result`` makes."""
    from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

    with threadpool_limits(1):  # matrices are small: more threads would be slower
        return tuple(findings(result))


def findings(result: Evidence, claims: Iterable[Claim] = CLAIMS) -> Iterator[Finding]:
    """The findings in the order of ``claims``, without claims that the result does not make.

    A claim that cannot be computed from the files does not hold.
    A plan that begins during a flight does not make the claims :data:`OF_A_DEPARTURE`.
    """
    within = result.has(REPLANNED)
    for claim in claims:
        if within and claim.name in OF_A_DEPARTURE:
            continue
        if all(result.has(name) for name in claim.needs):
            try:
                verdict = claim.judge(result)
            except UNUSABLE as error:
                reason = " ".join(f"{type(error).__name__}: {error}".split())
                verdict = Verdict("cannot be judged", reason[:80], False)
            if verdict is not None:
                yield Finding(claim.name, *verdict)


def needs_rerun(result: Evidence) -> tuple[str, ...]:
    """What only a plan that is made again can show; another claim says more about each where it can."""
    return origin.NEEDS_RERUN if result.has("plan.json") else ()


def unchecked_claims(result: Evidence) -> dict[str, tuple[str, ...]]:
    """Names of the claims that are not judged, by the reason."""
    reasons: dict[str, tuple[str, ...]] = {}
    if result.has(REPLANNED):
        reasons["the plan begins during a flight"] = tuple(sorted(OF_A_DEPARTURE))
        with suppress(*UNUSABLE):
            if replan.flown_result(result) is None:
                reasons["the plan before it is not where replan.json says, or another one"] = (
                    replan.OLD_PLAN,
                    replan.OLD_LAW,
                    *replan.OF_THE_FIXES,
                )
    elif result.has("wind.nc"):
        with suppress(*UNUSABLE):
            if (reason := readings.unread_reason(result)) is not None:
                reasons[reason] = readings.NAMES
    if "code_hash" in result.run and not origin.same_code(result):
        reasons["other code made the result"] = (origin.CODE, page.OF_THIS_CODE)
    with suppress(*UNUSABLE):  # claims about damaged settings fail
        if world.given_map(result):
            reasons["the map was given in Python"] = world.OF_THE_SETTINGS
        if result.has("front.csv") and (rule := choice.added_rule(result)) is not None:
            reasons[f"another package adds selection.rule={rule}"] = (choice.CHOICE,)
    return reasons
