"""The command line; the only package that imports Hydra.

``commands`` has the table of commands. ``hydra_app`` runs command lines of settings and choices, which
``composition`` composes and checks once; ``setting_keys`` makes :class:`~pareto_ltl.settings.Settings` of
them.
"""
