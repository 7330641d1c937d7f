"""Units of speed, in the spellings that files and tables use."""

from __future__ import annotations

import re
from itertools import product

KNOT = 1852.0 / 3600.0  # [m/s]

LENGTHS = {  # [m]
    **dict.fromkeys(("m", "meter", "meters", "metre", "metres", "mtr"), 1.0),
    **dict.fromkeys(("cm", "centimeter", "centimeters", "centimetre", "centimetres"), 0.01),
    **dict.fromkeys(("mm", "millimeter", "millimeters", "millimetre", "millimetres"), 0.001),
    **dict.fromkeys(("km", "kilometer", "kilometers", "kilometre", "kilometres"), 1000.0),
    **dict.fromkeys(("ft", "foot", "feet"), 0.3048),
    **dict.fromkeys(("mi", "mile", "miles", "statutemile", "statutemiles"), 1609.344),
    **dict.fromkeys(("nmi", "nauticalmile", "nauticalmiles"), 1852.0),
}
TIMES = {  # [s]
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), 1.0),
    **dict.fromkeys(("min", "minute", "minutes"), 60.0),
    **dict.fromkeys(("h", "hr", "hrs", "hour", "hours"), 3600.0),
    **dict.fromkeys(("d", "day", "days"), 86_400.0),
}
WORDS = {  # [m/s]
    **dict.fromkeys(("kt", "kts", "kn", "kns", "knot", "knots"), KNOT),
    **dict.fromkeys(("mps", "ms"), 1.0),
    **dict.fromkeys(("kmh", "kph", "kmph"), 1 / 3.6),
    **dict.fromkeys(("mph",), 0.44704),
    **dict.fromkeys(("fps",), 0.3048),
}
FACTORS = WORDS | {
    form.format(length, time): metres / seconds
    for (length, metres), (time, seconds) in product(LENGTHS.items(), TIMES.items())
    for form in ("{}/{}", "{}{}-1", "{}per{}", "{}/{}1")
}
EXPECTED = "m/s, cm/s, km/h, knots, mph or ft/s"
SUPERSCRIPTS = str.maketrans("⁻¹−µ", "-1-u")


def speed_factor(units: str) -> float | None:
    """Metres per second in one unit of speed; None if ``units`` is not a known spelling of one.

    Spaces, underscores, dots and signs of powers do not count, nor do capitals.

    Examples
    --------
    >>> speed_factor("m s**-1"), speed_factor("metres_per_second"), speed_factor("km h-1") * 3.6
    (1.0, 1.0, 1.0)
    """
    plain = re.sub(r"[\s.*^_·{}]+", "", units.translate(SUPERSCRIPTS).lower())
    return FACTORS.get(plain)
