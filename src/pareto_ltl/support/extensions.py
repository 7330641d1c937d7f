"""Extensions by other packages: Python entry points in the groups below.

``pareto_ltl.stages``           a ``Record`` that pipelines can list (``run/record.py``)
``pareto_ltl.stage_tables``     a tuple of such records, which every pipeline knows: stages of applications
``pareto_ltl.plan_additions``   a ``PlanAddition`` (``run/plan_additions.py``)
``pareto_ltl.settings``         a tuple of sections of the settings (``CheckedSettings``)
``pareto_ltl.interface``        a function or class that ``pareto_ltl`` gives under that name
``pareto_ltl.formats``          what reads the files of others: ``maps``, ``winds``, ``automata``
``pareto_ltl.commands``         the command line, ``pareto-ltl``
``pareto_ltl.wind_sources``     a ``WindSource`` (``wind/sources``)
``pareto_ltl.patterns``         a function from ``MissionConfig`` to a formula (``logic/patterns.py``)
``pareto_ltl.selection_rules``  a function that picks a path of a front (``planning/selection_rules.py``)
``pareto_ltl.costs``            a ``Cost`` of a path (``planning/costs/``)
``pareto_ltl.exports``          an ``ExportFormat`` of plans, for an autopilot or a map
``pareto_ltl.conf``             a folder of YAML choices: ``robot/``, ``scene/``, ``pipelines/`` and so on

An entry point is imported only when its name is used. ``examples/extension/`` has one of each.
"""

from __future__ import annotations

from declared_settings import Group

EXAMPLE = "examples/extension"

STAGES = Group("pareto_ltl.stages", EXAMPLE)
FORMATS = Group("pareto_ltl.formats", EXAMPLE)
PLAN_ADDITIONS = Group("pareto_ltl.plan_additions", EXAMPLE)
STAGE_TABLES = Group("pareto_ltl.stage_tables", EXAMPLE)
SETTINGS = Group("pareto_ltl.settings", EXAMPLE)
INTERFACE = Group("pareto_ltl.interface", EXAMPLE)
COMMANDS = Group("pareto_ltl.commands", EXAMPLE)
WIND_SOURCES = Group("pareto_ltl.wind_sources", EXAMPLE)
PATTERNS = Group("pareto_ltl.patterns", EXAMPLE)
SELECTION_RULES = Group("pareto_ltl.selection_rules", EXAMPLE)
COSTS = Group("pareto_ltl.costs", EXAMPLE)
EXPORTS = Group("pareto_ltl.exports", EXAMPLE)
CONF = Group("pareto_ltl.conf", EXAMPLE)
