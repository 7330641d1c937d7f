"""The modules that are mutated, the tests that must notice, and mutants that change no result."""

from __future__ import annotations

from pathlib import Path

SOURCE = Path(__file__).parents[2] / "src"
PACKAGES = (  # what plans depend on
    "careful_io", "flight_quantities", "ltlf", "plane_kernels", "plane_logic", "pareto_ltl",
    "pareto_ltl_apps/formats", "wind_laws", "declared_settings",
)  # fmt: skip
MEASURED = ("pareto_ltl.run.compile_costs",)  # seconds that were measured, for the share that is done
UNCOMPILED = ("pareto_ltl.kernels", "plane_kernels", "plane_logic")  # their tests run without compilation
FOLDERS = (  # of tests, and modules beside them, which run compiled kernels
    "careful_io", "flight_quantities", "logic", "planning", "run", "settings", "simulation", "support",
    "wind", "world", "kernels", "exports", "inflight", "preflight", "report", "studies", "verify",
    "test_docs.py", "wind_laws", "declared_settings",
)  # fmt: skip
UNCOMPILED_FOLDERS = ("kernels",)
UNCOMPILED_SETTINGS = {"NUMBA_DISABLE_JIT": "1", "PARETO_LTL_TESTS": "day"}  # others take hours as Python


def modules() -> dict[str, Path]:
    """The modules that are mutated, by name."""
    found = {}
    for package in PACKAGES:
        for file in (SOURCE / package).rglob("*.py"):
            name = ".".join(file.relative_to(SOURCE).with_suffix("").parts)
            found[name.removesuffix(".__init__")] = file
    return {name: file for name, file in found.items() if name not in MEASURED}


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
        "ltlf.progression",
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
        "ltlf.progression",
        "if 0 in clauses:",
        "0",
        "1",
    ): "0 implies nothing else, so that the loop below keeps it alone; no clause is the bit of true, 1",
    (
        "pareto_ltl_apps.formats.map_edges",
        "return np.where(np.abs(turn) > 180.0, (turn + 180.0) % 360.0 - 180.0, turn)",
        "turn + 180.0",
        "(turn - 180.0)",
    ): "half a turn to either side is the same",
    (
        "pareto_ltl.run.second_process",
        "if kind is None or not _may_start():",
        "not _may_start()",
        "(_may_start())",
    ): "whether a second process compiles too: time, not results",
    (
        "wind_laws.gp",
        "coverage = np.mean(np.abs(scores) <= NORMAL_QUANTILE_95)",
        "np.abs(scores) <= NORMAL_QUANTILE_95",
        "(np.abs(scores) < NORMAL_QUANTILE_95)",
    ): "real numbers are never equal",
    (
        "pareto_ltl.world.scene_checks",
        "if error > LARGEST_ERROR:",
        "error > LARGEST_ERROR",
        "(error >= LARGEST_ERROR)",
    ): "real numbers are never equal",
    (
        "pareto_ltl.planning.shortest_mission",
        "if needed <= MARGIN * model.capacity:",
        "needed <= MARGIN * model.capacity",
        "(needed < MARGIN * model.capacity)",
    ): "real numbers are never equal",
}
