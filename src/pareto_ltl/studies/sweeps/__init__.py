"""Many runs, one table: jobs that are never done twice, and what they come to.

==============  ===============================================================================
``locks``       who is at work where; a lock dies with its process
``jobs``        what a job's directory says of it; one job, once
``manifest``    the points of a sweep, on disk
``conduct``     all points of a sweep, whatever kills jobs or launchers
``table``       one row a job, one group for each setting without its seeds
``page``        ``summary.html``
``summary``     ``summary.csv``, ``summary.json`` and the page, from the directories alone
==============  ===============================================================================

Nothing in here knows Hydra; ``hydra_plugins.pareto_ltl_sweeper`` joins the two.
"""
