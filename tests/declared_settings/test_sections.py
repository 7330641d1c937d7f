"""Settings of a small program: made of mappings, choices and files; other packages add sections."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any, ClassVar

import pytest

import declared_settings
from careful_io.errors import ConfigError, DataError
from declared_settings import (
    AllSettings,
    CheckedSettings,
    Choices,
    Group,
    setting,
    settings_of,
    with_added_sections,
)
from declared_settings.extensions import installed_entries


@dataclass
class Oven(CheckedSettings, section="oven"):
    """What heats."""

    acts: ClassVar = {"remote": "switch on the oven {}"}
    gone: ClassVar = {"gas": "every oven is electric"}
    power: float = setting(800.0, "heating power", "(0, 3000]", unit="W")
    mode: str = setting("fan", "what heats", choices=("fan", "grill"))
    shelves: list[int] = setting([2], "shelves from below", "[1, 5]", distinct=True)
    remote: str | None = setting(None, "address of the oven")

    def complete(self, settings: Any) -> None:
        """An oven that bakes bread is hot."""
        if settings.name == "bread":
            self.power = 3000.0

    def check_combinations(self) -> None:
        """A grill has one shelf."""
        if self.mode == "grill" and len(self.shelves) > 1:
            raise ConfigError("oven.mode=grill needs one of oven.shelves")


@dataclass
class Settings(AllSettings):
    """All of them."""

    name: str = setting("cake", "what is baked")
    oven: Oven = field(default_factory=Oven)

    def check_combinations(self) -> None:
        """Complete the sections."""
        for section in self.sections():
            section.complete(self)


def test_the_example_of_the_package_does_what_its_comments_say() -> None:
    text = str(declared_settings.__doc__)
    lines = [line[4:] for line in text.splitlines() if line.startswith("    ")]
    split = next(n for n, line in enumerate(lines) if line.startswith("Oven("))
    names: dict[str, Any] = {"__name__": __name__}
    exec("\n".join(lines[:split]), names)
    for line in lines[split : split + 2]:
        code, _, message = line.partition("#")
        with pytest.raises(ConfigError) as caught:
            exec(code, names)
        assert str(caught.value) == message.strip()
    assert eval(lines[split + 2], names) == "positive and at most 3000"


@pytest.mark.parametrize(
    ("sections", "message"),
    [
        ({"oven": {"power": "hot"}}, "oven.power must be a number, got 'hot'"),
        ({"oven": {"shelves": [1, 9]}}, "oven.shelves must lie in [1, 5], got 9"),
        ({"oven": {"shelves": [1, 1]}}, "oven.shelves lists a value twice, got [1, 1]"),
        ({"oven": {"mode": "gas"}}, "oven.mode must be one of fan, grill; got 'gas'"),
        ({"oven": {"mode": "grill", "shelves": [1, 2]}}, "oven.mode=grill needs one of oven.shelves"),
        ({"oven": 3}, "oven must be a choice, a mapping or a settings object, got 3"),
        ({"ovn": {}}, "unknown setting ovn; did you mean oven?"),
        ({"oven": {"light": 1}}, "unknown setting oven.light; there are power, mode, shelves, remote"),
        ({"oven": {"gas": True}}, "oven.gas is no setting any more: every oven is electric; leave it out"),
    ],
)
def test_what_is_wrong_is_one_line_with_the_key(sections: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError) as caught:
        Settings.of(sections)
    assert str(caught.value) == message


def test_values_of_python_become_the_types_of_the_settings() -> None:
    settings = Settings.of({"name": Path("cake"), "oven": {"power": 100, "shelves": (1, 3)}})
    assert repr(settings.name) == "'cake'"
    assert repr(settings.oven.power) == "100.0"
    assert settings.oven.shelves == [1, 3]
    mine = Oven(power=5.0)
    assert Settings.of({"oven": mine}).oven is mine
    assert settings_of(Oven, {"power": 5}, "oven.") == mine


def test_sections_are_found_replaced_and_completed() -> None:
    settings = Settings.of({"name": "bread"})
    assert settings[Oven].power == 3000.0
    assert list(settings.sections()) == [settings.oven]
    assert settings.with_sections(Oven(mode="grill")).oven.mode == "grill"
    assert Settings().with_sections(Oven(remote="10.0.0.1")).inert() == Settings()


def test_every_setting_has_its_key_type_range_and_meaning() -> None:
    found = Settings.by_key()
    assert list(found) == ["name", "oven", "oven.power", "oven.mode", "oven.shelves", "oven.remote"]
    assert found["oven"].is_section
    assert found["oven.remote"].kind_text == "text or null"
    assert Oven.declared("power").meaning == "heating power"
    with pytest.raises(ConfigError, match=r"oven\.power must be positive and at most 3000 \[W\], got -1"):
        found["oven.power"].check(-1)
    with pytest.raises(ConfigError, match=r"oven\.power must be a number, got None"):
        found["oven.power"].check(None)


def test_the_settings_that_a_message_names_are_found() -> None:
    message = "raise oven.power or set oven.mode=grill, since oven.power is 3 W (cake.jpg, oven.light)"
    assert Settings.named_in(message) == {"oven": ["power", "mode"]}


# --- choices and files -------------------------------------------------------------------------


@pytest.fixture
def chosen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> type[Settings]:
    """Settings with the choices ``oven=hot`` and ``oven=sunday``, which sets a name, too."""
    (tmp_path / "oven").mkdir()
    (tmp_path / "oven" / "hot.yaml").write_text("power: 2500")
    (tmp_path / "oven" / "sunday.yaml").write_text("name: roast\noven: {power: 2000, mode: grill}")
    monkeypatch.setattr(Settings, "choices", Choices(lambda group: tmp_path / group, Group("my_ovens.conf")))
    return Settings


def test_the_name_of_a_choice_stands_for_its_values(chosen: type[Settings]) -> None:
    assert chosen.of({"oven": "hot"}).oven == Oven(power=2500.0)
    assert chosen.of_section("oven", "hot") == Oven(power=2500.0)
    with pytest.raises(ConfigError, match="there is no oven 'cold'; there are hot, sunday"):
        chosen.of({"oven": "cold"})
    assert chosen.of({"name": "hot"}).name == "hot"  # no section


def test_a_choice_of_several_sections_gives_way_to_what_is_stated(chosen: type[Settings]) -> None:
    assert chosen.of({"oven": "sunday"}) == Settings("roast", Oven(2000.0, "grill"))
    assert chosen.of({"oven": "sunday", "name": "fish"}).name == "fish"


def test_settings_come_back_from_their_file(tmp_path: Path) -> None:
    settings, file = Settings("bread", Oven(mode="grill")), tmp_path / "settings.yaml"
    file.write_text(settings.as_yaml())
    assert Settings.of_file(file) == settings
    assert Settings.of_file(file, {"oven.mode": "fan"}).oven.mode == "fan"
    file.write_text("oven: {gas: true}")
    assert Settings.of_file(file) == Settings()
    file.write_text("oven: 3")
    with pytest.raises(DataError, match="oven must be keys and values, found 3"):
        Settings.of_file(file, {"oven.mode": "fan"})


# --- sections of other packages ----------------------------------------------------------------


@dataclass
class Timer(CheckedSettings, section="timer", after="name"):
    """When it rings."""

    minutes: int = setting(30, "minutes until it rings", "[1, 600]")


@dataclass
class Plate(CheckedSettings, section="plate"):
    """Under the cake."""


@dataclass
class Thief(CheckedSettings, section="sections"):
    """Takes the name of a method."""


@pytest.fixture
def tables(monkeypatch: pytest.MonkeyPatch) -> Iterator[dict[str, Any]]:
    """Tables of sections, by the names of entry points."""
    found: dict[str, Any] = {}
    monkeypatch.setattr("importlib.metadata.entry_points", lambda group: [
        EntryPoint(name, f"tables:{name}", group) for name in found
    ])  # fmt: skip
    monkeypatch.setattr(EntryPoint, "load", lambda entry: found[entry.name])
    installed_entries.cache_clear()
    yield found
    installed_entries.cache_clear()


def extended() -> Any:
    @dataclass
    @with_added_sections(Group("my_ovens.settings"))
    class More(AllSettings):
        name: str = setting("cake", "what is baked")
        oven: Oven = field(default_factory=Oven)

    return More


def test_sections_stand_where_they_say_else_behind_the_one_before_or_last(tables: dict[str, Any]) -> None:
    tables |= {"kitchen": (Timer, Plate)}
    assert [key for key in extended().by_key() if "." not in key] == ["name", "timer", "plate", "oven"]
    tables["kitchen"] = (Plate,)
    assert [key for key in extended().by_key() if "." not in key] == ["name", "oven", "plate"]
    assert extended().of({"plate": {}})[Plate] == Plate()


@pytest.mark.parametrize("table", [(Oven,), (Thief,)])
def test_a_section_whose_name_is_taken_is_refused(table: Any, tables: dict[str, Any]) -> None:
    tables["kitchen"] = table
    with pytest.raises(ConfigError, match="the name is taken; uninstall it"):
        extended()


@pytest.mark.parametrize("table", [[Timer], (1,), (dict,), None])
def test_what_is_no_table_of_sections_is_refused(table: Any, tables: dict[str, Any]) -> None:
    tables["kitchen"] = table
    with pytest.raises(ConfigError, match="which this group does not take"):
        extended()
