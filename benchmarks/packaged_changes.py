"""How D(tau) of held fields depends on the winds at hand: the sections ``change`` of the packaged laws.

    python benchmarks/packaged_changes.py GFS ERA5 SITES [--write]

GFS is a folder of GRIB files of 10 m analyses on a grid of 1 degree, ERA5 the table
``era5_global_1deg_2026-03.npz`` of analyses every 7 h, SITES ``era5_100m_37_sites_2012.npz``, hourly winds.
From each analysis on, the field is held; at the middles of about 800 maps of 300 km, whose readings reach
500 km beyond them, the change of the wind up to 50 h later is compared with what a run knows: spread,
latitude, changes between earlier analyses.

Fitted by maximum likelihood are D at ``NODES``, the power p, the slope q, n_0 and nu_0, with the changes of a
flight distributed as Student's t with n_0 + 2 + w degrees of freedom. A situation is a box of 12 x 24 degrees
in a span of two days; neighbours correlate by 0.3, so that the law counts 75 of them a window. Coverage is of
situations left out (a tenth at a time), by the law as it is flown, with a lognormal scale. The length is of
the Matern-3/2 correlation that fits the changes over 6 to 15 h. D at ``SHORT`` follows from its ratios to
D(6 h) at SITES, with which the law is also compared by season at 100 m.

``--write`` writes the sections into the laws of winds.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy import optimize, stats

from careful_io.files import write_json
from careful_io.times import HOUR
from packaged_laws import rounded
from pareto_ltl.settings import WindConfig
from pareto_ltl.support.arrays import BoolArray, FloatArray
from pareto_ltl.wind.named_laws import law_named, law_of_parts_named
from pareto_ltl.wind.sources import read_readings
from pareto_ltl_apps.wind_errors.scale_mixture import quantiles
from wind_laws.change_law import ChangeLaw
from wind_laws.documents import PARTS_FOLDER
from wind_laws.law_of_parts import LawOfParts
from wind_laws.variability import variability_of

LAWS = ("gfs", "icon_eu", "ecmwf_class", "hourly_fine")  # all laws of winds
NODES = np.array([6.0, 12, 18, 24, 36, 50])  # [h]
SHORT = np.array([1.0, 3.0])  # [h]
MAX_LAG = 50.0  # [h]
SPREAD, LATITUDE = 3.2, 40.0  # S_0 [m/s] and phi_0 [deg] to which the numbers refer
SIDE, BESIDE = 300.0, 500.0  # of a map, and of readings around it [km]
ROWS, EACH_ROW = 5.0, 40  # distance of rows of maps [deg], and maps of a row at the equator
OLDEST = 48.0  # [h] of earlier analyses
BOX, SPAN = (12.0, 24.0), 48.0  # [deg], [h] of a situation
FOLDS, SEED, DRAWS = 10, 0, 400
INDEPENDENT = 3 * 75  # windows, and nearly independent boxes in each: n of the law
SHARES = np.array([0.5, 0.9, 0.99, 0.999])
LENGTH_LAGS = (6.0, 15.0)  # [h]
DISTANCES = np.array([0.0, 60, 120, 180, 250, 350, 450, 600, 800, 1000, 1300])  # [km]
KM_PER_DEGREE = 111.2


class Fields(NamedTuple):
    """Winds (T, lat, lon, 2) [m/s] at hours; lead [h] of each; latitudes and longitudes [deg]."""

    name: str
    hours: FloatArray
    lead: FloatArray
    lat: FloatArray
    lon: FloatArray
    winds: FloatArray


class Changes(NamedTuple):
    """Changes of held fields, a row each.

    ``earlier`` is the mean ratio m for a law with f = 1, times D of that law at S_0 and phi_0 (so that m of
    another law follows by its level), ``freedom`` its number nu; 0 if there were no earlier analyses.
    """

    source: FloatArray
    situation: FloatArray
    latitude: FloatArray
    lag: FloatArray
    spread: FloatArray
    earlier: FloatArray
    freedom: FloatArray
    change: FloatArray  # (N, 2)


# --- data -----------------------------------------------------------------------------------------


def gfs_fields(folder: Path) -> Iterator[Fields]:
    """Each window of consecutive analyses and forecasts."""
    found = read_readings(WindConfig(source="grib", path=str(folder), hold_last=True))
    lon, lat = (np.unique(np.round(found.points[0][:, k], 3)) for k in (0, 1))
    winds = np.full((len(found.times), len(lat), len(lon), 2), np.nan)
    for k, (points, values) in enumerate(zip(found.points, found.winds, strict=True)):
        rows, columns = (np.searchsorted(axis, np.round(points[:, c], 3)) for axis, c in ((lat, 1), (lon, 0)))
        winds[k, rows, columns] = values
    hours, lead = found.times / HOUR, found.leads / HOUR
    for some in np.split(np.arange(len(hours)), np.flatnonzero(np.diff(hours) > 12.0) + 1):
        yield Fields("GFS", hours[some], lead[some], lat, lon, winds[some])


def era5_fields(file: Path) -> Fields:
    """The table of global analyses."""
    with np.load(file, allow_pickle=False) as data:
        winds = np.moveaxis(float(data["scale"]) * data["uv_int16"].astype(float), 1, -1)
        hours = data["hours_since_1970"].astype(float)
        return Fields("ERA5", hours, np.zeros(len(hours)), data["lat"], data["lon"], winds)


def maps() -> Iterator[tuple[float, float]]:
    """Latitude and longitude of the middles of all maps, on nodes of 1 degree."""
    rng = np.random.default_rng(SEED)
    for lat in np.arange(-65.0, 66.0, ROWS):
        count = max(4, round(EACH_ROW * np.cos(np.deg2rad(lat))))
        for lon in np.linspace(-180, 180, count, endpoint=False) + rng.uniform(0, 360 / count):
            yield float(lat), float(np.round(lon))


def square(fields: Fields, lat: float, lon: float, side: float) -> tuple[BoolArray, FloatArray]:
    """The nodes in a square of ``side`` [km], and their positions (n, 2) [m]."""
    east = (fields.lon[None] - lon + 180.0) % 360.0 - 180.0
    y = (fields.lat[:, None] - lat) * KM_PER_DEGREE + 0.0 * east
    x = east * KM_PER_DEGREE * np.cos(np.deg2rad(fields.lat[:, None]))
    inside = (np.abs(x) <= side / 2) & (np.abs(y) <= side / 2)
    return inside, 1e3 * np.stack([x[inside], y[inside]], axis=1)


def changes_of(fields: Fields, number: int, law: LawOfParts) -> Iterator[tuple[float, ...]]:
    """The rows of ``Changes`` of one window of fields, with the source ``number``."""
    rule = law.winds
    assert rule is not None
    for lat, lon in maps():
        inside, points = square(fields, lat, lon, SIDE + 2 * BESIDE)
        row = int(np.argmin(np.abs(fields.lat - lat)))
        column = int(np.argmin(np.abs((fields.lon - lon + 180.0) % 360.0 - 180.0)))
        box = BOX[0] * np.floor(lat / BOX[0]) * 1000 + np.floor(lon / BOX[1])
        for i in np.flatnonzero(fields.lead == 0):
            now = fields.hours[i]
            before = (fields.lead == 0) & (fields.hours <= now) & (fields.hours >= now - OLDEST)
            winds = fields.winds[before][:, inside]
            found = variability_of(law, HOUR * fields.hours[before], points, winds, winds[-1], lat)
            assert found is not None
            assert found.spread is not None
            earlier = 0.0
            if len(found.starts):
                table = law.change_variance(found.ends - found.starts)
                earlier = float((found.squares / table).mean())
            for j in np.flatnonzero(
                (fields.lead == 0) & (fields.hours > now) & (fields.hours <= now + MAX_LAG)
            ):
                change = fields.winds[j, row, column] - fields.winds[i, row, column]
                yield (
                    number, box + 1e6 * np.floor(now / SPAN), lat, fields.hours[j] - now, found.spread,
                    earlier, found.freedom, *change,
                )  # fmt: skip


def table_of(rows: list[tuple[float, ...]]) -> Changes:
    """Rows as arrays."""
    data = np.array(rows)
    source, situation, latitude, lag, spread, earlier, freedom = data[:, :7].T
    return Changes(source, situation, latitude, lag, spread, earlier, freedom, data[:, 7:])


# --- fit ------------------------------------------------------------------------------------------


class Fit(NamedTuple):
    """Logarithms of D at ``NODES``, p, q [1/deg], n_0, nu_0, and the level of the law behind ``earlier``."""

    logs: FloatArray
    power: float
    slope: float
    freedom: float
    most_freedom: float

    def parts(self, of: Changes, law: LawOfParts) -> tuple[FloatArray, FloatArray]:
        """Variance [m2/s2] and degrees of freedom of each change."""
        ratio = np.clip(of.spread / SPREAD, 0.25, 2.5)
        expected = self.power * np.log(ratio) + self.slope * (np.abs(of.latitude) - LATITUDE)
        base = np.interp(np.log(of.lag), np.log(NODES), self.logs) + expected
        level = np.interp(np.log(6.0), np.log(NODES), self.logs) - np.log(law.change_variance(6 * HOUR))
        m = of.earlier / np.exp(expected + level)
        nu = np.where(of.freedom > 0, of.freedom, np.nan)
        w = np.nan_to_num(1.0 / (1.0 / nu + 1.0 / self.most_freedom))
        c = np.where(w > 0, np.clip((self.freedom + w * m) / (self.freedom + w), 0.25, 4.0), 1.0)
        return np.exp(base) * c, self.freedom + 2.0 + w


def fit(of: Changes, law: LawOfParts, start: FloatArray | None = None) -> tuple[Fit, FloatArray]:
    """The fit of greatest likelihood, and its parameters as a start for another one."""

    def of_numbers(x: FloatArray) -> Fit:
        return Fit(x[:-4], x[-4], 0.01 * x[-3], np.exp(x[-2]), np.exp(x[-1]))

    def loss(x: FloatArray) -> float:
        variance, freedom = of_numbers(x).parts(of, law)
        scale = np.sqrt(variance * (freedom - 2.0) / freedom)[:, None]
        return float(-(stats.t.logpdf(of.change / scale, freedom[:, None]) - np.log(scale)).mean())

    if start is None:
        start = np.concatenate([2 * np.log([2.7, 3.9, 4.4, 4.6, 5.8, 6.2]), [1.5, 2.0, 0.7, 1.6]])
    best = optimize.minimize(loss, start, method="BFGS", options={"gtol": 1e-4}).x
    return of_numbers(best), best


def chosen(of: Changes, some: FloatArray) -> Changes:
    """The rows ``some``."""
    return Changes(*(column[some] for column in of))


def coverage(of: Changes, law: LawOfParts, start: FloatArray) -> list[str]:
    """Coverage of situations left out, by source and lag, with a bootstrap over situations."""
    names, member = np.unique(of.situation, return_inverse=True)
    fold = np.random.default_rng(SEED).permutation(len(names))[member] % FOLDS
    z, spread = np.zeros(of.change.shape), np.zeros(len(of.lag))
    for k in range(FOLDS):
        left, here = np.flatnonzero(fold == k), np.flatnonzero(fold != k)
        thin = here[:: max(1, len(here) // 15000)]
        found, _ = fit(chosen(of, thin), law, start)
        variance, freedom = found.parts(chosen(of, left), law)
        z[left] = np.abs(of.change[left]) / np.sqrt(variance)[:, None]
        spread[left] = 0.5 * np.sqrt(log_variance(freedom / 2))
    lines = []
    for source, name in enumerate(("GFS", "ERA5")):
        for low, high in ((6, 9), (12, 15), (18, 24), (27, 39), (40, 50)):
            for known in (False, True):
                rows = np.flatnonzero(
                    (of.source == source) & (of.lag >= low) & (of.lag <= high) & ((of.freedom > 0) == known)
                )
                if len(rows):
                    lines.append(_line(f"{name} {low} to {high} h, earlier {known}", of, rows, z, spread))
    return lines


def one_part_lines(of: Changes) -> Iterator[str]:
    """Coverage by the law of version 1, whose level is of the United States, normal."""
    law = law_named("gfs_one_part")
    for source, name in enumerate(("GFS", "ERA5")):
        rows = (of.source == source) & (of.lag >= 6) & (of.lag <= 15)
        z = np.abs(of.change[rows]) / np.sqrt(law.change_variance(HOUR * of.lag[rows]))[:, None]
        shares = ", ".join(f"{100 * (z <= limit).mean():.1f}" for limit in stats.norm.ppf(0.5 + SHARES / 2))
        yield f"{name} 6 to 15 h, gfs_one_part: {shares} %; rms z {np.sqrt((z**2).mean()):.2f}"


def log_variance(x: FloatArray) -> FloatArray:
    """Variance of the logarithm of a Gamma variable."""
    from scipy.special import polygamma

    return np.asarray(polygamma(1, x), float)


def _line(name: str, of: Changes, rows: FloatArray, z: FloatArray, spread: FloatArray) -> str:
    steps = np.unique(spread[rows].round(2))
    limits = np.stack([quantiles(SHARES, float(s)) for s in steps])
    at = np.searchsorted(steps, spread[rows].round(2))
    inside = (z[rows][:, :, None] <= limits[at][:, None]).mean(axis=1)
    names, member = np.unique(of.situation[rows], return_inverse=True)
    sums = np.stack([np.bincount(member, inside[:, k], len(names)) for k in range(4)], axis=1)
    count = np.bincount(member, minlength=len(names)).astype(float)
    draws = np.random.default_rng(SEED).integers(len(names), size=(DRAWS, len(names)))
    shares = sums[draws].sum(axis=1) / count[draws].sum(axis=1)[:, None]
    low, high = np.quantile(shares, [0.025, 0.975], axis=0)
    text = " | ".join(
        f"{100 * a:.1f} ({100 * b:.1f} to {100 * c:.1f})"
        for a, b, c in zip(inside.mean(axis=0), low, high, strict=True)
    )
    return f"| {name} | {len(names)} | {text} | {np.sqrt((z[rows] ** 2).mean()):.2f} |"


# --- length ---------------------------------------------------------------------------------------


def length_of(sets: list[Fields]) -> float:
    """Length [m] of the Matern-3/2 correlation of changes over ``LENGTH_LAGS``."""
    total, count, far = (np.zeros(len(DISTANCES) - 1) for _ in range(3))
    for fields in sets:
        for lat, lon in list(maps())[::5]:
            inside, points = square(fields, lat, lon, SIDE + 2 * BESIDE)
            apart = np.hypot(*(points[:, None] - points).transpose(2, 0, 1)) / 1e3
            ring = np.digitize(apart, DISTANCES) - 1
            for i in np.flatnonzero(fields.lead == 0):
                lags = fields.hours - fields.hours[i]
                for j in np.flatnonzero((lags >= LENGTH_LAGS[0]) & (lags <= LENGTH_LAGS[1])):
                    change = fields.winds[j][inside] - fields.winds[i][inside]
                    product = change @ change.T / max((change**2).sum(axis=1).mean(), 1e-9)
                    for k in range(len(total)):
                        total[k] += product[ring == k].sum()
                        count[k] += (ring == k).sum()
                        far[k] += apart[ring == k].sum()
    kept, distance = total / count, far / count

    def misfit(length: float) -> float:
        r = np.sqrt(3.0) * distance / length
        return float((((1 + r) * np.exp(-r) - kept) ** 2).sum())

    found = optimize.minimize_scalar(misfit, bounds=(50, 1000), method="bounded").x
    print("correlation", np.round(kept, 2), "at km", np.round(distance))
    return float(np.round(found, -1)) * 1e3


# --- another height, and seasons ------------------------------------------------------------------


class Sites(NamedTuple):
    """Winds (T, P, 2) [m/s] at consecutive hours at places (P, 2), longitude and latitude [deg]."""

    name: str
    hours: FloatArray
    places: FloatArray
    winds: FloatArray


def hourly_sites(file: Path) -> Sites:
    """The places of the table in Europe."""
    with np.load(file, allow_pickle=False) as data:
        winds, places = data["values_int16"].astype(float), data["lonlat"].astype(float)
        europe = places[:, 0] < EUROPE
        return Sites(
            file.stem, data["hours_since_1970"], places[europe], float(data["scale"]) * winds[:, europe]
        )


def pairs_apart(hours: FloatArray, lag: float) -> tuple[FloatArray, FloatArray]:
    """Indices of hours, and of those ``lag`` [h] later."""
    later = np.searchsorted(hours, hours + lag)
    good = np.flatnonzero(later < len(hours))
    good = good[hours[later[good]] == hours[good] + lag]
    return good, later[good]


def ratios(sites: Sites) -> FloatArray:
    """D at ``SHORT`` over D at 6 h."""
    square = []
    for lag in (*SHORT, 6.0):
        now, later = pairs_apart(sites.hours, lag)
        square.append(float(((sites.winds[later] - sites.winds[now]) ** 2).mean()))
    return np.array(square[:-1]) / square[-1]


def sites_lines(sites: Sites, law: LawOfParts) -> Iterator[str]:
    """rms z of held winds at the places, by season and lag; S from places within 500 km."""
    rule = law.winds
    assert rule is not None
    _, hours, place, winds = sites
    apart = arc(place)
    month = (hours.astype("datetime64[h]").astype("datetime64[M]").astype(int)) % 12 + 1
    for name, months in SEASONS.items():
        texts = []
        for lag in (3, 6, 12, 18, 24, 36):
            good, later = pairs_apart(hours, lag)
            some = np.isin(month[good], months)
            good, later = good[some][::7], later[some][::7]
            found = []
            for k in range(len(place)):
                near = (apart[k] <= 500.0).nonzero()[0]
                pairs = (apart[np.ix_(near, near)] > 0) & (apart[np.ix_(near, near)] <= 1000.0)
                if len(near) < FEWEST_NEAR:
                    continue
                here = winds[good][:, near]
                off = ((here[:, :, None] - here[:, None]) ** 2).sum(axis=-1)[:, pairs].mean(axis=1)
                expected = [rule.expected(float(s), float(place[k, 1])) for s in np.sqrt(off / 4.0)]
                change = winds[later, k] - winds[good, k]
                found.append(
                    (change**2).mean(axis=1) / (law.change_variance(HOUR * lag) * np.array(expected))
                )
            texts.append(f"{lag} h: {np.sqrt(np.mean(found)):.2f}")
        yield f"{sites.name} {name}: rms z {', '.join(texts)}"


SEASONS = {
    "Dec to Feb": (12, 1, 2),
    "Mar to May": (3, 4, 5),
    "Jun to Aug": (6, 7, 8),
    "Sep to Nov": (9, 10, 11),
}
EUROPE = 40.0  # [deg] of longitude, east of which places are not compared
FEWEST_NEAR = 4  # places within 500 km


def arc(lonlat: FloatArray) -> FloatArray:
    """Distances [km] between places (n, 2) [deg] on the sphere."""
    lon, lat = np.deg2rad(lonlat).T
    at = np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], axis=1)
    return np.asarray(6371.0 * np.arccos(np.clip(at @ at.T, -1.0, 1.0)), float)


def main() -> None:
    """Fit, print and compare; write the laws."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("gfs", type=Path)
    parser.add_argument("era5", type=Path)
    parser.add_argument("sites", type=Path)
    parser.add_argument("--write", action="store_true")
    options = parser.parse_args()
    windows = list(gfs_fields(options.gfs))
    analyses = era5_fields(options.era5)
    length = length_of([*windows, analyses])
    print(f"length {length / 1e3:.0f} km")
    start = ChangeLaw(SPREAD, 1.5, LATITUDE, 0.02, 2.0, 5.0, 1)
    sites = hourly_sites(options.sites)
    short = ratios(sites)
    print("D at", SHORT, "h over D at 6 h:", np.round(short, 3))

    def table(logs: FloatArray) -> FloatArray:
        return np.concatenate([np.sqrt(short) * np.exp(logs[0] / 2), np.exp(logs / 2)])

    sd = table(2 * np.log([2.7, 3.9, 4.4, 4.6, 5.8, 6.2]))
    lags = HOUR * np.concatenate([SHORT, NODES])
    law = replace(law_of_parts_named("gfs"), winds=start, change_length=length, lags=lags, change_sd=sd)
    rows = [row for window in windows for row in changes_of(window, 0, law)]
    rows += list(changes_of(analyses, 1, law))
    changes = table_of(rows)
    every = chosen(changes, np.arange(0, len(changes.lag), 2))
    found, numbers = fit(every, law)
    for name, some in (
        ("all", every),
        *(
            (s, chosen(changes, np.flatnonzero(changes.source == k)[::2]))
            for k, s in enumerate(("GFS", "ERA5"))
        ),
    ):
        one = found if name == "all" else fit(some, law, numbers)[0]
        print(name, len(some.lag), "sd", np.round(np.exp(one.logs / 2), 2), *(f"{v:.4g}" for v in one[1:]))
    print(*coverage(changes, law, numbers), *one_part_lines(changes), sep="\n")
    origin = (
        "10 m analyses of GFS (9 to 15 October 2018) and ERA5 (25 to 28 March 2026), all latitudes to 65 "
        "degrees: changes of held fields up to 50 h at the middles of maps of 300 km; python "
        "benchmarks/packaged_changes.py"
    )
    rule = ChangeLaw(
        SPREAD, found.power, LATITUDE, found.slope, found.freedom, found.most_freedom, INDEPENDENT, origin
    )
    final = replace(law, winds=rule, change_sd=table(found.logs))
    print(*sites_lines(sites, final), sep="\n")
    for name in LAWS:
        document = law_of_parts_named(name).document()
        document["change"] = final.document()["change"]
        if options.write:
            write_json(PARTS_FOLDER / f"{name}.json", rounded(document))


if __name__ == "__main__":
    main()
