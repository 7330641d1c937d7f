"""Groups of missions by place and by promise, and conformal limits of how far flights end from their plan."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from careful_io.texts import interval_text, probability_text
from pareto_ltl import Settings
from pareto_ltl.support.arrays import BoolArray
from pareto_ltl.support.resources import PACKAGE
from pareto_ltl_apps.studies import calibration
from pareto_ltl_apps.studies.settings import ForecastTestConfig
from pareto_ltl_apps.studies.tables import Columns, markdown_table

# Of the contiguous United States, with their eastern ends [deg].
LONGITUDES = {"west of 105 W": -105.0, "105 to 90 W": -90.0, "east of 90 W": 180.0}
LATITUDES = {"0 to 25 degrees": 25.0, "25 to 50 degrees": 50.0, "50 to 90 degrees": 90.0}  # north or south
AMERICA = (-130.0, -60.0)  # [deg] an area between these is divided by longitude, another one by latitude
LEVELS = (0.01, 0.03, 0.10, 0.30)  # promises
LAND_FILE = PACKAGE / "support" / "data" / "earth" / "land_1deg.npz"
DEGREE = 111_195.0  # [m] of latitude
LAND, SEA, COAST = "land", "sea", "coast"
LEVEL_KEYS = ("fidelity", "level")
LEAST_SHARE = 0.1  # of the variance of a plan that must be of errors that the flights share
LIMITS = (0.5, 0.8, 0.9, 0.95, 0.99)


def region_of(cfg: ForecastTestConfig, longitude: float, latitude: float) -> str:
    """The region of a mission: a part of the United States, or a range of latitudes."""
    corners = np.array(cfg.area, float)
    least, limit = min(longitude, corners[:, 0].min()), max(longitude, corners[:, 0].max())
    if AMERICA[0] <= least and limit <= AMERICA[1]:
        return next(name for name, end in LONGITUDES.items() if longitude < end)
    return next(name for name, end in LATITUDES.items() if abs(latitude) <= end)


def region_order(region: str) -> int:
    """The place of a region in tables."""
    return [*LONGITUDES, *LATITUDES].index(region)


@lru_cache(maxsize=1)
def land_cells() -> BoolArray:
    """Which cells of 1 degree are mostly land, (180, 360) from 90 S and 180 W.

    A cell with a share of land of at least 1/2 in the 30 arc-second mask of the package global-land-mask
    1.0.0 (MIT; from GLOBE 1999 of NOAA, public domain).
    """
    with np.load(LAND_FILE, allow_pickle=False) as file:
        return np.unpackbits(file["bits"], axis=1).astype(bool)


def surface_of(longitude: float, latitude: float, side: float) -> str:
    """``land`` or ``sea`` if more than nine tenths of a map of this ``side`` [m] are, else ``coast``."""
    steps = np.linspace(-0.5, 0.5, 9) * side / DEGREE
    lat = np.clip(latitude + steps, -89.9, 89.9)[:, None]
    lon = longitude + steps / np.cos(np.deg2rad(lat))
    share = float(
        land_cells()[np.floor(lat).astype(int) + 90, np.floor(lon + 180.0).astype(int) % 360].mean()
    )
    return LAND if share > 0.9 else SEA if share < 0.1 else COAST


# --- by promise ---------------------------------------------------------------------------------


def level_of(promise: float) -> str:
    """The level that is nearest to a promise on a logarithmic scale; of very low and high ones the range."""
    least, limit = LEVELS[0] / math.sqrt(3.0), LEVELS[-1] * math.sqrt(3.0)
    if promise < least:
        return f"below {100 * least:.1f} %"
    if promise >= limit:
        return f"above {100 * limit:.0f} %"
    return f"{100 * min(LEVELS, key=lambda level: abs(math.log(level / promise))):g} %"


def level_table(rows: Sequence[Mapping[str, Any]]) -> list[Columns]:
    """Promised and realised rates by level; plans of one mission at one level are averaged."""
    groups: dict[tuple[str, str, int], list[Mapping[str, Any]]] = {}
    for row in sorted(rows, key=lambda row: float(row[_own_promise(row)])):
        level = level_of(row[_own_promise(row)])
        groups.setdefault((row["fidelity"], level, row["mission"]), []).append(row)
    means = []
    for (fidelity, level, mission), mine in groups.items():
        first, name = mine[0], _own_promise(mine[0])
        mean: Columns = {key: first[key] for key in ("departure", "situation") if key in first}
        mean |= {"fidelity": fidelity, "level": level, "mission": mission}
        mean |= {key: float(np.mean([row[key] for row in mine])) for key in (name, "failure")}
        means.append(mean)
    return calibration.scorecard(means, LEVEL_KEYS)


def _own_promise(row: Mapping[str, Any]) -> str:
    return f"simulated_{Settings.preset(row['fidelity']).law}"


def level_text(cards: Sequence[Columns]) -> str:
    """The table of levels in Markdown."""
    return markdown_table(
        "All plans by promise; intervals with a situation as one trial",
        {
            "planner": "fidelity",
            "level": "level",
            "missions": "missions",
            "situations": lambda card: str(card.get("situations", "-")),
            "promised, mean": lambda card: probability_text(card["promised"]),
            "failed": _by_situation,
        },
        cards,
    )


def _by_situation(card: Mapping[str, Any]) -> str:
    if not math.isfinite(card.get("by_situation_low", math.nan)):
        return probability_text(card["realised"])
    ends = interval_text(card["by_situation_low"], card["by_situation_high"])
    return f"{probability_text(card['realised'])} ({ends})"


# --- conformal limits ---------------------------------------------------------------------------


def limit_table(rows: Sequence[Mapping[str, Any]]) -> list[Columns]:
    """How far flights end from the planned end, in standard deviations of the plan: conformal limits.

    z is the distance between the mean end of the flights and the planned one, over the standard deviation of
    a component that is not in the spread of the flights (gusts, and interpolation where it is drawn). Of n
    situations, each with its first mission, the k-th smallest z, k = ceil((n + 1) c), holds the next mission
    with a probability of at least c, whatever the law (Vovk et al. 2005); there is none if k > n.
    ``law``: the limit of a Gaussian, sqrt(-2 ln(1 - c)).
    """
    found = []
    for fidelity in dict.fromkeys(row["fidelity"] for row in rows):
        first: dict[str, float] = {}
        for row in sorted(
            (row for row in rows if row["fidelity"] == fidelity), key=lambda row: row["mission"]
        ):
            variance = row["sd_m"] ** 2 - row["spread_m"] ** 2
            if variance > LEAST_SHARE * row["sd_m"] ** 2 and math.isfinite(row["miss_m"]):
                first.setdefault(str(row["situation"]), row["miss_m"] / math.sqrt(variance))
        z = np.sort(np.array(list(first.values()), float))
        for level in LIMITS:
            rank = math.ceil((len(z) + 1) * level)
            found.append(
                {
                    "fidelity": fidelity,
                    "share": level,
                    "situations": len(z),
                    "limit": float(z[rank - 1]) if rank <= len(z) else math.inf,
                    "law": math.sqrt(-2.0 * math.log(1.0 - level)),
                }
            )
    return found


def limit_text(cards: Sequence[Columns]) -> str:
    """The table of conformal limits in Markdown."""
    return markdown_table(
        "Distance from the planned end in standard deviations: conformal limits",
        {
            "planner": "fidelity",
            "holds the next mission with": lambda card: probability_text(card["share"]),
            "situations": "situations",
            "limit": lambda card: f"{card['limit']:.2f}" if math.isfinite(card["limit"]) else "too few",
            "of a Gaussian": lambda card: f"{card['law']:.2f}",
        },
        cards,
    )
