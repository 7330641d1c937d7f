"""Archives of arrays are believed only as far as their bytes go."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from careful_io import archives
from careful_io.archives import read_npz
from careful_io.files import write_npz
from pareto_ltl.support.errors import DataError


def npy(array: Any, claimed: tuple[int, ...] | None = None) -> bytes:
    """The bytes of ``array``, whose header may claim another shape."""
    file = io.BytesIO()
    array = np.asarray(array)
    if claimed is None:
        np.lib.format.write_array(file, array, allow_pickle=True)
    else:
        told = {"descr": array.dtype.str, "fortran_order": False, "shape": claimed}
        np.lib.format.write_array_header_1_0(file, told)
        file.write(array.tobytes())
    return file.getvalue()


def refusal(path: Path, *entries: tuple[str, bytes]) -> str:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as zipped:
        for name, data in entries:
            zipped.writestr(name, data)
    with pytest.raises(DataError) as caught:
        read_npz(path)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_a_header_that_claims_terabytes_is_refused_by_the_size_of_its_data(tmp_path: Path) -> None:
    message = refusal(tmp_path / "a.npz", ("a.npy", npy(np.zeros(3), (10**12,))))
    assert "a.npy claims float64 of shape (1000000000000,)" in message
    assert "run the plan again" in message


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (npy(np.zeros(4), (-1, -4)), "header that is not understood"),
        (npy(np.zeros(4), (2, 1)), "is not the size of its data"),
        (npy(np.array([{}])), "expected numbers or text"),
        (npy(np.zeros(1, "datetime64[s]")), "expected numbers or text"),
        (npy(np.zeros(3))[:20], "header that is not understood"),
        (b"", "not an array"),
        (b"\x93NUMPY\x09\x00", "not an array of NumPy's format"),
        (npy(np.zeros(3)) + b"more", "is not the size of its data"),
    ],
)
def test_an_array_that_is_none_is_refused(data: bytes, words: str, tmp_path: Path) -> None:
    message = refusal(tmp_path / "a.npz", ("a.npy", data))
    assert words in message


def test_an_archive_that_unpacks_to_far_more_than_it_holds_is_refused_unread(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(archives, "FREE_BYTES", 2**20)
    message = refusal(tmp_path / "a.npz", ("a.npy", npy(np.zeros(2**20))))
    assert "unpack to 8,388,736" in message


def test_two_arrays_of_one_name_are_refused(tmp_path: Path) -> None:
    with pytest.warns(UserWarning, match="Duplicate name"):
        assert "two arrays have one name" in refusal(
            tmp_path / "a.npz", ("a.npy", npy(np.zeros(1))), ("a.npy", npy(np.zeros(2)))
        )


def test_an_archive_with_a_damaged_byte_is_refused(tmp_path: Path) -> None:
    write_npz(tmp_path / "a.npz", {"a": np.arange(1000)})
    data = bytearray((tmp_path / "a.npz").read_bytes())
    data[len(data) // 2] ^= 255
    (tmp_path / "a.npz").write_bytes(data)
    with pytest.raises(DataError, match="not an archive of arrays"):
        read_npz(tmp_path / "a.npz")


def test_what_is_read_can_be_written_to(tmp_path: Path) -> None:
    arrays = {"a": np.asfortranarray(np.arange(6.0).reshape(2, 3)), "b": np.array(["x", "yz"])}
    write_npz(tmp_path / "a.npz", arrays)
    back = read_npz(tmp_path / "a.npz")
    for name, array in arrays.items():
        np.testing.assert_array_equal(back[name], array)
    back["a"][0, 0] = 7.0
