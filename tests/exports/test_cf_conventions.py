"""``trajectory.nc`` in two readers of the CF conventions: cf_xarray, and the checker of IOOS, if installed.

The checker needs netCDF4 and cf-units, compiled packages that no other test needs, so the lock is without it:
``pip install compliance-checker`` adds it. It reads the table of standard names that it ships.
"""

from __future__ import annotations

import json
from pathlib import Path

import cf_xarray  # noqa: F401 - the accessor .cf
import numpy as np
import pytest
import xarray

from exported_plans import Flown


def test_coordinates_and_roles_are_those_of_the_conventions(flown: Flown) -> None:
    with xarray.open_dataset(flown.folder / "trajectory.nc", engine="h5netcdf") as found:
        log = flown.exported.log
        assert found.cf.cf_roles == {"trajectory_id": ["trajectory"]}
        np.testing.assert_array_equal(found.cf["latitude"], log.lat)
        np.testing.assert_array_equal(found.cf["longitude"], log.lon)
        assert {key: names for key, names in found.cf.axes.items() if key in "XYT"} == {
            "X": ["lon"], "Y": ["lat"], "T": ["time"],
        }  # fmt: skip
        np.testing.assert_array_equal(found.cf["platform_speed_wrt_air"][:-1], log.airspeed)
        np.testing.assert_array_equal(found.cf["wind_from_direction"][:-1], log.wind_from)
        assert set(found["airspeed"].cf.coordinates) >= {"time", "latitude", "longitude"}


def test_the_checker_of_the_conventions_has_no_remark(flown: Flown, tmp_path: Path) -> None:
    pytest.importorskip(
        "compliance_checker", reason="compliance-checker is not installed: it needs netCDF4 and cf-units"
    )
    from compliance_checker.runner import CheckSuite, ComplianceChecker

    CheckSuite.load_all_available_checkers()
    report = tmp_path / "report.json"
    passed, errors = ComplianceChecker.run_checker(
        str(flown.folder / "trajectory.nc"), ["cf:1.8"], 0, "strict",
        output_filename=str(report), output_format="json",
    )  # fmt: skip
    told = json.loads(report.read_text())["cf:1.8"]
    remarks = [
        remark
        for level in ("high_priorities", "medium_priorities", "low_priorities")
        for part in told[level]
        for remark in part["msgs"]
    ]
    assert remarks == []
    assert passed
    assert not errors
