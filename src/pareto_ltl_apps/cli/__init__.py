"""The command line; the only package that imports Hydra.

``command_table`` has the commands, and ``commands`` runs them. ``hydra_app`` runs command lines of settings
and choices, which ``composition`` composes and checks once; ``setting_keys`` makes
:class:`~pareto_ltl.settings.Settings` of them.
"""
