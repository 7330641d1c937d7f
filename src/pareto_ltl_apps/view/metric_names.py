"""Names of metrics in words, each probability with its wind law, for axes and heads of tables."""

from __future__ import annotations

from pareto_ltl import Settings
from pareto_ltl.extend import Cost, known_costs

METRIC_LABELS = {
    "duration_s": "flight time [h]",
    "energy_share": "energy, share of robot.power.capacity",
    "mission_risk_paper": "mission risk f_o of the paper, independent winds",
    "mission_risk": "mission risk that judges the plan, winds of fidelity.law",
    "mission_risk_ordered": "mission risk V, winds of fidelity.law",
    "collision_risk": "collision risk R, winds of fidelity.law",
    "safest": "least mission risk of the front, winds of fidelity.law",
    "safest_raw": "least mission risk of the trees, winds of fidelity.law",
    "least_failure": "least failure rate of the front, winds of fidelity.law",
    "least_failure_raw": "least failure rate of the trees, winds of fidelity.law",
    "promise_failure": "failed fresh flights, winds of fidelity.law",
    "promise_low": "failed fresh flights, lower end, winds of fidelity.law",
    "promise_high": "failed fresh flights, upper end, winds of fidelity.law",
    "promise_claimed": "failed flights that judged the front, winds of fidelity.law",
    "promise_bound": "bound V + R, winds of fidelity.law",
    "completed": "runs with a plan",
    "front_size": "paths on the front",
    "hypervolume": "hypervolume of the front",
    "run_seconds": "time of a run [s]",
    "growth_seconds": "time of growth [s]",
    "nodes_per_second": "tree vertices per second",
    "planner.n_max": "vertices per tree (planner.n_max)",
    "planner.epsilon": "collision probability allowed at a step (planner.epsilon)",
    "robot.dt": "time step (robot.dt) [s]",
    "robot.u_max": "largest airspeed (robot.u_max) [m/s]",
    "robot.u_min": "least airspeed (robot.u_min) [m/s]",
}
LAW_METRICS = {  # metrics whose names end with a wind law
    "failure": "failed flights",
    "mission_failure": "flights that missed the mission",
    "collision": "flights that touched an obstacle",
    "off_map": "flights that left the map",
    "mission_risk": "mission risk V",
    "collision_risk": "collision risk R",
}
ENDS = {"": "", "_low": ", lower end", "_high": ", upper end"}  # of an interval
LAW_NAMES = {
    f"{stem}_{law}{end}": f"{words}{where}, {law} winds"
    for stem, words in LAW_METRICS.items()
    for law in Settings.LAWS
    for end, where in ENDS.items()
}
SHARES = ("mission_risk", "collision_risk", "safest", "least_failure", "promise_", "completed")
COUNTS = ("promise_runs", "promise_passed", "promise_weighted")


def metric_label(name: str) -> str:
    """Words and unit of a known metric or setting, else the name itself."""
    if label := LAW_NAMES.get(name) or METRIC_LABELS.get(name):
        return label
    cost = cost_in_column(name)
    return name if cost is None else cost.label or name


def is_probability(name: str) -> bool:
    """Whether a metric is a probability or a share of flights or runs."""
    return name in LAW_NAMES or (name.startswith(SHARES) and name not in COUNTS)


def cost_in_column(column: str) -> Cost | None:
    """The cost in a column of ``front.csv``, None if there is none."""
    return next((cost for cost in known_costs() if cost.column == column), None)
