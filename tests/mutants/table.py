"""The modules that are mutated, each with the tests that must notice, and mutants that change no result."""

from __future__ import annotations

LOGIC = ("logic/test_formula.py", "logic/test_tables.py", "logic/test_semantics.py")
HOA = ("logic/test_formats.py", "logic/test_hoa_limits.py")
PARTS = ("wind/test_law_of_parts.py", "wind/test_law_of_currents.py")
COSTS = ("containment", "duration", "energy", "length", "turns")

MODULES: dict[str, tuple[str, ...]] = {
    "pareto_ltl.logic.dfa": (*LOGIC, "logic/test_progress.py"),
    "pareto_ltl.logic.formula": (*LOGIC, *HOA),
    "pareto_ltl.logic.hoa": HOA,
    "pareto_ltl.logic.labels": HOA,
    "pareto_ltl.logic.normal_form": LOGIC,
    "pareto_ltl.logic.progression": ("logic/test_progression.py", *LOGIC),
    "pareto_ltl.logic.timed": ("logic/test_deadlines.py",),
    **{f"pareto_ltl.planning.costs.{name}": ("planning/test_costs.py",) for name in COSTS},
    "pareto_ltl.planning.error_tail": ("simulation/test_error_tail.py",),
    "pareto_ltl.planning.power": ("planning/test_power.py",),
    "pareto_ltl.planning.product_graph": ("planning/test_product_graph.py",),
    "pareto_ltl.planning.routes.obligations": ("planning/test_orders.py",),
    "pareto_ltl.planning.routes.path_classes": ("planning/test_path_classes.py",),
    "pareto_ltl.planning.selection_rules": (
        "planning/test_selection.py", "planning/test_rule_words.py", "planning/test_costs.py",
    ),
    "pareto_ltl.planning.turns": ("planning/test_turns.py",),
    "pareto_ltl.settings.heights": ("settings/test_heights.py",),
    "pareto_ltl.simulation.importance": ("simulation/test_importance.py",),
    "pareto_ltl.simulation.promise": ("simulation/test_judging.py",),
    "pareto_ltl.support.atmosphere": ("support/test_atmosphere.py", "wind/test_air.py"),
    "pareto_ltl.support.counts": ("support/test_counts.py",),
    "pareto_ltl.support.display": ("support/test_display.py",),
    "pareto_ltl.support.times": ("support/test_times.py",),
    "pareto_ltl.wind.air": ("wind/test_air.py",),
    "pareto_ltl.wind.between": ("wind/test_between.py",),
    "pareto_ltl.wind.change_law": ("wind/test_variability.py", *PARTS),
    "pareto_ltl.wind.conditioned": ("planning/test_conditioning.py",),
    "pareto_ltl.wind.coverage": ("wind/test_coverage.py",),
    "pareto_ltl.wind.error_law": ("wind/test_forecast_error.py", *PARTS),
    "pareto_ltl.wind.gp": ("wind/test_gp.py",),
    "pareto_ltl.wind.law_of_parts": PARTS,
    "pareto_ltl.wind.modes": ("wind/test_modes.py",),
    "pareto_ltl.wind.variability": ("wind/test_variability.py",),
    "pareto_ltl.world.polygons": ("world/test_cells.py", "world/test_shapes.py"),
    "pareto_ltl.world.scene_simplify": ("world/test_outlines.py", "world/test_scene_simplify.py"),
    "pareto_ltl.world.time_step": ("world/test_time_step.py",),
    "pareto_ltl.world.windows": ("world/test_windows.py", "logic/test_deadlines.py"),
    "pareto_ltl_apps.exports.degrees": ("exports/test_degrees.py",),
    "pareto_ltl_apps.exports.ellipses": ("exports/test_ellipses.py",),
    "pareto_ltl_apps.formats.hoa_files": HOA,
    "pareto_ltl_apps.formats.hoa_labels": HOA,
    "pareto_ltl_apps.formats.map_edges": ("world/test_edges.py",),
    "pareto_ltl_verify.formula": ("verify/test_formula.py", "logic/test_deadlines.py"),
    "pareto_ltl_verify.tails": ("verify/test_laws_of_parts.py",),
}  # fmt: skip

# By module, line, old and new text.
EQUIVALENT: dict[tuple[str, str, str, str], str] = {
    ("pareto_ltl.wind.coverage", "if 0.0 < held < np.inf:", "0.0", "1.0"): "wind.max_gap is given in hours",
    (
        "pareto_ltl.planning.product_graph",
        "EXACT_LEADS = 20_000  # up to so many product states leads are exact shortest paths",
        "20_000",
        "20001",
    ): "a limit of time, on either side of which leads are right",
    (
        "pareto_ltl.logic.progression",
        "now = 0",
        "0",
        "1",
    ): "letters are told apart by a proposition more, and lead to the same states",
    (
        "pareto_ltl_apps.formats.hoa_labels",
        "self.known.clear()",
        "self.known.clear()",
        "pass",
    ): "what is known is worked out again: memory, not results",
    (
        "pareto_ltl_apps.formats.hoa_labels",
        "if len(self.known) * self.letters > MAX_STORED:",
        "len(self.known) * self.letters > MAX_STORED",
        "(len(self.known) * self.letters >= MAX_STORED)",
    ): "what is known is worked out again: memory, not results",
    (
        "pareto_ltl.logic.progression",
        "if 0 in clauses:",
        "0",
        "1",
    ): "0 implies nothing else, so that the loop below keeps it alone; no clause is the bit of true, 1",
}
