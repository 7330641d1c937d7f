"""Settings of figures and the page."""

from __future__ import annotations

from dataclasses import dataclass

from pareto_ltl.extend import CheckedSettings, setting

FIGURE_FORMATS = ("png", "svg", "pdf")


@dataclass
class ReportConfig(CheckedSettings, section="report"):
    """Figures."""

    figures: bool = setting(True, "whether figures are drawn")
    page: bool = setting(True, "whether report.html is written: one file that shows the result")
    formats: list[str] = setting(
        ["png"], "file formats of each figure", choices=FIGURE_FORMATS, distinct=True
    )
    dpi: int = setting(200, "resolution of PNG figures, in dots per inch", "[30, 1200]")
    paths: int = setting(40, "simulated flights that are drawn", "[0, 10_000]")
    trees: bool = setting(False, "whether the map of a plan shows the search trees; without a plan it does")
