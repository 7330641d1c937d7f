"""A wind.nc that is damaged or claims more than it holds is refused in one line."""

from __future__ import annotations

import gc
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

from levels import AT_NIGHT
from pareto_ltl.support.errors import DataError
from pareto_ltl.wind import netcdf
from pareto_ltl.wind.netcdf import read_netcdf, write_netcdf
from pareto_ltl.wind.records import WindField
from pareto_ltl_apps.formats.netcdf_files import WINDS, netcdf_snapshots


def written(tmp_path: Path) -> Path:
    mean = np.ones((2, 3, 4, 2))
    wind = WindField(np.zeros(2), 5.0, np.array([0.0, 9.0]), mean, mean, np.ones((2, 2)), score={"a": np.nan})
    return write_netcdf(wind, tmp_path / "wind.nc")


def replaced(file: h5py.File, name: str, values: object) -> None:
    file[name][...] = values


def refusal(path: Path) -> str:
    with pytest.raises(DataError) as caught:
        read_netcdf(path)
    assert "\n" not in str(caught.value)
    assert str(caught.value).endswith("expected the wind.nc of a run")
    return str(caught.value)


def test_a_variable_that_claims_more_than_the_file_has_is_not_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = written(tmp_path)
    monkeypatch.setattr(netcdf, "FREE_BYTES", 100)
    monkeypatch.setattr(netcdf, "MAX_RATIO", 0)
    assert "u claims 192 bytes, far more than the file has" in refusal(path)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda file: replaced(file, "v", np.nan), "u, v holds a number that is not finite"),
        (lambda file: replaced(file, "v", 1e300), "or above 1e+18"),
        (lambda file: replaced(file, "v_var", -1.0), "a variance is negative"),
        (lambda file: replaced(file, "time", np.array([9.0, 0.0])), "the times do not increase"),
        (lambda file: file.pop("v"), "cannot be read"),
        (lambda file: file.attrs.update(spacing=0.0), "no spacing"),
        (lambda file: file.attrs.update(origin=5.0), "cannot be read"),
        (lambda file: file.attrs.update(score="[1]"), "score is not a JSON object"),
        (lambda file: file.attrs.update(score="[" * 10**5), "cannot be read"),
        (lambda file: file.attrs.update(score='{"a": {}}'), "cannot be read"),
        (lambda file: file.attrs.pop("spacing"), "cannot be read"),
    ],
)  # fmt: skip
def test_a_field_that_no_fit_makes_is_refused(spoil, words: str, tmp_path: Path) -> None:
    path = written(tmp_path)
    assert np.isnan(read_netcdf(path).score["a"])
    with h5py.File(path, "r+") as file:
        spoil(file)
    assert words in refusal(path)


def test_a_damaged_checksum_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path)
    data = bytearray(path.read_bytes())
    for place in range(60, len(data), 977):
        damaged = data.copy()
        damaged[place] ^= 255
        path.write_bytes(damaged)
        try:
            read_netcdf(path)
        except DataError as error:
            assert "\n" not in str(error)


def test_a_file_that_fails_to_open_prints_nothing_when_it_is_discarded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ignored: list[object] = []
    monkeypatch.setattr(sys, "unraisablehook", ignored.append)
    path = written(tmp_path)
    whole = path.read_bytes()
    refused = 0
    for place in range(len(whole) // 2, len(whole), 97 if AT_NIGHT else 997):
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 255]) + whole[place + 1 :])
        for read in (read_netcdf, lambda path: netcdf_snapshots((path,), WINDS, "10m", 150.0)):
            try:
                read(path)
            except DataError:
                refused += 1
        gc.collect()
    assert refused
    assert not ignored
