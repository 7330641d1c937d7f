"""The packaged laws of parts, from tables of forecasts, and the coverage of situations left out.

    python benchmarks/packaged_laws.py WINDS [--write]

WINDS is a folder with ``icon_eu_22_points.npz``, ``gefcom2012_7_sites.npz`` and ``openmeteo_nyc.npz``; where
they come from stands in ``SOURCES``. Printed are the laws and coverages, of which docs/wind_error.md has a
part; ``--write`` writes the laws into the package.

The change of the wind in time is of ``packaged_changes.py``, and stays as it is.

``gfs`` has no table of its own. Its variance is c² L / 6 h with c = 0.60 m/s, between 0.62 m/s from 26 pairs
of cycles at 6 h over the United States and 0.58 to 0.62 m/s from New York at 60 to 120 h, where the source is
GFS; the shares, memories, lengths and tails are those of ``icon_eu``.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from careful_io.files import write_json
from careful_io.times import HOUR
from pareto_ltl.wind.named_laws import law_of_parts_named
from pareto_ltl_apps.wind_errors.law_estimate import LawEstimate, estimate_law
from pareto_ltl_apps.wind_errors.point_tables import read_point_table
from wind_laws.documents import PARTS_FOLDER
from wind_laws.error_law import LASTING
from wind_laws.law_of_parts import LawOfParts

GFS_SCALE = 0.60  # c [m/s]
SOURCES = {
    "icon_eu": (
        "icon_eu_22_points.npz",
        "ICON-EU of DWD, 10 m winds at 18 places in Sweden and London, Berlin, Rome, San Sebastian, May to "
        "November 2020 and September 2021, alternate months (GitHub David-Rayner-GVC/pet_data)",
    ),
    "ecmwf_class": (
        "gefcom2012_7_sites.npz",
        "a global model of the class of ECMWF, 10 m winds at 7 wind farms, July 2009 to June 2012, alternate "
        "months (GEFCom2012: Hong, Pinson, Fan 2014; GitHub snunez1/temus, MIT); newer runs are up to 12 h "
        "old; positions are not published, and the lengths are those of icon_eu",
    ),
    "hourly_fine": (
        "openmeteo_nyc.npz",
        "Open-Meteo best match (HRRR to 18 or 48 h, then GFS), 10 m winds at New York, October 2023 to "
        "August 2026, alternate months (GitHub climate-cache/nyc-forecasts, CC BY 4.0); one place: the "
        "lengths are those of icon_eu",
    ),
}
ROUNDED = 4  # decimals of the numbers in a file


def rounded(value: Any) -> Any:
    """Numbers of a document with ``ROUNDED`` decimals."""
    if isinstance(value, float):
        return round(value, ROUNDED)
    if isinstance(value, dict):
        return {key: each if key == "floor" else rounded(each) for key, each in value.items()}
    return [rounded(each) for each in value] if isinstance(value, list) else value


def with_lengths(law: LawOfParts, other: LawOfParts) -> LawOfParts:
    """``law`` with the lengths of the parts of ``other``."""
    lengths = {part.name: part.length for part in other.parts}
    return replace(law, parts=tuple(replace(part, length=lengths[part.name]) for part in law.parts))


def gfs_law(icon: LawOfParts) -> LawOfParts:
    """The law ``gfs``, from the shares of ``icon``."""
    hours = np.array([0.0, 6, 12, 24, 48, 72, 96, 120])
    seen = icon.variance(HOUR * hours[1:], "own")
    parts = []
    for part in icon.parts:
        if part.name == LASTING:
            parts.append(part)
            continue
        share = np.concatenate([[0.0], part.variance(HOUR * hours[1:]) / seen])
        memory = np.interp(HOUR * hours, part.leads, part.memory)
        variance = share * GFS_SCALE**2 * hours / 6.0
        parts.append(replace(part, leads=HOUR * hours, sd=np.sqrt(variance), memory=memory))
    origin = (
        "GFS, 10 m winds: variance c^2 L / 6 h with c = 0.60 m/s, between 0.62 m/s from 26 pairs of cycles "
        "at 6 h over the United States (2016 and 2018) and 0.58 to 0.62 m/s from forecasts for New York at "
        "60 to 120 h; shares, memories, lengths and tails of icon_eu, and its n. "
        + icon.origin[icon.origin.index("The lasting part") :]
    )
    return replace(
        icon,
        name="gfs",
        spread=3.2,
        parts=tuple(parts),
        origin=origin,
        intervals={},
    )


def packaged(folder: Path) -> tuple[dict[str, LawOfParts], dict[str, LawEstimate]]:
    """All laws by name, and the estimates behind them."""
    estimates = {
        name: estimate_law(read_point_table(folder / file), name) for name, (file, _) in SOURCES.items()
    }
    laws = {}
    for name, estimate in estimates.items():
        law = estimate.law
        tail = law.origin[law.origin.index("The lasting part") :]
        runs = f"{len(estimate.table.runs)} runs, verified by newer runs"
        law = replace(law, origin=f"{SOURCES[name][1]}; {runs}. {tail}")
        laws[name] = law if name == "icon_eu" else with_lengths(law, estimates["icon_eu"].law)
    laws |= {"gfs": gfs_law(laws["icon_eu"])}
    return {name: with_change(law, law_of_parts_named(name)) for name, law in laws.items()}, estimates


def with_change(law: LawOfParts, other: LawOfParts) -> LawOfParts:
    """``law`` with the change of the wind in time of ``other``."""
    names = ("lags", "change_sd", "change_length", "winds")
    return replace(law, **{name: getattr(other, name) for name in names})


def coverage_lines(estimates: dict[str, LawEstimate]) -> list[str]:
    """Rows of coverages, of which the table of docs/wind_error.md has a part."""
    lines = []
    for name, estimate in estimates.items():
        for left in sorted(estimate.left_out, key=lambda left: (left.row.kind, left.row.hours)):
            shares = " | ".join(
                f"{100 * share:.{d}f} ({100 * low:.{d}f} to {100 * high:.{d}f})"
                for share, low, high, d in zip(left.covered, left.low, left.high, (1, 1, 2, 2), strict=True)
            )
            row = left.row
            z = float(np.sqrt(np.mean(row.z**2)))
            n = len(np.unique(row.situation))
            lines.append(f"| `{name}` | {row.kind} {row.hours:g} h | {n} | {shares} | {z:.2f} |")
    return lines


def main() -> None:
    """Estimate all laws; compare or write them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--write", action="store_true")
    options = parser.parse_args()
    laws, estimates = packaged(options.folder)
    for name, law in laws.items():
        document = rounded(law.document())
        if options.write:
            PARTS_FOLDER.mkdir(exist_ok=True)
            write_json(PARTS_FOLDER / f"{name}.json", document)
        print(name, document["scale"], *document["parts"], sep="\n  ")
    print(*coverage_lines(estimates), sep="\n")


if __name__ == "__main__":
    main()
