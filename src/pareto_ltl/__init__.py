"""Risk-aware temporal-logic mission planning in uncertain wind, without position fixes.

The stages of a run, each a function of settings and records, in the order in which they are called:

==============  ===============================================================================
``scene``       ``read_scene``: settings or a map file -> ``Scene``
``wind``        ``sources.observations`` -> ``field.wind``: NOAA readings -> ``WindField``
``workspace``   ``decompose``: ``Scene`` -> ``Decomposition`` (convex cells)
``logic``       ``translate``: formula -> minimal ``Automaton``
``problem``     ``build``: all of these -> ``Problem``
``growth``      ``forest``: ``Problem`` -> ``Forest`` of search trees
``smoothing``   ``smooth``: convex smoothing of the best paths
``selection``   ``tree_front``, ``front``, ``choose``: the non-dominated paths and the one to fly
``deployment``  ``fly``: simulated flights of a path
==============  ===============================================================================

``examples/plan_from_python.py`` calls them in fifteen lines; the command line is
``python -m pareto_ltl +experiment=phi1``.
"""

from __future__ import annotations

__version__ = "0.1.0"

__all__ = ["__version__"]
