"""Two missions for which f_o of Theorem 2 is below the true risk; the ordered bound is not.

1. ``F(a & F b)``, b crossed on the way to a: the theorem takes the best of all visits to b, the early one
   included, though only a visit after a counts.
2. ``!b U a``, the path passing close by b: the theorem asks how well a is reached, not whether b is entered
   first.
"""

import numpy as np
from numpy.random import SeedSequence

from pareto_ltl.planning.evaluate import evaluate_path
from pareto_ltl.run.plan_run import Run
from pareto_ltl.settings import MissionConfig, RobotConfig, Settings, preset
from pareto_ltl.simulation import flights
from pareto_ltl.wind.records import WindField
from pareto_ltl.world.scene import Scene

KM, RUNS = 1000.0, 20_000


def square(west, south, side):
    """Corners of a square, counter-clockwise; kilometres in, metres out."""
    return KM * np.array(
        [[west, south], [west + side, south], [west + side, south + side], [west, south + side]]
    )


def line(*corners):
    """Positions (T+1, 2) [m] along straight legs, 1 km per step; corners in kilometres."""
    legs = [np.array(corners[:1], float)]
    for start, end in zip(np.array(corners[:-1]), np.array(corners[1:]), strict=True):
        share = np.linspace(0, 1, round(float(np.linalg.norm(end - start))) + 1)[1:, None]
        legs.append(start + share * (end - start))
    return KM * np.vstack(legs)


def judge(formula, regions, path):
    """Both bounds of ``path``, and its failure rate in winds of 1 m/s that are independent every 100 s."""
    scene = Scene(KM * np.array([[0.0, 0.0], [20.0, 20.0]]), path[0], regions)
    still, gusts = np.zeros((1, 2, 2, 2)), np.ones((1, 2))
    wind = WindField(np.zeros(2), 20 * KM, np.zeros(1), still, still, gusts, until=np.inf)
    settings = Settings(
        mission=MissionConfig(formula=formula),
        robot=RobotConfig(dt=100.0, u_max=10.5),
        fidelity=preset("paper"),  # both bounds are for the winds of these flights
    )
    task = Run(settings, records={"scene": scene, "wind": wind}).problem
    plan = evaluate_path(task, path, "by hand")
    missed = ~flights.simulate_flights(task, plan.u, RUNS, "independent", SeedSequence(1)).accepted
    low, high = flights.clopper_pearson(int(missed.sum()), RUNS)
    print(f"{formula}: Theorem 2 says {plan.objectives.mission_risk_paper:.2g}, ", end="")
    print(f"the ordered bound {plan.objectives.mission_risk_ordered:.4f}; ", end="")
    print(f"{missed.mean():.4f} of {RUNS} flights missed it (95 %: {low:.4f} to {high:.4f})")


judge(
    "F(a & F b)",
    {"a": square(13, 8, 4), "b": square(6, 8, 3)},
    line((1.5, 9.5), (15.5, 9.5), (8.0, 9.5)),  # through the middle of b, to a, and back to 1 km inside b
)
judge(
    "!b U a",
    {"a": square(13, 8, 4), "b": square(6, 6, 3)},
    line((1.5, 9.4), (15.5, 9.4)),  # 400 m past b
)
