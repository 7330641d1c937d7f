"""The models that plans are made with, and their presets."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

from careful_io.messages import shown_text
from declared_settings import CheckedSettings, setting
from pareto_ltl.support.errors import ConfigError

LAWS = ("independent", "coherent")
BORDERS = ("open", "wall")
MISSION_BOUNDS = ("theorem2", "ordered")
COLLISION_BOUNDS = ("step", "path")
PARENTS = "dominance"
REFINEMENTS = ("none", "convex", "sampled")
JUDGES = ("bound", "flights")

PRESETS: dict[str, dict[str, str]] = {
    "paper": {
        "law": "independent", "border": "open", "mission_bound": "theorem2",
        "collision_bound": "step", "parents": PARENTS, "refine": "convex", "judge": "bound",
    },
    "full": {
        "law": "coherent", "border": "wall", "mission_bound": "ordered",
        "collision_bound": "path", "parents": PARENTS, "refine": "sampled", "judge": "flights",
    },
}  # fmt: skip
DEFAULT = "full"
_USUAL = PRESETS[DEFAULT]


@dataclass
class FidelityConfig(CheckedSettings, section="fidelity"):
    """The models that plans are made with; fidelity=NAME sets all of them, and each can be set alone."""

    gone: ClassVar = {
        "parents": "trees of every preset grow by the paper's models and choose parents by Eqs. (11) and (12)"
    }

    name: str = setting(
        DEFAULT, "preset that sets the defaults of the settings below", choices=tuple(PRESETS)
    )
    law: str = setting(_USUAL["law"], "wind law under which plans are made and judged", choices=LAWS)
    border: str = setting(
        _USUAL["border"],
        "whether leaving the map is a failure (wall) or not (open); used if scene.border is auto",
        choices=BORDERS,
    )
    mission_bound: str = setting(
        _USUAL["mission_bound"],
        "mission risk: f_o of the paper (theorem2) or V (ordered)",
        choices=MISSION_BOUNDS,
    )
    collision_bound: str = setting(
        _USUAL["collision_bound"],
        "collision risk: Eqs. 9 and 10 of the paper (step) or R (path)",
        choices=COLLISION_BOUNDS,
    )
    parents: str = setting(
        PARENTS, "rule of parent re-selection; only dominance, Eqs. 11 and 12, is left of four rules"
    )
    refine: str = setting(_USUAL["refine"], "how the paths of the trees are improved", choices=REFINEMENTS)
    judge: str = setting(_USUAL["judge"], "what ranks the front and accepts the plan", choices=JUDGES)

    def check_combinations(self) -> None:
        """Refuse the parent rules of earlier versions."""
        if self.parents != PARENTS:
            reason = self.gone["parents"]
            raise ConfigError(
                f"fidelity.parents={shown_text(self.parents)} is no rule: {reason}; leave it out"
            )

    @property
    def label(self) -> str:
        """Name of the preset and what was changed, e.g. ``full`` or ``full with refine=none``."""
        usual = PRESETS[self.name]
        changed = [f"{key}={getattr(self, key)}" for key in usual if getattr(self, key) != usual[key]]
        return f"{self.name} with {', '.join(changed)}" if changed else self.name

    @property
    def mission_symbol(self) -> str:
        """Symbol of the bound on the mission risk: ``f_o`` (theorem2) or ``V`` (ordered), under ``law``."""
        return {"theorem2": "f_o", "ordered": "V"}[self.mission_bound]


def preset(name: str) -> FidelityConfig:
    """The models of ``fidelity=NAME``; KeyError for a name that is not in ``PRESETS``."""
    return FidelityConfig(name=name, **PRESETS[name])


def models_of(label: str) -> FidelityConfig:
    """The models that :attr:`FidelityConfig.label` names; ValueError for any other text.

    Parent rules of earlier versions are left out: they only chose how trees grow.
    """
    name, _, changed = label.partition(" with ")
    try:
        words = (word.split("=") for word in changed.split(", ") if word)
        return replace(preset(name), **{key: value for key, value in words if key != "parents"})
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{label!r} is not a label of a fidelity, e.g. 'full with refine=none'") from error


PAPER = preset("paper")
