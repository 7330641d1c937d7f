"""How many features a map may have."""

from __future__ import annotations

import re

from pareto_ltl.support.errors import DataError

MAX_FEATURES = 50_000  # of a map; 20,000 take 8 s


def refuse_many_features(where: str, data: bytes, mark: bytes) -> None:
    """DataError if the pattern ``mark``, once in each feature, occurs too often; it reads no more."""
    if sum(1 for _ in re.finditer(mark, data)) > MAX_FEATURES:
        raise DataError(
            f"{where} has more than {MAX_FEATURES:,} features; keep those near the mission, or unite them"
        )
