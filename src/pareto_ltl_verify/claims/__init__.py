"""Claims, verdicts, and the kinds of comparison of a claimed value with a computed one."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
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


# --- verdicts ---------------------------------------------------------------------------------


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


def no_fault(checked: str, *faults: Iterable[str] | Mapping[str, Any]) -> Verdict:
    """Verdict on faults, of which the first is shown; the values of a mapping are whether they are there."""
    lists = (true_of(some) if isinstance(some, Mapping) else some for some in faults)
    first = next((fault for some in lists for fault in some), None)
    return Verdict(checked, "no fault found" if first is None else _short(first), first is None)


def likely(checked: str, chance: float, rare: float) -> Verdict:
    """Verdict on a p value ``chance``, which must not be below ``rare``."""
    return Verdict(checked, f"chance {chance:.2g}", bool(chance >= rare))


def _short(value: Any, width: int = 44) -> str:
    text = str(value)
    return text if len(text) <= width else f"{text[: width - 3]}..."


# --- comparisons ------------------------------------------------------------------------------


def close(claimed: float, derived: float, rel: float = 1e-6, least: float = 0.0) -> bool:
    """Whether two numbers differ by at most ``rel`` times the derived one, or ``least``; never for NaN."""
    return abs(claimed - derived) <= max(rel * abs(derived), least)


def true_of(faults: Mapping[str, Any]) -> list[str]:
    """The faults that are there, by their values."""
    return [fault for fault, there in faults.items() if there]


def unlike(claimed: Mapping[str, Any], derived: Mapping[str, Any]) -> list[str]:
    """A fault for each name of ``derived`` whose claimed value is another."""
    pairs = {name: (claimed.get(name), value) for name, value in derived.items()}
    return [f"{name} {a} is {b}" for name, (a, b) in pairs.items() if a != b]


def far_apart(
    claimed: Mapping[str, Any], derived: Mapping[str, float], rel: float = 1e-6, least: float = 1e-12
) -> list[str]:
    """A fault for each name of ``derived`` whose claimed number is not close to it; None counts as NaN."""
    verdicts = {name: number(claimed[name], value, rel, least) for name, value in derived.items()}
    return [f"{name} {one.claimed} is {one.derived}" for name, one in verdicts.items() if not one.holds]
