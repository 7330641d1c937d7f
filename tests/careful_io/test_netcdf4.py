"""A damaged NetCDF file makes no noise beside its error."""

from __future__ import annotations

import gc
import sys
from pathlib import Path
from typing import Any

import h5py
import pytest

from careful_io import netcdf4


def noise_of_damaged_files(path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What Python would print as "Exception ignored in ...", over files with one byte changed.

    h5netcdf opens the file, then reads the attribute ``_nc3_strict``: a fault there ends its constructor
    before it sets ``_writable``, which its ``__del__`` reads.
    """
    with h5py.File(path, "w") as file:
        file.attrs["_nc3_strict"] = 1
    whole = path.read_bytes()
    heard: list[str] = []

    def hook(unraisable: Any) -> None:
        heard.append(f"{unraisable.object.__qualname__}: {unraisable.exc_value}")

    refused = 0
    gc.collect()
    with monkeypatch.context() as patched:
        patched.setattr(sys, "unraisablehook", hook)
        for place in range(0, len(whole), 3):
            path.write_bytes(whole[:place] + bytes([whole[place] ^ 255]) + whole[place + 1 :])
            try:
                netcdf4.File(path, "r").close()
            except (OSError, ValueError, TypeError, KeyError, RuntimeError):
                refused += 1
        gc.collect()
    assert refused
    return heard


def test_a_file_that_h5netcdf_cannot_open_is_discarded_without_exception_ignored(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert noise_of_damaged_files(tmp_path / "wind.nc", monkeypatch) == []


def test_without_our_attribute_h5netcdf_prints_exception_ignored(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """If this fails, h5netcdf is mended, and ``careful_io/netcdf4.py`` can go."""
    monkeypatch.delattr(netcdf4.File, "_writable")
    heard = noise_of_damaged_files(tmp_path / "wind.nc", monkeypatch)
    assert heard
    assert all(line.startswith("File.") and "_writable" in line for line in heard)
