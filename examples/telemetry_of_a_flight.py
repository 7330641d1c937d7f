"""Simulate one flight of a small plan in a wind of its law, write its telemetry, and watch it."""

import csv
import sys
from pathlib import Path

import numpy as np

import pareto_ltl
from pareto_ltl_apps.flight.lines import event_line

SD = 300.0  # of the two position fixes [m]


def write_telemetry(result, file: Path, seed: int = 1) -> None:
    """A row a minute: what the robot reports when it flies the plan in one wind of the law."""
    plan, scene = result.plan, result.scene
    x = pareto_ltl.simulate(result, runs=1, seed=seed).x[0]
    steps, rng = len(plan.path.u), np.random.default_rng(seed)
    fixes = {steps // 3, 2 * steps // 3}
    with file.open("w", newline="") as out:
        table = csv.writer(out)
        table.writerow(["time", "heading_true", "airspeed_tas_m_s", "lat", "lon", "fix_sd_m"])
        for t in np.arange(0.0, steps * plan.dt, 60.0):
            k = int(t / plan.dt)
            row = [t, plan.navigation.heading_true[k], plan.navigation.airspeed[k]]
            if k in fixes:
                fixes.remove(k)
                lon, lat = scene.frame.to_geographic(x[k : k + 1] + SD * rng.standard_normal((1, 2)))
                row += [lat[0], lon[0], SD]
            table.writerow(row)


if __name__ == "__main__":
    file = Path(sys.argv[2] if len(sys.argv) > 2 else "telemetry.csv")
    small = {"planner": {"trees": 4, "n_max": 1500}, "deployment": {"runs": 50}}
    done = (
        pareto_ltl.load_results(sys.argv[1]) if len(sys.argv) > 1 else pareto_ltl.plan("phi1", "F a", **small)
    )
    write_telemetry(done, file)
    for event in pareto_ltl.follow(done, file, settings=pareto_ltl.WatchSettings(every=3600.0)):
        if line := event_line(event):
            print(line)
