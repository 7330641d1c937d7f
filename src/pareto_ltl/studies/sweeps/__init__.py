"""Sweeps: many runs, one table.

==============  ===============================================================================
``runs``        a run as a job (``studies.jobs``): what its directory says of it
``manifest``    the list of a sweep on disk: its points, and what was varied
``table``       one row a run, one group for each setting without its seeds
``summary``     ``summary.csv``, ``summary.json`` and the page, from the directories alone
``page``        ``summary.html``
==============  ===============================================================================

Nothing in here imports Hydra; ``hydra_plugins.pareto_ltl_sweeper`` joins the two.
"""
