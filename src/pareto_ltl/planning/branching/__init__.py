"""Plans that branch: their records and files; pareto_ltl_apps.branching searches for the branches."""
