"""Simulated flights of a plan, and the ranking and acceptance of plans by them."""
