"""``python -m pareto_ltl`` and the console script ``pareto-ltl``."""

from __future__ import annotations

import sys


def main() -> None:
    """Sub-commands that need no configuration come first; everything else goes to Hydra."""
    argv = sys.argv[1:]
    if argv[:1] == ["formula"]:
        from pareto_ltl.cli.formula import main as formula

        sys.exit(formula(argv[1:]))
    if argv[:1] == ["rerun"]:
        from pareto_ltl.cli.rerun import main as rerun

        sys.exit(rerun(argv[1:]))
    if argv[:1] == ["cache"]:
        from pareto_ltl.support.cache import main as cache

        sys.exit(cache(argv[1:]))
    if argv == ["--version"]:
        from importlib.metadata import version

        print(f"pareto-ltl {version('pareto-ltl')}")
        sys.exit(0)

    from pareto_ltl.cli.hydra_app import main as app

    sys.exit(app(argv))


if __name__ == "__main__":
    main()
