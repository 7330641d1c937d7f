"""Words for the factors of an ablation, in tables and on axes."""

FACTOR_TITLES = {  # of factors whose name is not enough
    "beta": "β, times the default",
    "epsilon": "ε",
    "n_max": "vertices per tree",
    "dt": "time step [s]",
    "ball": "radius of the ball [sd]",
    "law": "wind law of the planner",
    "mission_bound": "mission bound",
    "collision_bound": "collision bound",
    "refine": "refinement",
}
