"""The search, ``fidelity.refine=sampled``: the failure rate of common flights is minimised directly.

A tree path is feasible, but it is not straight and has more steps than it needs. The search polishes paths
(``sampled``), from one start for each way to complete the mission (``starts``), at many lengths
(``front_sweep``). ``planning.evaluate.evaluate_path`` checks every result like any other path.
"""

from __future__ import annotations

from pareto_ltl.planning.refine.effort import Effort
from pareto_ltl.planning.refine.front_sweep import sampled_paths
from pareto_ltl.planning.refine.starts import flown_lines

__all__ = ["Effort", "flown_lines", "sampled_paths"]
