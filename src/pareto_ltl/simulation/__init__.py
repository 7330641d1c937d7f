"""Simulated flights of plans: they judge the front and estimate how often the plan fails."""
