"""Packages of extras: a missing one is one line with the command that installs it."""

from __future__ import annotations

from pathlib import Path

import pytest

from careful_io.errors import ConfigError
from declared_settings import Extras, extras

OVENS = Extras("my-ovens", {"grill": ("json", "no_such_grill"), "steam": ("json",)})


def test_a_missing_package_is_named_with_the_command() -> None:
    OVENS.require("steam", "to steam")
    with pytest.raises(
        ConfigError, match=r'^to grill needs no_such_grill: .*pip install "my-ovens\[grill\]"'
    ):
        OVENS.require("grill", "to grill")
    assert OVENS.missing("grill", "it").startswith("it needs json and no_such_grill: ")


def test_the_command_is_for_this_environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    python, other = tmp_path / "my env" / "python", tmp_path / "other" / "pip"
    for path in (python, python.with_name("pip"), other):
        path.parent.mkdir(exist_ok=True)
        path.touch(mode=0o755)
    monkeypatch.setattr(extras.sys, "executable", str(python))
    monkeypatch.setattr(extras, "find_spec", lambda name: object())
    monkeypatch.setenv("PATH", str(python.parent))
    assert OVENS.install_command("grib") == 'pip install "my-ovens[grib]"'
    monkeypatch.setenv("PATH", str(other.parent))
    assert OVENS.install_command("grib") == f"'{python}' -m pip install \"my-ovens[grib]\""
    monkeypatch.setattr(extras, "find_spec", lambda name: None)
    (other.parent / "uv").touch(mode=0o755)
    assert OVENS.install_command("grib") == f"uv pip install \"my-ovens[grib]\" --python '{python}'"
