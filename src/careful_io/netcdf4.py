"""Opening of NetCDF-4 files (HDF5) that another person may have made."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import h5netcdf
import h5py  # type: ignore[import-untyped]

from careful_io.errors import DataError

File = h5netcdf.File
# ``File.__del__`` reads this attribute, which a file that failed to open does not have yet.
setattr(File, "_writable", False)  # noqa: B010 - a private name of another package
MAX_OBJECTS = 10_000  # groups and variables of a file


@contextmanager
def opened_netcdf(path: Path) -> Iterator[h5netcdf.File]:
    """In the block, the file ``path``; one that fails to open is discarded without a message.

    DataError if its data lie in other files; errors of the libraries are not changed.
    """
    refuse_other_files(path)
    with File(path, "r") as file:
        yield file


def refuse_other_files(path: Path) -> None:
    """DataError if a variable or group of the HDF5 file ``path`` lies in another file, which HDF5 would read.

    HDF5 has three ways to name another file: an external link, external storage and a virtual dataset.
    """
    with h5py.File(path, "r") as file:
        waiting, seen = [file["/"]], 0
        while waiting:
            group = waiting.pop()
            for name in group:
                seen += 1
                if seen > MAX_OBJECTS:
                    raise DataError(f"{path}: has more than {MAX_OBJECTS:,} groups and variables")
                link = group.get(name, getlink=True)
                if isinstance(link, h5py.ExternalLink):
                    raise _elsewhere(path, name)
                if not isinstance(link, h5py.HardLink):
                    continue  # a soft link leads to an object that is visited by its own name
                found = group[name]
                if isinstance(found, h5py.Group):
                    waiting.append(found)
                elif isinstance(found, h5py.Dataset) and (found.external or found.is_virtual):
                    raise _elsewhere(path, name)


def _elsewhere(path: Path, name: str) -> DataError:
    return DataError(
        f"{path}: the data of {name!r} lie in another file, which is not read; copy all data into one file"
    )
