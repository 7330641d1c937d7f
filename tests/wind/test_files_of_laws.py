"""Laws of parts by the names of the setting, and in files of users."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from careful_io.files import write_json
from careful_io.times import HOUR
from pareto_ltl.settings.wind import LAW_WORDS
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl.wind.named_laws import law_named, law_of_parts_named, read_law
from point_forecasts_made import made_law
from wind_laws.documents import LAWS_FOLDER, PARTS_FOLDER, law_of, packaged_laws
from wind_laws.law_of_parts import LawOfParts

LAWS = packaged_laws()


@pytest.mark.parametrize("name", LAWS)
def test_a_law_comes_back_from_its_file(name: str, tmp_path: Path) -> None:
    law = law_of_parts_named(name)
    write_json(tmp_path / "law.json", law.document())
    again = law_of_parts_named(str(tmp_path / "law.json"))
    assert json.dumps(again.document()) == json.dumps(law.document())


def test_the_first_version_is_still_read_and_has_one_part(tmp_path: Path) -> None:
    first = law_named("gfs_one_part")
    assert first.document()["schema"] == "pareto_ltl.forecast_error/1"
    (part,) = first.parts
    assert part.persistence(np.array(6 * HOUR), np.array(3 * HOUR)) == pytest.approx(0.9)
    assert first.tail is None
    assert first.floor == 0.0
    write_json(tmp_path / "law.json", first.document())
    with pytest.raises(DataError, match="is a law of version 1") as caught:
        law_of_parts_named(str(tmp_path / "law.json"))
    assert "\n" not in str(caught.value)


def test_the_words_of_the_setting_are_the_packaged_laws() -> None:
    assert set(LAW_WORDS) == {"auto", "none", "gfs_one_part", *packaged_laws()}
    assert all(isinstance(law_named(name), LawOfParts) for name in packaged_laws())
    assert not law_named("none").parts


def test_a_law_that_is_neither_known_nor_a_file_is_refused_in_one_line() -> None:
    with pytest.raises(ConfigError, match=r"wind\.forecast_error=icon is neither a law nor a file; laws: "):
        law_named("icon")


BAD = {
    "negative": ({"parts": [{"sd": [-0.1]}]}, r"/parts/0/sd/0: expected a number, 0 to 1e6"),
    "zero": ({"parts": [{"sd": [0.0]}]}, "must not be negative, and not 0 at every lead"),
    "lengths": ({"parts": [{"sd": [0.3, 0.4]}]}, r"sd of the part lasting must have shape"),
    "no part": ({"parts": []}, "a law has one to four parts, got none"),
    "floor": ({"floor": 0.5}, r"floor is 1 / \(n \+ 1\)"),
    "truth": ({"truth": "guessed"}, "own.*observed"),
    "version": ({"schema": "pareto_ltl.forecast_error/9"}, "expected schema .*'pareto_ltl.forecast_error/2'"),
    "twice": ({"parts": "twice"}, "the parts of a law have different names, got lasting, lasting"),
    "tails": ({"scale": {"flight": 1.1, "moment": [1.1]}}, "the scale spreads by more than"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_law_that_cannot_be_is_refused_with_the_place(case: str, tmp_path: Path) -> None:
    change, message = BAD[case]
    document = made_law().document()
    for key, value in change.items():
        if key == "parts" and value == "twice":
            document["parts"] = [document["parts"][0]] * 2
        elif key == "parts" and isinstance(value, list) and value:
            document["parts"][0] |= value[0]
        elif isinstance(value, dict):
            document[key] |= value
        else:
            document[key] = value
    write_json(tmp_path / "law.json", document)
    with pytest.raises(DataError, match=message) as caught:
        read_law(tmp_path / "law.json")
    assert str(caught.value).count("\n") == 0


@pytest.mark.parametrize("path", [LAWS_FOLDER / "gfs.json", *sorted(PARTS_FOLDER.glob("*.json"))])
def test_the_packaged_laws_fit_the_schemas_of_files_of_users(path: Path) -> None:
    assert json.dumps(read_law(path).document()) == json.dumps(
        law_of(json.loads(path.read_text())).document()
    )
