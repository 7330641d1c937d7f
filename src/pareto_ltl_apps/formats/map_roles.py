"""The setting ``scene.roles``: what features without the property ``role`` are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from careful_io.messages import shown_value
from pareto_ltl.support.errors import ConfigError

FEATURE_ROLES = ("region", "obstacle", "start", "border", "landmark")
SYNONYMS = {"bounds": "border"}
LEFT_OUT = "none"  # the role of features that are left out
EXPECTED = (
    "be a role for all features without one, or a mapping {FILE: role, PROPERTY: {VALUE: role}, else: role}; "
    f"roles are {', '.join((*FEATURE_ROLES, LEFT_OUT))}"
)


@dataclass(frozen=True, slots=True)
class RoleRules:
    """Roles by the value of a property, by the name of the file, and of all other features; "" for none."""

    common: str = ""
    by_file: Mapping[str, str] = field(default_factory=dict)
    by_property: Mapping[str, Mapping[str, str]] = field(default_factory=dict)

    @classmethod
    def of(cls, setting: Any) -> RoleRules:
        """The rules of ``scene.roles``; ConfigError for a role that does not exist."""
        if isinstance(setting, str):
            return cls(_role(setting, setting))
        if not isinstance(setting, Mapping):
            raise ConfigError(f"scene.roles must {EXPECTED}, got {shown_value(setting)}")
        common, files, properties = "", dict[str, str](), dict[str, dict[str, str]]()
        for key, value in setting.items():
            if isinstance(value, Mapping):
                properties[str(key).strip().lower()] = {
                    str(one).strip().lower(): _role(role, setting) for one, role in value.items()
                }
            elif key == "else":
                common = _role(value, setting)
            else:
                files[Path(str(key)).name] = _role(value, setting)
        return cls(common, files, properties)

    def role(self, file: str, properties: Mapping[str, Any]) -> str:
        """The role of a feature of ``file``; names of ``properties`` are in lower case; "" for none."""
        for key, roles in self.by_property.items():
            value = properties.get(key)
            text = f"{value:g}" if isinstance(value, float) else str(value)
            if found := roles.get(text.strip().lower()):
                return found
        return self.by_file.get(Path(file).name, self.common)


def _role(value: Any, setting: Any) -> str:
    text = "" if value is None else str(value).strip().lower()
    role = SYNONYMS.get(text, text)
    if role not in (*FEATURE_ROLES, LEFT_OUT):
        raise ConfigError(f"scene.roles must {EXPECTED}, got {shown_value(setting)}")
    return role
