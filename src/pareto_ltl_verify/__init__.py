"""An independent check: every claim of a results directory is computed again from its files alone.

The code here shares only the readers of files (``support``) with the planner. It uses other algorithms for
the same definitions, in NumPy and SciPy. ``claims`` lists what is checked.
"""
