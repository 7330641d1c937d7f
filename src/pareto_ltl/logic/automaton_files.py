"""``automaton.json`` and ``automaton.hoa`` of a run."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from careful_io.files import write_bytes, write_json
from pareto_ltl.logic.automaton import Automaton
from pareto_ltl.support.stored import stored
from pareto_ltl.world.windows import Window


def write_automaton(directory: Path, automaton: Automaton) -> None:
    """Write ``automaton.json`` and ``automaton.hoa``."""
    content = {
        "formula": automaton.formula,
        "atoms": automaton.atoms,
        "letters": automaton.letters,
        "initial": automaton.initial,
        "accepting": automaton.accepting,
        "delta": automaton.delta,  # delta[state][letter]
        "d_A": automaton.distance,  # null where acceptance is out of reach
    }
    if automaton.windows:
        content["windows"] = {name: window.as_dict() for name, window in automaton.windows.items()}
        content["forbidden"] = automaton.forbidden
    write_json(directory / "automaton.json", content)
    write_bytes(directory / "automaton.hoa", automaton.to_hoa().encode())


def read_automaton(place: Path | str) -> Automaton:
    """The automaton of ``automaton.json``, a file or the directory that has it."""
    with stored(place, "automaton.json", "an automaton", "automaton") as content:
        return Automaton(
            delta=np.array(content["delta"], np.int32),
            letters=tuple(frozenset(letter) for letter in content["letters"]),
            initial=content["initial"],
            accepting=np.array(content["accepting"], bool),
            distance=np.array([math.inf if d is None else d for d in content["d_A"]], float),
            atoms=tuple(content["atoms"]),
            formula=content["formula"],
            windows={name: Window.from_dict(w) for name, w in content.get("windows", {}).items()},
            forbidden=tuple(content.get("forbidden", ())),
        )
