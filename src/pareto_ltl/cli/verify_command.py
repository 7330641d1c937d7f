"""``pareto-ltl verify DIR``: recompute every claim of a result from its files, without the planner."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from pareto_ltl.cli.arguments import CommandArguments
from pareto_ltl.cli.output import Answer
from pareto_ltl.support.messages import shown_text
from pareto_ltl_verify.evidence import open_evidence
from pareto_ltl_verify.judge import Finding, judge_evidence, unchecked_claims

CLAIM_FAILS = 3  # exit code; 1 is for a crash, 2 for an input that cannot be read


def verify_command(argv: Sequence[str]) -> Answer:
    """Check a result; the exit code is 0 if all claims hold and 3 if one fails."""
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
    shown, unchecked = failed if options.failed_only else found, unchecked_claims(result)
    lines = [
        *table_lines(shown),
        f"{len(found)} claims hold" if not failed else f"{len(failed)} of {len(found)} claims fail",
        *(f"not checked, because {reason}: {'; '.join(claims)}" for reason, claims in unchecked.items()),
    ]
    document = {
        "directory": options.directory,
        "claims": [
            {"claim": f.claim, "claimed": f.claimed, "derived": f.derived, "holds": f.holds} for f in shown
        ],
        "checked": len(found),
        "failed": len(failed),
        "unchecked": unchecked,
    }
    return Answer(document, lines, code=CLAIM_FAILS if failed else 0)


def table_lines(found: Sequence[Finding]) -> Iterator[str]:
    """A line of 80 columns for each claim that holds; what is claimed and what follows for one that fails."""
    for f in found:
        if f.holds:
            yield shown_text(f"holds  {f.claim}: {f.claimed}")
        else:
            yield from (
                f"FAILS  {f.claim}",
                f"       claimed     {f.claimed}",
                f"       re-derived  {f.derived}",
            )
