"""Automata that read the labels of cells in the plane: compiled kernels; :mod:`typed_kernels` compiles them.

A path reads the label of its cell at each step, and between steps the labels that lead away from acceptance.
It completes the mission if the automaton accepts. A flight is one of many disturbed copies of a path.

``types``           the automaton on labelled cells, and bounds on the risk, as named tuples
``letters``         the states of the automaton along a path
``mission_risk``    the probability of each label for a Gaussian position; the bound f_o of a path
``ordered_bound``   the bound V on the probability that a path of Gaussians does not complete the mission
``margin``          how far flights are from completion or failure, with derivatives
``margin_events``   what binds a margin: tables of polygons and transitions, and the numbers of events
``claim_lists``     margins of one flight at a time, for large automata
``claim_rows``      margins of many flights at once
``dijkstra``        shortest paths over pairs of a state and a cell

Kernels do not check their arguments. They contain no wind and no plan; geometry is in :mod:`plane_kernels`.
"""

from pathlib import Path

from typed_kernels.packages import PACKAGES

PACKAGES[__name__] = Path(__file__).parent  # kernels whose code depends on a module here are compiled again
