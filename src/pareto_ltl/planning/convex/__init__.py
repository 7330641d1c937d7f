"""The convex programme of one step of a path (the only package that imports cvxpy).

Smoothing, the last solve of every path of the search, and the prices of constraints solve it
(:mod:`pareto_ltl.planning.smoothing`, :mod:`pareto_ltl.planning.refine`, :mod:`pareto_ltl.planning.prices`).
"""
