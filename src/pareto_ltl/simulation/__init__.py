"""Simulated flights of plans: they judge the front, and say how often the plan fails."""
