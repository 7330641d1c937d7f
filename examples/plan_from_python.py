"""Plan a small mission without the command line: visit a, then b, across the winds of 9 October 2018."""

from numpy.random import SeedSequence

from pareto_ltl import logic
from pareto_ltl import settings as config
from pareto_ltl.planning import growth, problem, selection
from pareto_ltl.planning import refine as smoothing
from pareto_ltl.simulation import flights as deployment
from pareto_ltl.wind import field, sources
from pareto_ltl.wind.observations import observe_wind
from pareto_ltl.world import cells as workspace
from pareto_ltl.world.scene_settings import scene_from_settings as read_scene

cfg = config.Settings(
    scene=config.SceneConfig(
        unit=1000.0,  # kilometres
        centre=[37.0, -92.0],
        bounds=[[0, 0], [600, 400]],
        start=[40, 60],
        regions={
            "a": [[80, 280], [180, 280], [180, 360], [80, 360]],
            "b": [[460, 60], [560, 60], [510, 150]],
        },
        obstacles=[[[240, 120], [330, 140], [300, 300], [250, 280]]],
    ),
    planner=config.PlannerConfig(trees=4, n_max=1500),
)
world = read_scene(cfg.scene, sources.first_wind_time(cfg.wind))
wind = field.fit_wind_field(cfg.wind, observe_wind(cfg.wind, world), world)
cells = workspace.decompose(world)
mission = logic.translate("F(a & F b)", cells.letters)
task = problem.build(cfg.robot, cfg.planner, cfg.wind, world, wind, cells, mission)
growing, flying = SeedSequence(1).spawn(2)
raw = selection.tree_front(task, growth.forest(cfg.planner, task, growing))
front = selection.front(smoothing.smooth(cfg.smoothing, task, raw), raw)
best = selection.choose(cfg.selection, front)
rates = deployment.rates(deployment.fly(task, best.u, 500, "independent", flying))

cost = best.objectives
print(f"{len(front.paths)} paths on the front; the safest is {cost.length / 1000:.0f} km long")
print(f"promised mission risk {cost.mission_risk_paper:.4f}, ordered bound {cost.mission_risk:.4f}")
print(f"simulated failure {rates['failure_independent']:.4f} in {rates['runs_independent']:.0f} flights")
