"""``pareto-ltl scores DIR [OTHER]``: the promises of a forecast test against what came, and another test."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from pareto_ltl.cli.arguments import CommandArguments
from pareto_ltl.cli.output import Answer
from pareto_ltl.support.display import probability_text
from pareto_ltl.support.errors import ConfigError

if TYPE_CHECKING:
    from pareto_ltl.studies.promises import Compared, Promises


def scores_command(argv: Sequence[str]) -> Answer:
    """Diagrams and scores of one forecast test, or of two."""
    parser = CommandArguments(
        prog="pareto-ltl scores",
        description="Compare what the forecast test in DIR promised with what came: isotonic reliability, a "
        "Murphy diagram, skill over simple promises and, with OTHER, a Diebold-Mariano test against "
        "another forecast test of the same missions, for example of another version. Draws "
        "scores_FIDELITY.png and .svg. Needs the extra scores.",
    )
    parser.add_result()
    parser.add_argument("other", type=Path, nargs="?", metavar="OTHER", help="another forecast test")
    parser.add_argument("--fidelity", metavar="NAME", help="preset of planning; default: the first in DIR")
    parser.add_argument(
        "--names", nargs=2, metavar="NAME", help="of DIR and OTHER in the figure; default: their folders"
    )
    parser.add_argument("--out", type=Path, metavar="FOLDER", help="default: the folder scores in DIR")
    options = parser.parse_args(argv)
    if options.names and not options.other:
        raise ConfigError("--names names two tests; give OTHER too")
    from pareto_ltl.report.promises import draw_promises
    from pareto_ltl.studies.promises import (
        compared,
        diagrams,
        read_promises,
        references,
        require_scores,
    )

    require_scores()
    names = options.names or (None, None)
    mine = read_promises(options.directory, options.fidelity, names[0])
    others = [*references(mine)]
    if options.other:
        others.append(read_promises(options.other, mine.fidelity, names[1]))
    found = [compared(mine, other) for other in others]
    shown = found[-1] if options.other else found[0]
    folder = options.out or options.directory / "scores"
    folder.mkdir(parents=True, exist_ok=True)
    written = draw_promises(folder, diagrams(mine, others, shown))
    lines = [*_lines(mine, found), f"wrote {', '.join(map(str, written))}"]
    return Answer({**_document(mine, found), "written": written}, lines, written)


def _document(mine: Promises, found: Sequence[Compared]) -> dict[str, object]:
    from pareto_ltl.studies import calibration
    from pareto_ltl.studies.promises import score_parts

    parts = {name.replace("Brier score", "brier"): value for name, value in score_parts(mine).items()}
    return {
        "name": mine.name,
        "fidelity": mine.fidelity,
        "plans": len(mine.missions),
        "promised": float(mine.promised.mean()),
        "failed": float(mine.realised.mean()),
        **parts,
        **calibration.situation_columns(mine.realised, mine.situations),
        "compared": [
            {name: value for name, value in asdict(one).items() if not name.startswith("curve")}
            for one in found
        ],
    }


def _lines(mine: Promises, found: Sequence[Compared]) -> Iterator[object]:
    from rich import box
    from rich.table import Table

    from pareto_ltl.settings import preset
    from pareto_ltl.studies.promises import score_parts

    yield textwrap.fill(
        f"{mine.name}: {len(mine.missions)} plans, fidelity={mine.fidelity}; promised "
        f"{probability_text(float(mine.promised.mean()))} in {preset(mine.fidelity).law} winds, failed "
        f"{probability_text(float(mine.realised.mean()))} in the later fields",
        80,
    )
    yield ", ".join(f"{name} {value:.3f}" for name, value in score_parts(mine).items())
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    table.add_column("against")
    for column in ("n", "Brier", "change", "95 %", "p", "95 %, situations"):
        table.add_column(column, justify="right")
    for one in found:
        table.add_row(
            one.name, f"{one.missions}", f"{one.brier:.3f}", f"{one.mean:+.3f}", _ends(one.low, one.high),
            "-" if math.isnan(one.p_value) else f"{one.p_value:.2g}",
            _ends(one.situation_low, one.situation_high),
        )  # fmt: skip
    yield table
    n = found[0].situations
    yield textwrap.fill(
        f"n: missions that both planned; change: Brier score of {mine.name} minus the other, with the test "
        f"of Diebold and Mariano. Weather situations: {n}; the last column has one situation as one trial. "
        f"No calibrated rate below 1/({n} + 1) = {probability_text(1 / (n + 1))} can be claimed.",
        80,
    )


def _ends(low: float, high: float) -> str:
    return f"{low:+.3f} to {high:+.3f}" if math.isfinite(low) and math.isfinite(high) else "-"
