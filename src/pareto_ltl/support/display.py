"""How records show themselves: one line in a terminal, a small table in a notebook, a figure on demand."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from importlib import import_module
from typing import Any


class Displayed:
    """A record that users look at. A subclass says what is worth knowing in :meth:`facts`.

    Figures are drawn in ``report/notebook.py``, which is imported by name when one is asked for: a record
    does not depend on matplotlib.
    """

    __slots__ = ()

    def facts(self) -> Mapping[str, str]:
        """What to show, by name."""
        raise NotImplementedError

    def __repr__(self) -> str:
        told = ", ".join(f"{name} {value}" for name, value in self.facts().items())
        return f"{type(self).__name__}({told})"

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><th style='text-align:left'>{escape(name)}</th><td>{escape(value)}</td></tr>"
            for name, value in self.facts().items()
        )
        return f"<table><caption>{escape(type(self).__name__)}</caption>{rows}</table>"

    def plot(self, **options: Any) -> Any:
        """A ``Drawing``: a notebook shows it, ``save`` writes it, ``figure`` is the matplotlib figure."""
        return import_module("pareto_ltl.report.notebook").draw_record(self, **options)


def distance_text(metres: float) -> str:
    """A length in kilometres, or in metres below 2 km."""
    return f"{metres / 1e3:,.1f} km" if metres >= 2000.0 else f"{metres:,.1f} m"


def listed_text(names: Any, most: int = 8) -> str:
    """Up to ``most`` names, comma-separated."""
    names = list(names)
    return ", ".join(map(str, names[:most])) + (", ..." if len(names) > most else "") or "none"
