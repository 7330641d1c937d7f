"""The formulas of the planner in plain NumPy, which tests compare with its compiled functions."""
