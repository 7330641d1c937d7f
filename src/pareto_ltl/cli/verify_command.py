"""``pareto-ltl verify DIR``: recompute every claim of a result from its files, without the planner."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from pareto_ltl.cli.arguments import CommandArguments
from pareto_ltl_verify.evidence import open_evidence
from pareto_ltl_verify.judge import Finding, judge_evidence, unchecked_claims

CLAIM_FAILS = 3  # exit code: 1 is that of a crash, 2 of an input that cannot be read


def verify_command(argv: Sequence[str]) -> int:
    """Check a result; return 0 if all claims hold, 3 if one fails, 2 after one line if there is no result."""
    parser = CommandArguments(
        prog="pareto-ltl verify",
        description="Recompute every claim of a result from its files, with code that shares nothing with "
        "the planner; exit code 3 if one fails.",
    )
    parser.add_argument("directory", type=Path, help="for example outputs/phi2/2026-01-31_12-00-00")
    parser.add_argument("--failed-only", "--failed", action="store_true", help="show only claims that fail")
    options = parser.parse_args(argv)
    result = open_evidence(options.directory)
    found = judge_evidence(result)
    failed = [finding for finding in found if not finding.holds]
    print("\n".join(table_lines(failed if options.failed_only else found)))
    print(f"{len(found)} claims hold" if not failed else f"{len(failed)} of {len(found)} claims fail")
    for reason, claims in unchecked_claims(result).items():
        print(f"not checked, because {reason}: {'; '.join(claims)}")
    return CLAIM_FAILS if failed else 0


def table_lines(found: Sequence[Finding]) -> list[str]:
    """The table: claim, value in the result, value that follows from its files, verdict."""
    rows = [("claim", "claimed", "re-derived", "verdict")]
    rows += [(f.claim, f.claimed, f.derived, "holds" if f.holds else "FAILS") for f in found]
    widths = [max(len(row[column]) for row in rows) for column in range(3)]
    return [
        "  ".join([*(cell.ljust(width) for cell, width in zip(row, widths, strict=False)), row[3]])
        for row in rows
    ]
