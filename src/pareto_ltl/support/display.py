"""Display of records: one line in a terminal, a small table in a notebook, a figure by ``plot``."""

from __future__ import annotations

import math
from collections.abc import Mapping
from html import escape
from typing import Any

from pareto_ltl.support.extensions import INTERFACE_GROUP, installed_object

SLOW = 3.0  # [m/s] speeds of what is never faster have two decimals


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
        return installed_object(INTERFACE_GROUP, "draw")(self, **options)


NEGLIGIBLE = 1e-9  # smaller probabilities are below the accuracy of any wind model


def probability_text(value: float) -> str:
    """A probability in per cent with two or three significant digits, at most 100 %; a dash for NaN.

    For example 0.12 %, 4.5 %, 45.7 %, 99.98 %, 3.2e-5 %. Only 0 gives "0 %", only 1 or more "100 %".
    """
    if math.isnan(value):
        return "-"
    if 0 < value < NEGLIGIBLE:
        return "< 1e-7 %"
    percent = 100.0 * min(value, 1.0)
    if percent in (0.0, 100.0):
        return f"{percent:.0f} %"
    if percent > 99.0:
        return f"{min(percent, 99.99):.2f} %"
    if percent >= 9.95:
        return f"{percent:.1f} %"
    if percent >= 1e-3:
        return f"{percent:#.2g} %"
    digits, power = f"{percent:.1e}".split("e")
    return f"{digits.removesuffix('.0')}e{int(power)} %"


def round_up(probability: float) -> float:
    """``probability`` > 0 rounded up to two significant digits, so that it is within the rounded limit."""
    power = 10.0 ** (math.floor(math.log10(probability)) - 1)
    return float(f"{math.ceil(probability / power) * power:.2g}")


def interval_text(low: float, high: float) -> str:
    """An interval of probabilities in per cent, e.g. ``0.12 to 1.7 %``."""
    return f"{probability_text(low).removesuffix(' %')} to {probability_text(high)}"


def rate_text(rate: float, low: float, high: float) -> str:
    """A simulated rate with its 95 % interval, e.g. ``0.60 % (95 %: 0.12 to 1.7 %)``."""
    return f"{probability_text(rate)} (95 %: {interval_text(low, high)})"


def flights_text(rate: float, low: float, high: float) -> tuple[str, str]:
    """A failure rate and its 95 % interval as numbers of 100, 10,000 or a million flights.

    >>> flights_text(0.0282, 0.0259, 0.0306)
    ('2.8 of 100 flights', '2.6 to 3.1')
    >>> flights_text(0.623, 0.6171, 0.6301)
    ('62.3 of 100 flights', '61.7 to 63.0')
    >>> flights_text(0.0015, 0.001, 0.0021)
    ('15 of 10,000 flights', '10 to 21')
    """
    size = rate if rate > 0.0 else high
    whole = next((n for n, least in ((100, 0.00995), (10_000, 0.0000995)) if size >= least), 1_000_000)
    tenths = whole * (high - low) < 2.0

    def number(value: float) -> str:
        count = whole * min(value, 1.0)
        if 0.0 < count < 0.001:
            return "less than 0.001"
        if whole == 100 and 99.0 < count < 100.0:
            return f"{min(count, 99.99):.2f}"
        return (
            f"{count:.{int(tenths)}f}" if count >= 9.95 else f"{count:.2g}" if count < 1.0 else f"{count:.1f}"
        )

    return f"{number(rate)} of {whole:,} flights", f"{number(low)} to {number(high)}"


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


def plain_power(value: float) -> str:
    """A small number as people write it: ``1e-3``, ``9.5e-4``; from 0.1 on without a power.

    >>> plain_power(1e-3), plain_power(0.00095), plain_power(0.12), plain_power(0.0)
    ('1e-3', '9.5e-4', '0.12', '0')
    """
    if value == 0.0 or value >= 0.1:
        return f"{value:.2g}"
    digits, power = f"{value:.1e}".split("e")
    return f"{digits.removesuffix('.0')}e{int(power)}"


def energy_text(joules: float) -> str:
    """An energy [J] as text in Wh, or from 1 kWh in kWh: ``48.25 Wh``, ``9.65 kWh``, ``153.8 kWh``.

    >>> energy_text(36_000.0), energy_text(36e6), energy_text(5.4e9)
    ('10 Wh', '10 kWh', '1,500 kWh')
    """
    hours = joules / 3600.0
    if abs(hours) < 999.95:
        return f"{hours:.4g} Wh"
    return f"{hours / 1000.0:.4g} kWh" if abs(hours) < 999_950.0 else f"{hours / 1000.0:,.0f} kWh"


def in_kilometres(metres: float) -> bool:
    """Whether a length or the size of a map [m] is shown in kilometres, which is from 2 km."""
    return metres >= 2000.0


def speed_digits(fastest: float) -> int:
    """Decimals of speeds in m/s of which ``fastest`` is the largest: a glider needs hundredths."""
    return 1 if fastest >= SLOW else 2


def distance_text(metres: float, digits: int = 1) -> str:
    """A length [m] as text in kilometres, or in metres below 2 km, with ``digits`` decimals."""
    return f"{metres / 1e3:,.{digits}f} km" if in_kilometres(metres) else f"{metres:,.{digits}f} m"


def listed_text(names: Any, limit: int = 8) -> str:
    """Up to ``limit`` names, comma-separated, with "..." if there are more; "none" for no name."""
    names = list(names)
    return ", ".join(map(str, names[:limit])) + (", ..." if len(names) > limit else "") or "none"
