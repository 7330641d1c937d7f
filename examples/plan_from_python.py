"""Plan a visit to a, then to b, in the winds of 9 October 2018; then simulate 500 flights of the plan."""

import pareto_ltl

square = [[80, 280], [180, 280], [180, 360], [80, 360]]
triangle = [[460, 60], [560, 60], [510, 150]]
wall = [[240, 120], [330, 140], [300, 300], [250, 280]]
scene = {"unit": 1000, "centre": [37, -92], "bounds": [[0, 0], [600, 400]], "start": [40, 60]}
scene |= {"regions": {"a": square, "b": triangle}, "obstacles": [wall]}  # kilometres

result = pareto_ltl.plan(scene, "F(a & F b)", planner={"trees": 4, "n_max": 1500}, seed=1)
flights = pareto_ltl.simulate(result, runs=500, law="independent")
print(result.front, result.plan, sep="\n")
print(f"promised failure {result.plan.promise.rate.failure:.4f}", end=", ")
print(f"simulated failure {flights.failed.mean():.4f} in 500 flights")
