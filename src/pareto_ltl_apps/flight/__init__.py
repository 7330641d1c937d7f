"""A flight watched while it is flown: ``pareto-ltl follow``, and ``pareto_ltl.follow`` from Python.

Telemetry becomes readings (``telemetry``), readings become a belief about position and wind and simulated
flights of the rest of the plan (``belief``), and these become events (``watch``), which are written to a
journal (``journal``) and to the pilot (``lines``).
"""
