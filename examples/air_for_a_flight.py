"""How much air a flight needs, and whether to go in another forecast."""

import pareto_ltl

small = {"planner": {"trees": 4, "n_max": 1500}, "smoothing": {"candidates": 2}}
result = pareto_ltl.plan("phi1", "F(a & F b & F c)", fidelity="paper", **small)

found = pareto_ltl.contain(result, corridor=150e3, levels=[1e-2, 1e-3], flights=4000)
for area, rate in found.areas:
    print(f"leaves the {area.name}: {rate.failure / found.hours:.1e} per flight hour")
for level in found.levels:
    print(
        f"volumes for {level.per_hour:g} per flight hour: {100 * level.share:.0f} % of a fixed buffer of "
        f"{level.radius / 1e3:.0f} km"
    )

answer = pareto_ltl.check(result, result.wind, limits={"failure": 0.5}, flights=4000)
print("GO" if answer.go else f"NO-GO: {'; '.join(answer.reasons)}")
