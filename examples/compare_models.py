"""The planner of the paper and the default planner on the same mission, flown in the same coherent winds."""

import pareto_ltl

small = {"planner": {"trees": 4, "n_max": 1500}, "smoothing": {"candidates": 2}}
for fidelity in ("paper", "full"):
    result = pareto_ltl.plan("phi2", "F(a & F(b & F c)) | F(a & F(d & F c))", fidelity=fidelity, **small)
    flights = pareto_ltl.simulate(result, runs=1000, law="coherent", seed=7)
    o = result.plan.path.objectives
    failed = flights.failed.mean()
    print(f"{fidelity}: {o.length / 1e3:.0f} km, bound {o.mission_risk + o.collision_risk:.3f}", end=", ")
    print(f"failed {failed:.3f} of 1000 flights")
