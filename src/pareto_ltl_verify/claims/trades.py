"""Claims about the sentences of report.html on other paths of the front, and on turns in regions."""

from __future__ import annotations

import math

import numpy as np

from careful_io.texts import distance_text
from pareto_ltl_verify.arrays import FloatArray
from pareto_ltl_verify.claims import Claim, Verdict, no_fault
from pareto_ltl_verify.claims.choice import SMALL
from pareto_ltl_verify.claims.page import PAGE, page_data
from pareto_ltl_verify.evidence import Evidence
from pareto_ltl_verify.geometry import within
from pareto_ltl_verify.wording import flights_text

MUCH, LITTLE = 0.9, 0.97  # lengths of shorter paths that are named, as shares of the length
LOOP = np.pi  # sum of the turns at positions in a region [rad]


def trades(result: Evidence) -> Verdict | None:
    """The text of each point is a function of lengths, rates, floor and positions."""
    data = page_data(result)
    if "trades" not in data and "floor" in data:
        return None  # the script of an earlier version made them
    stated, wanted = list(data["trades"]), texts(result)
    faults = [f"point {k}" for k, pair in enumerate(zip(stated, wanted, strict=False)) if pair[0] != pair[1]]
    return no_fault(f"{len(stated)} texts", faults, ["their number"] * (len(stated) != len(wanted)))


def texts(result: Evidence) -> list[str]:
    """The text of each point of the front; empty texts where bounds judge."""
    rows = [
        {key: float(row[key]) for key in ("length_m", "failure", "failure_low", "failure_high")}
        for row in result.front
        if row["failure"]
    ]
    if len(rows) < len(result.front):
        return [""] * len(result.front)
    floor = float((result.plan["promise"] or {}).get("floor", 0.0))
    turned = [regions_turned_in(result, result.front_x(k)) for k in range(len(rows))]
    told = [max(row["failure"], floor) for row in rows]

    def flights(k: int) -> str:
        row = rows[k]
        if row["failure"] < floor:
            return "fewer than " + flights_text(floor, floor, floor)[0]
        return flights_text(row["failure"], row["failure_low"], row["failure_high"])[0]

    def counted(k: int) -> str:
        return f"{100.0 * rows[k]['failure']:.2g} %"

    def instead(other: int, k: int) -> str:
        shorter, own = rows[k]["length_m"] - rows[other]["length_m"], rows[k]["length_m"]
        text = f"Point {other} is {distance_text(abs(shorter))} "
        text += f"({100.0 * shorter / own:.0f} %) shorter: " if shorter > 0.0 else "longer: "
        if flights(other) == flights(k):
            both = f" ({counted(other)} instead of {counted(k)} of the simulated ones)"
            return f"{text}{flights(k)} fail too{both if told[k] <= floor else ''}. "
        number, whole = flights(other).split(" of ")
        alike = flights(k).endswith(f" of {whole}")
        text += f"{number if alike else flights(other)} instead of {flights(k)} fail, "
        return text + "in the winds in which paths are compared. "

    found = []
    for k, row in enumerate(rows):
        text, every = "", range(len(rows))
        little = [n for n in every if rows[n]["length_m"] <= LITTLE * row["length_m"]]
        much = [n for n in little if rows[n]["length_m"] <= MUCH * row["length_m"]]
        if alike := [n for n in little if told[n] <= told[k]]:
            text += instead(min(alike, key=lambda n: rows[n]["length_m"]), k)
        best = min(much or little, key=lambda n: told[n], default=k)
        if told[best] > told[k]:
            text += instead(best, k)
        longer = [n for n in every if rows[n]["length_m"] > row["length_m"] and told[n] < told[k]]
        if longer:
            text += instead(min(longer, key=lambda n: told[n]), k)
        text += exchange([row["length_m"] for row in rows], told, k)
        straight = [n for n in every if not turned[n]]
        best = min(straight, key=lambda n: (rows[n]["failure"], rows[n]["length_m"]), default=k)
        if turned[k] and rows[best]["failure"] > row["failure"]:
            length = distance_text(rows[best]["length_m"])
            text += f"It turns in {' and '.join(turned[k])}, so that more flights meet it: "
            other = f"of the safest path without that (point {best}, {length}) "
            if told[best] > told[k]:
                text += f"{flights(k)} fail; {other}{flights(best)}."
            else:
                text += f"of the simulated ones {counted(k)} fail; {other}{counted(best)}; "
                text += "the data of the law cannot tell these rates apart."
        found.append(text.rstrip())
    return found


def exchange(lengths: list[float], told: list[float], k: int) -> str:
    """What one per cent of length gives: the steepest way to a longer point, the flattest to a shorter."""
    ways = {
        n: math.log((told[k] + SMALL) / (told[n] + SMALL)) / math.log(lengths[n] / lengths[k])
        for n in range(len(told))
        if (lengths[n] - lengths[k]) * (told[k] - told[n]) > 0.0
    }
    more = max((n for n in ways if lengths[n] > lengths[k]), key=lambda n: ways[n], default=None)
    less = min((n for n in ways if lengths[n] < lengths[k]), key=lambda n: ways[n], default=None)
    text = ""
    if more is not None:
        text = f"1 % more length saves at most {ways[more]:.1f} % of the failures (point {more})"
    if less is not None:
        text += ", 1 % less" if text else "1 % less length"
        text += f" adds at least {ways[less]:.1f} %{' to the failures' * (more is None)} (point {less})"
    return text and f"{text}. "


def regions_turned_in(result: Evidence, x: FloatArray) -> list[str]:
    """Names of regions that a path (T+1, 2) [m] enters twice, or turns in by half a turn or more."""
    step = np.diff(x, axis=0)
    ahead = np.arctan2(step[:, 1], step[:, 0])
    turns = np.abs((np.diff(ahead) + np.pi) % (2.0 * np.pi) - np.pi)
    found, forbidden = [], result.scene.get("forbidden", ())
    for name, listed in result.scene["regions"].items():
        parts = listed if np.ndim(listed[0][0]) else [listed]
        inside = np.any([within(np.asarray(part, float), x) for part in parts], axis=0)
        entered = int(inside[0]) + int(np.sum(inside[1:] & ~inside[:-1]))
        if name not in forbidden and (entered > 1 or turns[inside[1:-1]].sum() >= LOOP):
            found.append(name)
    return found


CLAIMS: tuple[Claim, ...] = (
    Claim("page: what other paths give", (PAGE, "front.csv", "front.npz", "plan.json", "scene.json"), trades),
)
