"""The words of results: of air and water, of rates of flights, of the end of a run."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

from careful_io.locks import is_held
from careful_io.messages import shown_value
from careful_io.texts import frequency_text, probability_text, rate_text

NO_LESS = "the law's data cannot say less"


class Medium(NamedTuple):
    """The words for what a robot moves in, as page data have them."""

    flow: str
    flows: str
    speed: str
    moves: str
    time: str
    matter: str
    still: str
    levels: str


AIR = Medium("wind", "winds", "airspeed", "flies", "flight time", "air", "calm air", "heights")
WATER = Medium(
    *("current", "currents", "speed through the water", "moves", "time under way", "water", "still water"),
    levels="depths",
)
LAWS = {"coherent": "{} of this forecast", "independent": "{} drawn anew at every step"}
ENDINGS = {
    "running": "its run was killed; plan again with the same command",
    "stopped": "its run was stopped before its end; plan again with the same command",
    "failed": "its run failed, run.log says why; plan again",
    "infeasible": "its run found no plan, run.json says why",
}


def ending_text(directory: Path, status: Any) -> str:
    """How the run of ``directory`` ended, and what to do; ``status`` is the one in ``run.json``."""
    if status == "running" and is_held(directory / "run.lock"):
        return "its run is still at work; wait for its end"
    return ENDINGS.get(status) or f"its run ended as {shown_value(status)}"


def flights_text(rate: float, low: float, high: float) -> tuple[str, str]:
    """A failure rate and its 95 % interval as numbers of flights."""
    return frequency_text(rate, low, high, "flights")


def branched_text(sentence: str, fixless: float, floor: float) -> str:
    """``sentence`` on a plan with its branches, and how many flights fail without a fix."""
    shown = flights_text(*[max(fixless, floor)] * 3)[0].removesuffix(" flights")
    return f"{sentence}, with its branches; {'fewer than ' * (fixless < floor)}{shown} without a fix"


def headline_text(
    rate: float, low: float, high: float, where: str, sample: str, floor: float
) -> tuple[str, str]:
    """The number of flights that fail, at least the ``floor``, and a note on it."""
    if rate < floor:
        note = f"in {where}: {NO_LESS}; of {sample} {rate_text(rate, low, high)} fail"
        return f"fewer than {flights_text(floor, floor, floor)[0]}", note
    shown, interval = flights_text(rate, low, high)
    return shown, f"{interval} (95 %), in {where}; {sample}"


def winds_text(flows: str, law: str, gap: str = "") -> str:
    """The winds (or currents) of a law; ``gap``: of another level than the robot's."""
    if gap:
        return f"{flows} of another level than the robot's (no promise)"
    return LAWS.get(law, f"{law} {{}}").format(flows)


def allowed_text(probability: float, limit: float) -> str:
    """A probability and its limit; 1 or more is none."""
    shown, most = probability_text(probability), probability_text(limit)
    if limit >= 1.0:
        return f"{shown}, without a limit"
    return (
        f"{shown} of {most} allowed"
        if probability <= limit * 1.0005
        else f"{shown}, above the {most} allowed"
    )


def promised_text(rate: float, floor: float) -> str:
    """A promised rate; below the ``floor`` of the law of forecast errors, what its data can say."""
    shown = probability_text(rate)
    if rate >= floor:
        return shown
    return f"below {probability_text(floor)} ({NO_LESS}; {shown} of the simulated flights fail)"
