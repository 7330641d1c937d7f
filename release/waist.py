"""What applications import from the planner: a number that may only fall, ``waist.py [--write | --list]``.

The planner is everything in ``pareto_ltl`` but its applications and ``support``. Applications may import what
``pareto_ltl`` and ``pareto_ltl.extend`` give to every user; each other name that they import, and each module
of such names, is one more thing that a change of the planner has to keep. ``waist.json`` has the numbers of
today; ``--write`` writes lower ones, ``--list`` names what is counted.
"""

from __future__ import annotations

import ast
import json
import sys
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
LIMITS = ROOT / "release" / "waist.json"
PLANNER = "pareto_ltl"
APPLICATIONS = ("cli", "exports", "inflight", "preflight", "report", "serve", "studies")
OPEN = (*APPLICATIONS, "support", "extend")  # not counted, as the names of ``pareto_ltl`` itself


def imported(package: Path) -> dict[str, set[str]]:
    """The names that the applications of ``package`` import from inside the planner, by module."""
    found: dict[str, set[str]] = defaultdict(set)
    for application in APPLICATIONS:
        for path in sorted((package / application).rglob("*.py")):
            for module, name in _names(ast.parse(path.read_text(encoding="utf-8"))):
                inside, _, rest = module.partition(".")
                if inside == PLANNER and rest and rest.partition(".")[0] not in OPEN:
                    found[module].add(name)
    return dict(found)


def _names(tree: ast.Module) -> Iterator[tuple[str, str]]:
    """Module and name of each import, anywhere in ``tree``; ``import a.b`` takes all of ``a.b``."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module:
            yield from ((node.module, alias.name) for alias in node.names)
        elif isinstance(node, ast.Import):
            yield from ((alias.name, "*") for alias in node.names)


def counts(found: dict[str, set[str]]) -> dict[str, int]:
    """How many names from how many modules."""
    return {"names": sum(map(len, found.values())), "modules": len(found)}


def problems(now: dict[str, int], limits: dict[str, int]) -> list[str]:
    """One line for each number that rose."""
    return [
        f"applications import {now[key]} {key} from inside the planner, at most {limit} are allowed: use "
        "what pareto_ltl and pareto_ltl.extend give (python release/waist.py --list)"
        for key, limit in limits.items()
        if now[key] > limit
    ]


def main(words: list[str]) -> int:
    """Compare, or write, or list; the exit code is 1 if a number rose."""
    found = imported(ROOT / "src" / PLANNER)
    now, limits = counts(found), json.loads(LIMITS.read_text(encoding="utf-8"))
    if words == ["--list"]:
        for module, names in sorted(found.items()):
            print(f"{module}: {', '.join(sorted(names))}")
        return 0
    for line in problems(now, limits):
        print(line, file=sys.stderr)
    if problems(now, limits):
        return 1
    if words == ["--write"]:
        LIMITS.write_text(json.dumps(now) + "\n", encoding="utf-8")
    elif now != limits:
        print(f"waist: {now}, less than {limits}: python release/waist.py --write")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
