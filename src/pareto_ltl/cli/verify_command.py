"""``pareto-ltl verify DIR``: recompute every claim of a result from its files, without the planner."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from pareto_ltl.cli.arguments import CommandArguments, run_reported
from pareto_ltl.verify.evidence import open_evidence
from pareto_ltl.verify.judge import Finding, judge_evidence, unchecked_claims


def verify_command(argv: Sequence[str]) -> int:
    """Check a result; return 0 if all claims hold, 1 if one fails, 2 after one line if there is no result."""
    return run_reported(lambda: _verify_arguments(argv))


def _verify_arguments(argv: Sequence[str]) -> int:
    parser = CommandArguments(
        prog="pareto-ltl verify",
        description="Recompute every claim of a result from its files, with code that shares nothing with "
        "the planner; exit code 1 if one fails.",
    )
    parser.add_argument("directory", type=Path, help="for example outputs/phi2/2026-01-31_12-00-00")
    parser.add_argument("--failed", action="store_true", help="show only claims that fail")
    options = parser.parse_args(argv)
    result = open_evidence(options.directory)
    found = judge_evidence(result)
    failed = [finding for finding in found if not finding.holds]
    print("\n".join(table_lines(failed if options.failed else found)))
    print(f"{len(found)} claims hold" if not failed else f"{len(failed)} of {len(found)} claims fail")
    for reason, claims in unchecked_claims(result).items():
        print(f"not checked, because {reason}: {'; '.join(claims)}")
    return 1 if failed else 0


def table_lines(found: Sequence[Finding]) -> list[str]:
    """The table: claim, value in the result, value that follows from its files, verdict."""
    rows = [("claim", "claimed", "re-derived", "verdict")]
    rows += [(f.claim, f.claimed, f.derived, "holds" if f.holds else "FAILS") for f in found]
    widths = [max(len(row[column]) for row in rows) for column in range(3)]
    return [
        "  ".join([*(cell.ljust(width) for cell, width in zip(row, widths, strict=False)), row[3]])
        for row in rows
    ]
