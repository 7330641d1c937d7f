"""The models that plans are made with, and their presets."""

from __future__ import annotations

from dataclasses import dataclass, replace

from pareto_ltl.settings.checks import CheckedSettings, setting

LAWS = ("independent", "coherent")
BORDERS = ("open", "wall")
MISSION_BOUNDS = ("theorem2", "ordered")
COLLISION_BOUNDS = ("step", "path")
PARENT_RULES = ("dominance", "scaled", "tchebycheff", "mixed")
REFINEMENTS = ("none", "convex", "sampled")
JUDGES = ("bound", "flights")

PRESETS: dict[str, dict[str, str]] = {
    "paper": {
        "law": "independent", "border": "open", "mission_bound": "theorem2",
        "collision_bound": "step", "parents": "dominance", "refine": "convex", "judge": "bound",
    },
    "full": {
        "law": "coherent", "border": "wall", "mission_bound": "ordered",
        "collision_bound": "path", "parents": "mixed", "refine": "sampled", "judge": "flights",
    },
}  # fmt: skip
DEFAULT = "full"
_USUAL = PRESETS[DEFAULT]


@dataclass
class FidelityConfig(CheckedSettings, section="fidelity"):
    """The models that plans are made with; fidelity=NAME sets all of them, and each can be set alone."""

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
        _USUAL["parents"], "rule of parent re-selection; dominance is Eqs. 11 and 12", choices=PARENT_RULES
    )
    refine: str = setting(_USUAL["refine"], "how the paths of the trees are improved", choices=REFINEMENTS)
    judge: str = setting(_USUAL["judge"], "what ranks the front and accepts the plan", choices=JUDGES)

    @property
    def label(self) -> str:
        """Name of the preset and what was changed, e.g. ``full`` or ``full with parents=scaled``."""
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
    """The models that :attr:`FidelityConfig.label` names; ValueError for any other text."""
    name, _, changed = label.partition(" with ")
    try:
        return replace(preset(name), **dict(word.split("=") for word in changed.split(", ") if word))
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(
            f"{label!r} is not a label of a fidelity, e.g. 'full with parents=scaled'"
        ) from error


PAPER = preset("paper")
