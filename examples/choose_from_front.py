"""Plan once, read the front, and choose another of its points without a second search."""

import pareto_ltl

small = {"planner": {"trees": 4, "n_max": 1500}, "smoothing": {"candidates": 2}}
result = pareto_ltl.plan("phi1", "F(a & F b & F c)", fidelity="paper", **small)
for number, path in enumerate(result.front.paths):
    o = path.objectives
    print(f"{number}: {o.length / 1e3:.0f} km, {path.order}, f_o + R {o.mission_risk + o.collision_risk:.2g}")

knee = pareto_ltl.choose(result, knee=True).plan
shortest = pareto_ltl.choose(result, length=1.02 * min(p.objectives.length for p in result.front.paths)).plan
for name, plan in (("priority", result.plan), ("knee", knee), ("short", shortest)):
    print(f"{name}: {plan.path.objectives.length / 1e3:.0f} km")
