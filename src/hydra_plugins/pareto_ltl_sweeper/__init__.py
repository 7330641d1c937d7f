"""A sweeper for Hydra that does no job twice."""
