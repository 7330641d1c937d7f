"""Letters that the first font does not have: another installed font draws them, or the log says so."""

from __future__ import annotations

import logging
import warnings
from pathlib import Path

import matplotlib
import pytest
from matplotlib.font_manager import fontManager
from matplotlib.ft2font import FT2Font

from pareto_ltl_apps.view import style

FOLDER = Path(matplotlib.get_data_path()) / "fonts" / "ttf"
NOWHERE = "\U0001fbb8"  # unassigned: no font has it


def letters(file: str) -> set[int]:
    return set(FT2Font(str(FOLDER / file)).get_charmap())


def drawn(text: str) -> bytes:
    with style.report_style():
        figure = style.blank_figure(1.0, 0.5)
        style.text_at(figure, 0.1, 0.1, text)
        return style.figure_bytes(figure, "png", 60)


def test_a_letter_of_another_installed_font_is_drawn_by_it(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    letter = chr(min(letters("STIXGeneral.ttf") - letters("DejaVuSans.ttf")))
    with caplog.at_level(logging.WARNING, "pareto_ltl"):
        boxes = drawn(letter)
    assert letter in caplog.text
    caplog.clear()
    monkeypatch.setattr(fontManager, "ttflist", [*fontManager.ttflist])
    fontManager.addfont(str(FOLDER / "STIXGeneral.ttf"))
    monkeypatch.setattr(style, "OTHER_FONTS", ("Not There", "STIXGeneral"))
    assert style.font_families() == ["DejaVu Sans", "STIXGeneral"]
    plain = drawn("Päijänne 1")
    assert drawn(letter) != boxes
    assert not caplog.records
    monkeypatch.setattr(style, "OTHER_FONTS", ())
    assert drawn("Päijänne 1") == plain  # letters of the first font stay as they are


def test_letters_of_no_font_are_one_warning(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING, "pareto_ltl"):
        drawn(f"a{NOWHERE}b{NOWHERE}")
    (record,) = caplog.records
    assert f"boxes in place of {NOWHERE}, which no installed font has" in record.getMessage()


@pytest.mark.parametrize(
    ("letter", "font"),
    [("ക", "Noto Sans Malayalam"), ("島", "Noto Sans CJK"), ("の", "Noto Sans CJK"), ("ท", "Noto Sans Thai")],
)
def test_a_font_is_named_that_has_the_script_of_the_letter(letter: str, font: str) -> None:
    assert style.font_for(letter) == font


def test_other_warnings_pass() -> None:
    with pytest.warns(UserWarning, match="something else"), style.missing_letters_reported():
        warnings.warn("something else", UserWarning, stacklevel=1)
