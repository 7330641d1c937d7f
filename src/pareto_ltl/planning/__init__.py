"""From a problem to the path that is flown: trees, front, refinement, selection."""
