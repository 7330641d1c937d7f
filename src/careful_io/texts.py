"""Numbers and lists as text: probabilities, rates with their intervals, lengths, energies."""

from __future__ import annotations

import math
from typing import Any

SLOW = 3.0  # [m/s] speeds of what is never faster have two decimals
NEGLIGIBLE = 1e-9  # smaller probabilities are below the accuracy of any model


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


def frequency_text(rate: float, low: float, high: float, things: str) -> tuple[str, str]:
    """A rate and its 95 % interval as numbers of 100, 10,000 or a million ``things``.

    >>> frequency_text(0.0282, 0.0259, 0.0306, "flights")
    ('2.8 of 100 flights', '2.6 to 3.1')
    >>> frequency_text(0.623, 0.6171, 0.6301, "flights")
    ('62.3 of 100 flights', '61.7 to 63.0')
    >>> frequency_text(0.0015, 0.001, 0.0021, "flights")
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

    return f"{number(rate)} of {whole:,} {things}", f"{number(low)} to {number(high)}"


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
    """Decimals of speeds in m/s of which ``fastest`` is the largest."""
    return 1 if fastest >= SLOW else 2


def distance_text(metres: float, digits: int = 1) -> str:
    """A length [m] as text in kilometres, or in metres below 2 km, with ``digits`` decimals."""
    return f"{metres / 1e3:,.{digits}f} km" if in_kilometres(metres) else f"{metres:,.{digits}f} m"


def listed_text(names: Any, limit: int = 8) -> str:
    """Up to ``limit`` names, comma-separated, with "..." if there are more; "none" for no name."""
    names = list(names)
    return ", ".join(map(str, names[:limit])) + (", ..." if len(names) > limit else "") or "none"
