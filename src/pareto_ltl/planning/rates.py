"""Failure rates of simulated flights, and the rate that is promised."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from careful_io.texts import interval_text, rate_text
from pareto_ltl.support.counts import clopper_pearson
from pareto_ltl.support.display import answer_text, promised_text, winds_text

FLIGHTS, WEIGHTED = "flights", "importance sampling"  # methods of failure rates
SAMPLES = {FLIGHTS: "flights", WEIGHTED: "weighted flights"}  # how the runs of each method are called


@dataclass(frozen=True, slots=True)
class FailureRate:
    """How often the flights of a path fail in the winds of one law.

    Attributes
    ----------
    law : str
        Wind law of the flights.
    failure : float
        Share of flights that fail.
    low, high : float
        95 % interval of the rate.
    runs : int
        Number of flights, weighted ones with importance sampling.
    method : str
        ``flights`` counts simulated flights; ``importance sampling`` weighs them (``simulation.importance``).
    """

    law: str
    failure: float
    low: float
    high: float
    runs: int
    method: str = FLIGHTS

    def __post_init__(self) -> None:
        if not 0.0 <= self.low <= self.failure <= self.high <= 1.0:
            raise ValueError(
                "a failure rate needs 0 <= low <= failure <= high <= 1, "
                f"got {self.low:g}, {self.failure:g}, {self.high:g}"
            )
        if self.method not in SAMPLES:
            raise ValueError(f"a failure rate is from {' or '.join(SAMPLES)}, got {self.method!r}")
        if self.runs < 1:
            raise ValueError(f"a failure rate needs at least one flight, got runs = {self.runs}")

    @classmethod
    def counted(cls, law: str, failures: int, runs: int) -> FailureRate:
        """The rate of ``failures`` among ``runs`` flights, with its 95 % Clopper-Pearson interval."""
        return cls(law, failures / runs, *clopper_pearson(failures, runs), runs)

    @classmethod
    def stated(cls, content: Mapping[str, Any]) -> FailureRate:
        """The rate in a document that has a key for each attribute, among others."""
        return cls(**{field.name: content[field.name] for field in fields(cls)})

    @property
    def weighted(self) -> bool:
        """Whether the flights were weighted."""
        return self.method == WEIGHTED

    @property
    def failures(self) -> int:
        """Number of flights that fail; with weighted flights, ``failure`` times ``runs``, rounded."""
        return round(self.failure * self.runs)

    @property
    def sample(self) -> str:
        """Number and kind of the flights of the rate: ``20,000 flights``."""
        return f"{self.runs:,} {SAMPLES[self.method]}"

    def __str__(self) -> str:
        return f"{rate_text(self.failure, self.low, self.high)}, {self.law} winds"


@dataclass(frozen=True, slots=True)
class Promise:
    """Failure rate that is promised for a plan with ``fidelity.judge=flights``, from fresh flights of it.

    Attributes
    ----------
    rate : FailureRate
        Rate of flights in winds that neither the optimisation nor the choice has used.
    claimed : FailureRate
        Rate of the flights that judged the front.
    bound : float
        V + R, at most 1: the bound that guided the search.
    linearity : float
        Largest ratio, along the path, of the position's standard deviation to the length scale of the wind
        there.
    passed : bool
        Whether the claim is consistent with the fresh flights (``simulation.promise.claim_stands``).
    floor : float
        1 / (n + 1), with the n situations in the data of the law of forecast errors: they cannot say that a
        rate is lower. 0 if the wind has no such law, or it does not state n.
    """

    rate: FailureRate
    claimed: FailureRate
    bound: float
    linearity: float
    passed: bool
    floor: float = 0.0

    @property
    def fails(self) -> str:
        """The promised rate as text: ``5.2 %``; not less than the data of the law can say."""
        return promised_text(self.rate.failure, self.floor)

    def answer(self, flows: str, gap: str = "") -> str:
        """How many flights fail, in a sentence, in ``flows``: winds or currents; ``gap`` as in a plan."""
        rate = self.rate
        return answer_text(rate.failure, rate.low, rate.high, winds_text(flows, rate.law, gap), self.floor)

    def __str__(self) -> str:
        rate = self.rate
        if rate.failure >= self.floor:
            return str(rate)
        return f"{self.fails} (95 %: {interval_text(rate.low, rate.high)}), {rate.law} winds"
