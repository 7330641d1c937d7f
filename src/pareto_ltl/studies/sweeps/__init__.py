"""Sweeps: many runs, one table.

==============  ===============================================================================
``runs``        a run as a job (``studies.jobs``): its state, read from its directory
``manifest``    the list of a sweep on disk: its points, and which settings vary
``table``       one row for each run, one group for all seeds of a combination of settings
``summary``     ``summary.csv``, ``summary.json`` and the page, from the directories alone
``page``        ``summary.html``
==============  ===============================================================================

This package does not import Hydra; ``hydra_plugins.pareto_ltl_plugins`` connects them.
"""
