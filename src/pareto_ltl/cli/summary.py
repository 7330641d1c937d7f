"""The table at the end of a run: what was promised, what was simulated, how long it took."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console

Row = tuple[str, str]


def print_summary(
    name: str, directory: Path, metrics: Mapping[str, float], console: Console | None = None
) -> None:
    """Print the numbers a user looks for first, and where all the others are."""
    from rich import box
    from rich.console import Console
    from rich.table import Table

    console = console or Console(highlight=False)
    table = Table(title=name, box=box.SIMPLE_HEAD, show_header=False)
    table.add_column(style="bold")
    table.add_column(justify="right")
    for row in rows(metrics):
        table.add_row(*row)
    console.print(table)
    if (directory / "tables.md").is_file():  # of an evaluation
        console.print((directory / "tables.md").read_text(encoding="utf-8"), soft_wrap=True, markup=False)
    console.print(f"results in {directory}", soft_wrap=True)


def rows(metrics: Mapping[str, float]) -> Iterator[Row]:
    """Names and figures, as far as the pipeline made them."""
    if "length_m" in metrics:
        yield from _plan(metrics)
    for key in metrics:
        if key.startswith("mission_risk_") and f"collision_risk_{key[13:]}" in metrics:
            promised = metrics[key] + metrics[f"collision_risk_{key[13:]}"]
            yield f"promised at most, {key[13:]} winds", f"{min(promised, 1.0):.4f}"
        if key.startswith("failure_") and not key.endswith(("_low", "_high")):
            yield _failure(metrics, key)
    if "nodes" in metrics:
        yield "tree vertices", f"{metrics['nodes']:,.0f} ({metrics['nodes_per_second']:,.0f} a second)"
    for key, spent in metrics.items():
        if key.startswith("seconds_"):
            yield f"  {key.removeprefix('seconds_')}", f"{spent:.2f} s"
    yield "in all", f"{metrics['run_seconds']:.2f} s"


def _plan(metrics: Mapping[str, float]) -> Iterator[Row]:
    yield "length", f"{metrics['length_m'] / 1e3:,.1f} km"
    yield "flight time", f"{metrics['duration_s'] / 3600:.1f} h"
    yield "mission risk, bound of the paper", f"{metrics['mission_risk_paper']:.4f}"
    yield "mission risk, ordered bound", f"{metrics['mission_risk']:.4f}"
    yield "collision risk, bound", f"{metrics['collision_risk']:.4f}"
    if "acceptance_failure" in metrics:
        low, high = metrics["acceptance_low"], metrics["acceptance_high"]
        yield "failure, linear estimate", f"{metrics['acceptance_estimate']:.4f}"
        yield (
            f"failure, {metrics['acceptance_runs']:,.0f} flights at acceptance",
            f"{metrics['acceptance_failure']:.4f} (95 %: {low:.4f} to {high:.4f})",
        )


def _failure(metrics: Mapping[str, float], key: str) -> Row:
    law = key.removeprefix("failure_")
    low, high = metrics[f"{key}_low"], metrics[f"{key}_high"]
    runs = metrics[f"runs_{law}"]
    return (
        f"failed of {runs:,.0f} simulated, {law} winds",
        f"{metrics[key]:.4f} (95 %: {low:.4f} to {high:.4f})",
    )
