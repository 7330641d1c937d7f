"""Check that every segment of every point of a front keeps epsilon; the arguments are results directories.

By the road of ``pareto-ltl verify``: the Gaussian along each path of ``front.npz`` in plain NumPy, and a
sweep of directions for each segment and barrier.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from pareto_ltl_verify import laws
from pareto_ltl_verify.evidence import open_evidence
from pareto_ltl_verify.gaussians import segment_risks


def main() -> int:
    """One line for each results directory; 1 if a segment breaks epsilon by more than two per cent of it."""
    broken = False
    for folder in sys.argv[1:]:
        result = open_evidence(Path(folder))
        size = len(result.front)
        worst = np.zeros(size)
        for k in range(size if result.barriers else 0):
            x = result.front_x(k)
            cov = laws.fly_means(result.law(result.planned_law, len(x) - 1), x).cov
            worst[k] = segment_risks(result.barriers, x, cov)[1].max()
        broken |= bool((worst > 1.02 * result.epsilon).any())
        print(
            f"{folder}: {len(worst)} paths, largest {worst.max(initial=0.0):.4f}, epsilon {result.epsilon:g}"
        )
    return int(broken)


if __name__ == "__main__":
    sys.exit(main())
