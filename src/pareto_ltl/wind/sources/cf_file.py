"""Variables of a NetCDF file, NetCDF-4 (HDF5) or classic format, read in parts."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import DataError
from pareto_ltl.support.messages import shown_text
from pareto_ltl.wind.netcdf import DAMAGE
from pareto_ltl.wind.sources.magic import HDF5, format_of, refuse_other_format

FREE_VALUES = 2**24  # number of values that may be read from a file of any size
MAX_VALUES_A_BYTE = 8  # further values per byte of the file; a compressed field of zeros has a thousand
Part = tuple[int | slice, ...]


@dataclass(frozen=True, slots=True)
class CfVariable:
    """One variable.

    Attributes
    ----------
    name : str
    dimensions : tuple of str
        Names of the dimensions.
    shape : tuple of int
    attributes : dict
        Numbers, arrays and texts.
    data : object
        The packed values of the file, which slices and integers can index.
    """

    name: str
    dimensions: tuple[str, ...]
    shape: tuple[int, ...]
    attributes: Mapping[str, Any]
    data: Any

    def text(self, attribute: str) -> str:
        """A text attribute; empty if there is none."""
        value = self.attributes.get(attribute, "")
        if isinstance(value, np.ndarray):
            value = value.reshape(-1)[0] if value.size == 1 else ""
        return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)

    def number(self, attribute: str) -> float | None:
        """A numeric attribute; None if there is none."""
        value = self.attributes.get(attribute)
        return None if value is None or isinstance(value, str | bytes) else float(np.ravel(value)[0])

    def values(self, part: Part = ()) -> FloatArray:
        """The values of ``part``, with scale and offset applied; NaN for missing values."""
        packed = np.asarray(self.data[part or ...])
        if packed.dtype.kind not in "iuf":
            raise ValueError(f"{self.name} holds {packed.dtype}; expected numbers")
        found = packed.astype(float)
        found[self._is_missing(packed)] = np.nan
        scale, offset = self.number("scale_factor"), self.number("add_offset")
        found = found if scale is None else found * scale
        return found if offset is None else found + offset

    def _is_missing(self, packed: Any) -> Any:
        gone = np.zeros(packed.shape, bool)
        for name in ("_FillValue", "missing_value"):
            for value in np.ravel(self.attributes.get(name, ())):
                gone |= packed == value
        low, high = self.number("valid_min"), self.number("valid_max")
        limits = np.ravel(self.attributes.get("valid_range", ()))
        if len(limits) == 2:
            low, high = float(limits[0]), float(limits[1])
        if low is not None:
            gone |= packed < low
        return gone if high is None else gone | (packed > high)


@dataclass(slots=True)
class CfFile:
    """An open file; ``budget`` is the number of values that may still be read."""

    path: Path
    variables: dict[str, CfVariable]
    budget: int

    def spend(self, count: int) -> None:
        """Subtract ``count`` values from the budget; ValueError if it is exceeded."""
        self.budget -= count
        if self.budget < 0:
            raise ValueError("it claims far more values than a file of its size can hold")

    def read(self, variable: CfVariable, part: Part = ()) -> FloatArray:
        """The values of ``part`` of a variable, of all of it by default."""
        taken = (*part, *(slice(None),) * (len(variable.shape) - len(part)))
        shape = [
            len(range(*index.indices(size)))
            for index, size in zip(taken, variable.shape, strict=True)
            if isinstance(index, slice)
        ]
        self.spend(math.prod(shape))
        return variable.values(taken)


@contextmanager
def open_cf(path: Path) -> Iterator[CfFile]:
    """In the block, the open file; errors of the libraries become a DataError in one line."""
    try:
        with path.open("rb") as stream:
            head = stream.read(64)
        if not head.strip():
            raise DataError(f"wind file {path} is empty; fetch it again")
        refuse_other_format(f"wind file {path}", head, "NetCDF")
        if format_of(head) is None:
            raise DataError(f"wind file {path} is not NetCDF; expected NetCDF-4 or the classic format")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of damaged attributes, and of views that outlive the file
            with _open_hdf5(path) if head[:8] == HDF5 else _open_classic(path) as variables:
                size = path.stat().st_size
                yield CfFile(path, variables, FREE_VALUES + MAX_VALUES_A_BYTE * size)
                variables.clear()
    except (*DAMAGE, MemoryError) as error:
        reason = shown_text(" ".join(str(error).split()), 200) or type(error).__name__
        raise DataError(f"wind file {path} cannot be read ({reason}); is it whole? fetch it again") from None


@contextmanager
def _open_hdf5(path: Path) -> Iterator[dict[str, CfVariable]]:
    import h5netcdf

    with h5netcdf.File(path, "r", phony_dims="access") as file:
        yield {
            name: CfVariable(name, variable.dimensions, variable.shape, dict(variable.attrs), variable)
            for name, variable in file.variables.items()
        }


@contextmanager
def _open_classic(path: Path) -> Iterator[dict[str, CfVariable]]:
    from scipy.io import netcdf_file

    with netcdf_file(path, "r", mmap=True) as file:
        found = {}
        for name, variable in file.variables.items():
            attributes = dict(vars(variable)["_attributes"])  # scipy has no public name for them
            found[name] = CfVariable(
                name, tuple(variable.dimensions), variable.shape, attributes, variable.data
            )
        try:
            yield found
        finally:
            found.clear()
            file.variables.clear()
