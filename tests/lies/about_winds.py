"""False values in the wind: its fit, the parts of its error, and their correlations in time."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import numpy as np

from lies.editing import Lie, both, in_metrics, in_wind, put, scaled, setting
from pareto_ltl_verify.wind_law import error_law
from pareto_ltl_verify.wind_tables import ENSEMBLE, LASTING, OF_FORECASTS, TIME


def _times(name: str, factor: float) -> Callable[[Any], Any]:
    def change(file: Any) -> None:
        file[name][...] = file[name][...] * factor

    return change


def _forget_readings(file: Any) -> None:
    for name in [name for name in file if name.startswith("reading_")]:
        del file[name]


def _quieter(file: Any) -> None:
    _times("u_gust_var", 0.5)(file)
    _times("u_noise_sd", 0.5**0.5)(file)


def _one_node(file: Any) -> None:
    values = file["u"][...]
    values[0, 2, 3] += 0.5
    file["u"][...] = values


WIND_LIES = (
    Lie("the mean wind is weaker", in_wind(_times("u", 0.9)), ("wind: mean and variance are the posterior",)),
    Lie(
        "the mean wind of one node is another",
        in_wind(_one_node),
        ("wind: mean and variance are the posterior",),
    ),
    Lie(
        "the variance is halved",
        in_wind(_times("v_var", 0.5)),
        ("wind: mean and variance are the posterior",),
    ),
    Lie("the gust variance is halved", in_wind(_times("u_gust_var", 0.5)), ("wind: white variance",)),
    Lie("gusts and noise are halved", in_wind(_quieter), ("wind: mean and variance are the posterior",)),
    Lie("the modes are smaller", in_wind(_times("v_modes", 0.9)), ("wind: modes of interpolation in space",)),
    Lie(
        "the readings are weaker",
        in_wind(_times("reading_u", 0.9)),
        ("wind: mean and variance are the posterior", "wind: prior mean, noise and kernel"),
    ),
    Lie(
        "the readings are gone", in_wind(_forget_readings), ("wind: there are readings, or the air is calm",)
    ),
    Lie(
        "errors last less long",
        both(in_wind(lambda f: f.attrs.update(rho=0.2)), in_metrics({"wind_rho": 0.2})),
        ("wind: persistence rho",),
    ),
    Lie(
        "gusts last less long",
        in_wind(lambda f: f.attrs.update(gust_time=100.0)),
        ("wind: lattice, slots and settings",),
    ),
    Lie("the air is calmer", in_metrics({"wind_speed_m_s": 1.0}), ("wind: metrics",)),
    Lie("the score is better", in_metrics({"gp_z_sd": 1.0}), ("wind: metrics",)),
)


def _law(change: Callable[[dict[str, Any]], Any]) -> Callable[[Any], Any]:
    """Change the law of forecast errors."""

    def edit(file: Any) -> None:
        told = json.loads(file.attrs["forecast_error"])
        change(told)
        file.attrs["forecast_error"] = json.dumps(told)

    return edit


def _calmer(told: dict[str, Any]) -> None:
    """A smaller factor of the changes of the wind, and changes that fit it."""
    told["variability"]["factor"] *= 0.5
    scaled(told, "change", "sd", factor=np.sqrt(0.5))


def _unscaled(told: dict[str, Any]) -> None:
    scaled(told, "change", "sd", factor=told.pop("variability")["factor"] ** -0.5)


def _without_forecasts(file: Any) -> None:
    law = error_law(json.loads(file.attrs["forecast_error"]))
    for name in ("u_var", "v_var"):
        file[name][...] = file[name][...] - law.forecast_variance(file["lead"][...])[:, None, None]


def _no_modes_of(*parts: int) -> Callable[[Any], Any]:
    def change(file: Any) -> None:
        owner = file["mode_part"][...]
        lost = np.isin(owner, parts)
        for name in ("u_modes", "v_modes"):
            file[name][...] = np.where(lost, 0.0, file[name][...])
        file["mode_part"][...] = np.where(lost, -1, owner)

    return change


def _fine_forecasts(file: Any) -> None:
    """Forecasts without error, everywhere in the file."""
    _without_forecasts(file)
    _no_modes_of(*OF_FORECASTS.values())(file)
    _law(lambda told: put(told, "parts", value=[]))(file)


def _longer(told: dict[str, Any]) -> None:
    """Memories of errors that are ten times as long."""
    for part in told["parts"]:
        part["memory_hours"] = [None if hours is None else 10.0 * hours for hours in part["memory_hours"]]


def _gaussian(told: dict[str, Any]) -> None:
    """A scale that is 1 in every flight."""
    told["scale"].update(flight=0.0, moment=[0.0] * len(told["scale"]["moment"]))


def _first_version(told: dict[str, Any]) -> None:
    """The errors of one part, with its memory, in the words of the first version."""
    part = told.pop("parts")[-1]
    for name in ("scale", "n", "floor", "truth", "origin", "intervals"):
        del told[name]
    keys = {name: part[name] for name in ("lead_hours", "sd", "length")}
    memory = {"persistence": np.exp(-1.0), "persistence_hours": part["memory_hours"][0]}
    told.update(schema="pareto_ltl.forecast_error/1", forecast=keys | memory)


def _shorter(name: str, factor: float) -> Callable[[Any], Any]:
    return lambda file: file.attrs.modify(name, file.attrs[name] * factor)


def _modes_of(part: int, factor: float) -> Callable[[Any], Any]:
    def change(file: Any) -> None:
        share = np.where(file["mode_part"][...] == part, factor, 1.0)
        file["u_modes"][...] = file["u_modes"][...] * share

    return change


def _turned(file: Any) -> None:
    """The modes of one slot with opposite signs: the covariance of each slot does not change."""
    values = file["v_modes"][...]
    values[3] = -values[3]
    file["v_modes"][...] = values


def _other_part(file: Any) -> None:
    owner = file["mode_part"][...]
    file["mode_part"][...] = np.where(owner == TIME, ENSEMBLE, owner)


ERROR_LIES = (
    Lie(
        "forecasts are younger",
        in_wind(_times("lead", 0.5)),
        ("wind: mean and variance are the posterior",),
        only="full",
    ),
    Lie(
        "the variance of forecasts is left out",
        in_wind(_without_forecasts),
        ("wind: mean and variance are the posterior",),
        only="full",
    ),
    Lie("forecasts have no error", in_wind(_fine_forecasts), ("wind: law of forecast errors",), only="full"),
    Lie(
        "modes of forecasts are smaller",
        in_wind(_modes_of(LASTING, 0.9)),
        ("wind: modes of lasting part of the forecast",),
        only="full",
    ),
    Lie(
        "errors of forecasts last less long",
        in_wind(_law(lambda told: put(told, "parts", 0, "memory_hours", value=[3.0]))),
        ("wind: law of forecast errors",),
        only="full",
    ),
    Lie(
        "errors of forecasts last ten times as long",
        in_wind(_law(_longer)),
        ("wind: law of forecast errors",),
        only="full",
    ),
    Lie("errors have no tails", in_wind(_law(_gaussian)), ("wind: law of forecast errors",), only="full"),
    Lie(
        "errors that last are narrower",
        in_wind(_law(lambda told: scaled(told, "parts", 0, "length", factor=0.5))),
        ("wind: law of forecast errors", "wind: modes of lasting part of the forecast"),
        only="full",
    ),
    Lie(
        "a part of the errors is left out",
        in_wind(_law(lambda told: told["parts"].pop())),
        ("wind: law of forecast errors", "wind: mean and variance are the posterior"),
        only="full",
    ),
    Lie(
        "the law has more data",
        in_wind(_law(lambda told: told.update(n=10_000, floor=1.0 / 10_001))),
        ("wind: law of forecast errors",),
        only="full",
    ),
    Lie(
        "the law is of the first version",
        in_wind(_law(_first_version)),
        ("wind: law of forecast errors", "wind: mean and variance are the posterior"),
        only="full",
    ),
    Lie(
        "the wind changes less between fields",
        in_wind(_law(lambda told: scaled(told, "change", "sd", factor=0.5))),
        ("wind: law of forecast errors",),
    ),
    Lie("the wind varies less", in_wind(_law(_calmer)), ("wind: variability of the wind",), only="full"),
    Lie("no analyses were used", in_wind(_law(_unscaled)), ("wind: variability of the wind",), only="full"),
    Lie(
        "two analyses differ less",
        in_wind(_law(lambda told: scaled(told, "variability", "mean_square", factor=0.5))),
        ("wind: variability of the wind",),
        only="full",
    ),
    Lie(
        "interpolation in time is left out of the modes",
        in_wind(_no_modes_of(TIME)),
        ("wind: number of modes", "wind: share of the variance in the modes"),
    ),
    Lie(
        "modes of interpolation in time are smaller",
        in_wind(_modes_of(TIME, 0.9)),
        ("wind: modes of interpolation in time",),
    ),
    Lie("interpolation in time is an ensemble", in_wind(_other_part), ("wind: number of modes",)),
    Lie("the modes of a slot are turned", in_wind(_turned), ("wind: modes of one slot match the next",)),
    Lie(
        "the modes carry more",
        in_wind(_times("u_energy", 1.1)),
        ("wind: share of the variance in the modes", "wind: metrics"),
    ),
    Lie(
        "what the modes leave averages out sooner",
        in_wind(_shorter("rest_length", 0.5)),
        ("wind: length of what the modes leave",),
    ),
    Lie(
        "one slot has another length scale",
        in_wind(lambda file: file["u_prior_length"].__setitem__(0, 2 * file["u_prior_length"][0])),
        ("wind: prior mean, noise and kernel",),
    ),
    Lie("the wind is known for longer", in_wind(_shorter("known_until", 2.0)), ("wind: known until",)),
    Lie(
        "the wind belongs to another level",
        in_wind(lambda file: file.attrs.update(level="100m")),
        ("wind: law of forecast errors",),
    ),
    Lie(
        "the wind of the sample belongs to another level",
        in_wind(lambda file: file.attrs.update(level="100m")),
        ("wind: level and leads",),
        only="paper",
    ),
    Lie(
        "the wind of a table belongs to another level",
        in_wind(lambda file: file.attrs.update(level="100m")),
        ("wind: level and leads",),
        only="full",
    ),
    Lie(
        "the wind is from other files",
        in_wind(lambda file: file.attrs.update(source="grib: newer.grib2")),
        ("wind: source", "plan: errors that its rates cover"),
    ),
    Lie(
        "the wind names a file that was not read",
        in_wind(lambda file: file.attrs.update(source=f"{file.attrs['source']}, newer.csv")),
        ("wind: source",),
    ),
    Lie(
        "the settings name a table of winds that was not read",
        setting("wind", "path", "/data/other.csv"),
        ("settings: files that they name",),
        only="full",
    ),
    Lie(
        "the settings have a law of a file that was not read",
        setting("wind", "forecast_error", "/data/other.json"),
        ("settings: files that they name",),
        only="full",
    ),
    Lie(
        "the wind reaches farther beyond the map by its settings",
        setting("wind", "padding", 300_000.0),
        ("settings: lattices of the wind",),
    ),
    Lie(
        "the modes are finer by their settings",
        setting("wind", "modes_spacing", 50_000.0),
        ("settings: lattices of the wind",),
    ),
    Lie(
        "fewer readings a time are allowed than there are",
        setting("wind", "max_points", 20),
        ("settings: limits",),
    ),
    Lie(
        "slower winds are refused than the readings have",
        setting("wind", "max_speed", 0.5),
        ("settings: limits",),
    ),
)
