"""Settings as dataclasses whose type, unit, range, choices and meaning are declared beside each field.

    from dataclasses import dataclass, field
    from declared_settings import AllSettings, CheckedSettings, setting

    @dataclass
    class Oven(CheckedSettings, section="oven"):
        power: float = setting(800.0, "heating power", "(0, 3000]", unit="W")
        mode: str = setting("fan", "what heats", choices=("fan", "grill"))

    @dataclass
    class Settings(AllSettings):
        name: str = setting("cake", "what is baked")
        oven: Oven = field(default_factory=Oven)

    Oven(power=0.0)                        # oven.power must be positive and at most 3000 [W], got 0.0
    Settings.of({"oven": {"powr": 900}})   # unknown setting oven.powr; did you mean oven.power?
    Settings.by_key()["oven.power"].declared.range_text()

Each error is a ``ConfigError`` of :mod:`careful_io` in one line that begins with the key.

``declarations`` ``kinds``  a field with its range and meaning; types, and whether a value has one
``sections``                a section, checked when it is made; all settings, from mappings and files
``building`` ``values``     values of Python as the types of fields; checks of pairs, times, names of folders
``choices``                 YAML files whose names stand for the values of a section
``extensions`` ``extras``   what other packages add, by entry points; packages that only some uses need

Programs use the names of this module.
"""

from declared_settings.building import settings_of
from declared_settings.choices import Choices
from declared_settings.declarations import Declaration, Setting, declarations, setting
from declared_settings.extensions import Group
from declared_settings.extras import Extras, install_command
from declared_settings.kinds import field_kinds, fits_kind, is_finite, kind_text
from declared_settings.sections import AllSettings, CheckedSettings, with_added_sections
from declared_settings.values import SEEDS, are_pairs, check_folder_name, check_matrix, check_time

__all__ = [
    "SEEDS",
    "AllSettings",
    "CheckedSettings",
    "Choices",
    "Declaration",
    "Extras",
    "Group",
    "Setting",
    "are_pairs",
    "check_folder_name",
    "check_matrix",
    "check_time",
    "declarations",
    "field_kinds",
    "fits_kind",
    "install_command",
    "is_finite",
    "kind_text",
    "setting",
    "settings_of",
    "with_added_sections",
]
