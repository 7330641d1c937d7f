"""What a claim is, and how one number or text is held against another."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

from pareto_ltl.verify.evidence import Evidence


class Verdict(NamedTuple):
    """What the result says, what follows from its files, and whether the two agree."""

    claimed: str
    derived: str
    holds: bool


@dataclass(frozen=True, slots=True)
class Claim:
    """One thing that a result says.

    Attributes
    ----------
    needs : tuple of str
        Files without which the claim is not made.
    judge : callable
        Takes the evidence; None where the result does not say it.
    """

    name: str
    needs: tuple[str, ...]
    judge: Callable[[Evidence], Verdict | None]


def close(claimed: float, derived: float, rel: float = 1e-6, least: float = 0.0) -> bool:
    """Whether two numbers agree to a share ``rel`` or to ``least``; NaN agrees with nothing."""
    return abs(claimed - derived) <= max(rel * abs(derived), least)


def number(claimed: Any, derived: float, rel: float = 1e-6, least: float = 1e-12) -> Verdict:
    """Two numbers that must agree."""
    said = math.nan if claimed is None else float(claimed)
    return Verdict(f"{said:.6g}", f"{derived:.6g}", close(said, derived, rel, least))


def same(claimed: Any, derived: Any) -> Verdict:
    """Two values that must be equal."""
    return Verdict(_short(claimed), _short(derived), bool(claimed == derived))


def within(said: str, worst: float, most: float, unit: str = "") -> Verdict:
    """A largest difference that must not exceed ``most``."""
    return Verdict(said, f"{worst:.2g}{unit} off", bool(worst <= most))


def no_fault(said: str, faults: list[str]) -> Verdict:
    """A list of faults that must be empty; the first is shown."""
    return Verdict(said, _short(faults[0]) if faults else "no fault found", not faults)


def likely(said: str, chance: float, rare: float) -> Verdict:
    """The chance of evidence at least as unlike the claim, which must not be below ``rare``."""
    return Verdict(said, f"chance {chance:.2g}", bool(chance >= rare))


def _short(value: Any, width: int = 44) -> str:
    text = str(value)
    return text if len(text) <= width else f"{text[: width - 3]}..."
