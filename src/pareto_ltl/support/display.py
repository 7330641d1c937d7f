"""Display of records: one line in a terminal, a small table in a notebook, a figure by ``plot``."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from typing import Any

from careful_io.texts import frequency_text, probability_text, rate_text
from pareto_ltl.support.extensions import INTERFACE


class Displayed:
    """Base of the records that users see. A subclass lists its key facts in :meth:`facts`.

    No record depends on matplotlib: the application that draws is an entry point of ``pareto_ltl.interface``.
    """

    __slots__ = ()

    def facts(self) -> Mapping[str, str]:
        """The facts to show: name to text."""
        raise NotImplementedError

    def __repr__(self) -> str:
        facts = ", ".join(f"{name} {value}" for name, value in self.facts().items())
        return f"{type(self).__name__}({facts})"

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><th style='text-align:left'>{escape(name)}</th><td>{escape(value)}</td></tr>"
            for name, value in self.facts().items()
        )
        return f"<table><caption>{escape(type(self).__name__)}</caption>{rows}</table>"

    def plot(self, **options: Any) -> Any:
        """Draw the record; returns a ``Drawing``, which a notebook shows.

        Its method ``save`` writes a file; its attribute ``figure`` is the matplotlib figure. With ``ax``, the
        record is drawn on these axes of matplotlib, which are returned. ``scene`` is the map below it;
        docs/api.md lists the options of each record.
        """
        return INTERFACE.required("draw")(self, **options)


def flights_text(rate: float, low: float, high: float) -> tuple[str, str]:
    """A failure rate and its 95 % interval as numbers of 100, 10,000 or a million flights.

    >>> flights_text(0.0282, 0.0259, 0.0306)
    ('2.8 of 100 flights', '2.6 to 3.1')
    """
    return frequency_text(rate, low, high, "flights")


def branched_text(sentence: str, fixless: float, floor: float = 0.0) -> str:
    """``sentence`` on a plan with its branches, and how many flights fail without a fix (rate ``fixless``).

    >>> branched_text("2.7 of 100 flights fail (2.5 to 2.9)", 0.0812)
    '2.7 of 100 flights fail (2.5 to 2.9), with its branches; 8.1 of 100 without a fix'
    """
    rate = max(fixless, floor)
    shown = flights_text(rate, rate, rate)[0].removesuffix(" flights")
    return f"{sentence}, with its branches; {'fewer than ' * (fixless < floor)}{shown} without a fix"


def answer_text(rate: float, low: float, high: float, where: str, floor: float = 0.0) -> str:
    """The answer to how likely a plan is to fail, in a sentence; ``where`` are the winds that it counts in.

    Below the ``floor`` of the law of forecast errors it says what its data can say.

    >>> answer_text(0.0282, 0.0259, 0.0306, "winds of this forecast")
    '2.8 of 100 flights fail (2.6 to 3.1), in winds of this forecast'
    >>> answer_text(1e-4, 4e-5, 2e-4, "winds of this forecast", 1 / 65)
    "fewer than 1.5 of 100 flights fail, in winds of this forecast: the law's data cannot say less"
    """
    shown, interval = flights_text(rate, low, high)
    if rate < floor:
        least = flights_text(floor, floor, floor)[0]
        return f"fewer than {least} fail, in {where}: the law's data cannot say less"
    return f"{shown} fail ({interval}), in {where}"


def headline_text(
    rate: float, low: float, high: float, where: str, sample: str, floor: float = 0.0
) -> tuple[str, str]:
    """The number of flights that fail, and a note on it: interval, winds (or currents) and ``sample``.

    >>> headline_text(0.0282, 0.0259, 0.0306, "winds of this forecast", "20,000 flights")
    ('2.8 of 100 flights', '2.6 to 3.1 (95 %), in winds of this forecast; 20,000 flights')
    """
    shown, interval = flights_text(rate, low, high)
    if rate >= floor:
        return shown, f"{interval} (95 %), in {where}; {sample}"
    least = flights_text(floor, floor, floor)[0]
    said = f"in {where}: the law's data cannot say less; of {sample} {rate_text(rate, low, high)} fail"
    return f"fewer than {least}", said


LAW_WORDS = {"coherent": "{} of this forecast", "independent": "{} drawn anew at every step"}


def winds_text(flows: str, law: str, gap: str = "") -> str:
    """The winds (or currents) of a law in words; ``gap``: of another level than the robot's.

    >>> winds_text("winds", "coherent"), winds_text("currents", "independent")
    ('winds of this forecast', 'currents drawn anew at every step')
    """
    if gap:
        return f"{flows} of another level than the robot's (no promise)"
    return LAW_WORDS.get(law, f"{law} {{}}").format(flows)


def allowed_text(probability: float, limit: float) -> str:
    """A probability that is limited: ``3.8 % of 5.0 % allowed``; 1 or more is no limit.

    >>> allowed_text(0.038, 0.05), allowed_text(0.06, 0.05), allowed_text(0.06, 1.0)
    ('3.8 % of 5.0 % allowed', '6.0 %, above the 5.0 % allowed', '6.0 %, without a limit')
    """
    shown, most = probability_text(probability), probability_text(limit)
    if limit >= 1.0:
        return f"{shown}, without a limit"
    return (
        f"{shown} of {most} allowed"
        if probability <= limit * 1.0005
        else f"{shown}, above the {most} allowed"
    )


def promised_text(rate: float, floor: float) -> str:
    """A promised rate as text; below the ``floor`` of the law of forecast errors, what its data can say.

    >>> promised_text(0.05, 1 / 65)
    '5.0 %'
    >>> promised_text(1e-4, 1 / 65)
    "below 1.5 % (the law's data cannot say less; 0.010 % of the simulated flights fail)"
    """
    shown = probability_text(rate)
    if rate >= floor:
        return shown
    least = probability_text(floor)
    return f"below {least} (the law's data cannot say less; {shown} of the simulated flights fail)"
