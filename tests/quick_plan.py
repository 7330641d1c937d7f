"""The settings of a plan that takes seconds, for tests of what is done with a plan."""

from typing import Any

QUICK_PLAN: dict[str, Any] = {
    "planner": {"trees": 1, "n_max": 150, "epsilon": 0.7},
    "refine": {"points": 2, "classes": 1, "flights": 20, "sweep_flights": 10},
    "smoothing": {"candidates": 1, "weights": [1.0]},
    "selection": {"draws": 20, "runs": 20},
    "deployment": {"runs": 10},
    "robot": {"dt": 3600.0},
}
QUICK_SEARCH: dict[str, Any] = {section: QUICK_PLAN[section] for section in ("refine", "selection")}
