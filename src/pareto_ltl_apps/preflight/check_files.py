"""What ``pareto-ltl check`` writes: ``check.json``, ``check.txt`` and the figure."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from careful_io.files import plain_data, write_json, write_text
from pareto_ltl import Run
from pareto_ltl_apps.preflight.check import Check, check_document, check_lines
from pareto_ltl_apps.view.settings import ReportConfig

FOLDER = "check"  # in the results directory


def write_check(run: Run, found: Check, folder: Path) -> None:
    """Write the files into ``folder``, which is made where it is missing."""
    from pareto_ltl_apps.view.axes import save_figures
    from pareto_ltl_apps.view.check import check_figure

    folder.mkdir(parents=True, exist_ok=True)
    write_json(folder / "check.json", plain_data(check_document(found)))
    write_text(folder / "check.txt", "\n".join(check_lines(found)) + "\n")
    heading = [
        f"{'GO' if found.go else 'NO-GO'}: {run.plan.formula} in {Path(found.wind).name}",
        *(f"{n}. {reason}" for n, reason in enumerate(found.reasons, 1)),
    ]
    draw = partial(check_figure, found.scene, run.plan, heading, found.drift, found.flown)
    save_figures(folder, run.settings[ReportConfig], {"check": draw})
