"""Claims and verdicts, and comparisons of a claimed value with a computed one."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

from pareto_ltl_verify.evidence import Evidence


class Verdict(NamedTuple):
    """The claimed value, the value computed from the files, and whether the two agree."""

    claimed: str
    derived: str
    holds: bool


@dataclass(frozen=True, slots=True)
class Claim:
    """One statement of a result that can be checked.

    Attributes
    ----------
    needs : tuple of str
        Files of the results directory; if one is missing, the claim is not judged.
    judge : callable
        Function of the evidence; None if the result makes no such claim.
    """

    name: str
    needs: tuple[str, ...]
    judge: Callable[[Evidence], Verdict | None]


def close(claimed: float, derived: float, rel: float = 1e-6, least: float = 0.0) -> bool:
    """Whether two numbers differ by at most ``rel`` times the derived one, or ``least``; never for NaN."""
    return abs(claimed - derived) <= max(rel * abs(derived), least)


def number(claimed: Any, derived: float, rel: float = 1e-6, least: float = 1e-12) -> Verdict:
    """Verdict on two numbers that must agree as in :func:`close`; a claim of None counts as NaN."""
    stated = math.nan if claimed is None else float(claimed)
    return Verdict(f"{stated:.6g}", f"{derived:.6g}", close(stated, derived, rel, least))


def same(claimed: Any, derived: Any) -> Verdict:
    """Verdict on two values that must be equal."""
    return Verdict(_short(claimed), _short(derived), bool(claimed == derived))


def within(checked: str, worst: float, limit: float, unit: str = "") -> Verdict:
    """Verdict on a largest difference ``worst`` that must not exceed ``limit``."""
    return Verdict(checked, f"{worst:.2g}{unit} off", bool(worst <= limit))


def no_fault(checked: str, faults: list[str]) -> Verdict:
    """Verdict on a list of faults that must be empty; the first is shown."""
    return Verdict(checked, _short(faults[0]) if faults else "no fault found", not faults)


def likely(checked: str, chance: float, rare: float) -> Verdict:
    """Verdict on a p value ``chance``, which must not be below ``rare``."""
    return Verdict(checked, f"chance {chance:.2g}", bool(chance >= rare))


def _short(value: Any, width: int = 44) -> str:
    text = str(value)
    return text if len(text) <= width else f"{text[: width - 3]}..."
