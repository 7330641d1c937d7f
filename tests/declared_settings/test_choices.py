"""Files of choices: of the program and of other packages, by name."""

from __future__ import annotations

from pathlib import Path

import pytest

from careful_io.errors import ConfigError, DataError
from declared_settings import Choices, Group


@pytest.fixture
def choices(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Choices:
    """Choices in ``own``, and in ``added`` of another package."""
    for place, text in (("own/oven/hot", "power: 3000"), ("own/oven/cool", ""), ("added/oven/wood", "3")):
        file = tmp_path / f"{place}.yaml"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
    monkeypatch.setattr(Group, "folders", lambda _group: (tmp_path / "added",))
    return Choices(lambda group: tmp_path / "own" / group, Group("my_ovens.conf"))


def test_choices_of_both_are_listed_and_read(choices: Choices, tmp_path: Path) -> None:
    assert choices.names("oven") == ["cool", "hot", "wood"]
    assert choices.names("shelf") == []
    assert choices.file("oven", "wood") == tmp_path / "added" / "oven" / "wood.yaml"
    assert choices.values("oven", "hot") == {"power": 3000}
    assert choices.values("oven", "cool") == {}


@pytest.mark.parametrize("name", ["wild", "../oven/hot", "a" * 100_000, "no\0name", "", "*"])
def test_a_name_of_no_choice_is_refused_with_the_choices(name: str, choices: Choices) -> None:
    with pytest.raises(ConfigError, match=r"^there is no oven .*; there are cool, hot, wood$") as caught:
        choices.file("oven", name)
    assert len(str(caught.value)) < 200


def test_a_file_without_keys_is_refused(choices: Choices) -> None:
    with pytest.raises(DataError, match=r"wood\.yaml: expected keys and values, found int"):
        choices.values("oven", "wood")


@pytest.mark.parametrize("taken", ["own", "added"])
def test_a_name_that_is_taken_is_refused(
    taken: str, choices: Choices, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "more" / "oven").mkdir(parents=True)
    (tmp_path / "more" / "oven" / ("hot.yaml" if taken == "own" else "wood.yaml")).touch()
    folders = (tmp_path / "added", tmp_path / "more")
    monkeypatch.setattr(Group, "folders", lambda _group: folders)
    with pytest.raises(ConfigError, match=r"there is another choice conf/oven/(hot|wood); rename this one"):
        choices.names("oven")
