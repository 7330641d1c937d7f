"""The way from a problem to a plan: search trees, evaluation of paths, refinement, front, selection."""
