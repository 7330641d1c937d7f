"""An independent judge: every claim of a results directory, derived again from its files alone.

The code here shares nothing with the planner but the readers of files (``support``): other algorithms for the
same definitions, in NumPy and SciPy. ``claims`` is the table of what is judged.
"""
