"""The law of version 1 in files, and against withheld fields."""

from __future__ import annotations

import json

import numpy as np
import pytest

from careful_io.files import write_json
from noaa import NOAA, needs_noaa
from pareto_ltl.support.errors import DataError
from pareto_ltl.wind.named_laws import law_named, read_law
from wind_laws.documents import first_law
from wind_laws.forecast_error import HOUR

GFS = first_law()


@needs_noaa
@pytest.mark.parametrize(("hours_apart", "measured"), [(6, 1.05), (12, 1.67)])
def test_withheld_fields_are_missed_by_what_the_law_says(hours_apart, measured):
    """The field midway between two others of the shared GFS files, against their mean, over the map of the
    United States. Six hours apart the one withheld is a forecast of 3 h, whose error comes on top."""
    from pareto_ltl_apps.formats.grib_files import grib_snapshots_apart
    from pareto_ltl_apps.formats.snapshots import latest_readings

    files = tuple(sorted((NOAA / "gfs_1p00_10m").iterdir()))
    readings = latest_readings(*grib_snapshots_apart(files, 75.0))
    inside = (np.abs(readings.points[0] - [-96.0, 38.5]) < [20.0, 9.0]).all(axis=1)
    winds = dict(zip(readings.times, (w[inside] for w in readings.winds), strict=True))
    half = hours_apart / 2 * HOUR
    missed = [
        winds[t] - 0.5 * (winds[t - half] + winds[t + half])
        for t in winds
        if t - half in winds and t + half in winds and (t / HOUR) % 6 == (3 if hours_apart == 6 else 0)
    ]
    found = np.sqrt(np.mean(np.square(missed)))
    law = float(GFS.between_variance(np.array(0.5), np.array(hours_apart * HOUR)))
    if hours_apart == 6:
        law += float(GFS.forecast_variance(np.array(3 * HOUR)))
    assert found == pytest.approx(measured, rel=0.15)  # FIELD_NOTES, on other days too
    assert np.sqrt(law) == pytest.approx(found, rel=0.15)


def test_a_law_comes_back_from_its_file(tmp_path):
    write_json(tmp_path / "law.json", GFS.document())
    again = law_named(str(tmp_path / "law.json"))
    assert json.dumps(again.document()) == json.dumps(GFS.document())


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"schema": "pareto_ltl.plan/1"}, r"expected schema 'pareto_ltl.forecast_error/1'"),
        ({"spread": -1}, r"/spread: expected a number above 0"),
        ({"change": {"lag_hours": [3, 2], "sd": [1, 2], "length": 1e5}}, r"lags must increase"),
        ({"change": {"lag_hours": [3], "sd": [1, 2], "length": 1e5}}, r"change_sd must have shape \(1,\)"),
        ({"change": {"lag_hours": [3], "sd": [-1], "length": 1e5}}, r"/change/sd/0"),
    ],
)
def test_a_file_that_is_no_law_is_refused_with_the_place(change, message, tmp_path):
    file = tmp_path / "law.json"
    write_json(file, GFS.document() | change)
    with pytest.raises(DataError, match=message) as caught:
        read_law(file)
    assert str(file) in str(caught.value)
    assert "wind-error" in str(caught.value) or "version" in str(caught.value)
