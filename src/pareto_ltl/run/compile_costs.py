"""What the kernels of a preset cost to compile."""

from __future__ import annotations

# Measured CPU time [s] of the kernels of a default run, in the order in which a run waits for them.
COSTS: dict[str, dict[str, float]] = {
    "full": {
        "supporting_lines.segment_lines": 4.0, "growth.grow": 16.7, "dijkstra.shortest_lead": 1.8,
        "path.propagate_flight": 6.6, "path.check_path": 3.5, "path_collision.collision_bound": 2.2,
        "ordered_bound.ordered_risk": 5.6, "mission_risk.theorem2_risks": 0.4, "visibility.arrivals": 1.1,
        "visibility.see_places": 1.2, "visibility.clear_crossings": 0.3, "letters.states_along": 0.9,
        "pacing.fill_leg_times": 0.5, "flight.fly_batch": 4.4, "margin.smoothed_failure": 10.2,
        "descent.descend": 13.2, "path.covariance_across_time": 0.7, "supporting_lines.lines_of_each": 0.4,
        "flight.judge_batch": 1.3,
    },
    "paper": {
        "supporting_lines.segment_lines": 4.0, "growth.grow": 16.7, "dijkstra.shortest_lead": 1.8,
        "path.propagate_flight": 4.0, "path.check_path": 3.5, "path_collision.collision_bound": 2.2,
        "ordered_bound.ordered_risk": 5.6, "mission_risk.theorem2_risks": 0.4, "visibility.arrivals": 1.1,
        "visibility.see_places": 1.2, "visibility.clear_crossings": 0.3, "letters.states_along": 0.9,
        "flight.fly_batch": 2.0, "margin.smoothed_failure": 9.0, "path.covariance_across_time": 0.4,
        "flight.judge_batch": 1.3,
    },
}  # fmt: skip
