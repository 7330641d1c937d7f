"""The commands of docs/wind.md run as they stand, as far as the wind in the plane of the map."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import h5netcdf
import numpy as np
import pytest
import yaml

from noaa import NOAA, ROOT, needs_noaa
from pareto_ltl.settings.wind import wind_sources
from pareto_ltl_apps.cli.commands import run_command_line

TEXT = (ROOT / "docs" / "wind.md").read_text()
COMMANDS = [
    " ".join(found.replace("\\\n", " ").split())
    for found in re.findall(r"^    (pareto-ltl plan (?:.*\\\n)*.*)$", TEXT, re.MULTILINE)
]
LIVE = {f"wind={name}" for name, kind in wind_sources().items() if kind.live}  # test_live.py has a server
OFFLINE = [command for command in COMMANDS if not LIVE & set(command.split())]
STAGES = "pipelines.stages=[readings,scene,observations]"


def write_currents(path: Path) -> None:
    """A gyre on a grid of half a degree, at two depths and six-hourly times."""
    lat, lon, hours = np.arange(30.0, 44.0, 0.5), np.arange(-100.0, -84.0, 0.5), np.arange(0.0, 73.0, 6.0)
    shape = (len(hours), 2, len(lat), len(lon))
    coordinates = {
        "time": (hours, {"units": "hours since 2018-10-09 00:00", "standard_name": "time"}),
        "depth": (np.array([0.5, 10.0]), {"units": "m", "positive": "down", "standard_name": "depth"}),
        "lat": (lat, {"units": "degrees_north"}),
        "lon": (lon, {"units": "degrees_east"}),
    }
    with h5netcdf.File(path, "w") as file:
        file.dimensions = dict(zip(coordinates, shape, strict=True))
        for name, (values, told) in coordinates.items():
            file.create_variable(name, (name,), data=values).attrs.update(told)
        for name, values in (("uo", -0.05 * (lat - 37)[:, None]), ("vo", 0.05 * (lon + 92)[None])):
            made = file.create_variable(name, tuple(coordinates), data=np.broadcast_to(values, shape).copy())
            made.attrs.update({"units": "m s-1", "long_name": f"{name} sea water velocity"})


def write_members(path: Path) -> None:
    """Four members on a grid of one degree, that differ by a steady wind."""
    lat, lon, hours = np.arange(27.0, 48.0), np.arange(-105.0, -78.0), np.arange(0.0, 49.0, 6.0)
    shape = (len(hours), 4, len(lat), len(lon))
    coordinates = {
        "time": (hours, {"units": "hours since 2018-10-09 00:00", "standard_name": "time"}),
        "member": (np.arange(4), {"standard_name": "realization"}),
        "lat": (lat, {"units": "degrees_north"}),
        "lon": (lon, {"units": "degrees_east"}),
    }
    with h5netcdf.File(path, "w") as file:
        file.dimensions = dict(zip(coordinates, shape, strict=True))
        for name, (values, told) in coordinates.items():
            file.create_variable(name, (name,), data=values).attrs.update(told)
        start = file.create_variable("reftime", (), data=np.array(0.0))
        start.attrs.update(coordinates["time"][1] | {"standard_name": "forecast_reference_time"})
        for name, word in (("u10", "eastward"), ("v10", "northward")):
            values = 0.2 * (lat - 37)[:, None] + np.arange(4.0)[:, None, None]
            made = file.create_variable(name, tuple(coordinates), data=np.broadcast_to(values, shape).copy())
            made.attrs.update({"units": "m s-1", "standard_name": f"{word}_wind"})


def test_every_source_has_its_line_a_command_and_a_choice():
    for name in wind_sources():
        assert f"| `{name}` |" in TEXT
        if name == "given":  # an object in Python: no command has it
            continue
        choice = yaml.safe_load((ROOT / "conf" / "wind" / f"{name}.yaml").read_text())
        assert choice["source"] == name
    documented = {re.search(r"wind=(\w+)", command)[1] for command in COMMANDS}
    assert documented == set(wind_sources()) - {"sample", "calm", "given"}


@needs_noaa
@pytest.mark.parametrize("command", OFFLINE, ids=lambda text: re.search(r"wind=(\w+)", text)[1])
def test_a_command_of_the_document_runs_as_it_stands(command, tmp_path, monkeypatch, capsys):
    if "wind=grib" in command:
        pytest.importorskip("eccodes")
    write_currents(tmp_path / "currents.nc")
    write_members(tmp_path / "members.nc")
    words = shlex.split(command.replace("DATA", str(NOAA)).replace("examples/", f"{ROOT}/examples/"))[1:]
    words = words[1:]  # `plan` is the command that stands for the application itself
    monkeypatch.chdir(tmp_path)
    assert run_command_line([*words, STAGES, f"hydra.run.dir={tmp_path / 'run'}"]) == 0, capsys.readouterr()
    log = (tmp_path / "run" / "run.log").read_text()
    assert "observations done" in log
