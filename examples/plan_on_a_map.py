"""Plan on a GeoJSON map, write a results directory, and read it again."""

from pathlib import Path

import pareto_ltl

scene, out = Path(__file__).with_name("ozarks.geojson"), Path("outputs/ozarks")
formula = "F(springfield & F memphis) & F cairo"
pareto_ltl.plan(scene, formula, wind="calm", planner="quick", report={"dpi": 60}, out=out)

results = pareto_ltl.load_results(out)
print(results.plan)
print("files:", ", ".join(sorted(path.name for path in out.iterdir())))
