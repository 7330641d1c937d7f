"""Wind files on the command line: the source follows from their content."""

from __future__ import annotations

import pytest

from pareto_ltl.support.errors import ConfigError
from pareto_ltl_apps.cli.composition import opened_hydra, parse_flags, prepare

TABLE = "time,lat,lon,u,v\n2018-10-09T18:00:00Z,37,-92,1,2\n"
REPORTS = "icaoId,obsTime,wdir,wspd,lat,lon\nKSGF,1539107580,270,10,37.2,-93.4\n"


def wind_of(*words):
    arguments = parse_flags(["+experiment=phi1", *words])
    with opened_hydra(arguments) as hydra:
        prepared = prepare(hydra, arguments)
    assert prepared.pipeline is not None
    return prepared.pipeline.settings.wind


@pytest.mark.parametrize(("content", "source"), [(TABLE, "csv"), (REPORTS, "stations")])
@pytest.mark.parametrize("key", ["wind", "wind.path"])
def test_a_file_without_a_source_is_read_by_the_one_that_its_content_needs(tmp_path, content, source, key):
    file = tmp_path / "my winds.csv"
    file.write_text(content)
    wind = wind_of(f"{key}='{file}'")
    assert (wind.source, wind.path) == (source, str(file))


def test_a_source_that_reads_no_file_beside_a_file_is_refused(tmp_path):
    (tmp_path / "w.csv").write_text(TABLE)
    with pytest.raises(ConfigError, match=r"is not read by wind.source=sample: leave out wind=sample"):
        wind_of("wind=sample", f"wind.path={tmp_path / 'w.csv'}")


def test_a_file_that_is_not_there_is_named_with_the_choices(tmp_path):
    with pytest.raises(
        ConfigError, match=r"none.csv: there is no such file or folder; expected .* calm, csv"
    ):
        wind_of(f"wind={tmp_path / 'none.csv'}")
