"""What limits the chosen plan: tables for the template, and tight places for the map."""

from __future__ import annotations

from typing import Any

from pareto_ltl.planning.records import Plan
from pareto_ltl.report.limits import (
    NO_PRICES,
    NO_SEGMENTS,
    TIGHT_PRICE,
    TIGHT_RISK,
    epsilon_text,
    points_text,
    price_rows,
    segment_rows,
    tight_places,
    unsure_text,
)
from pareto_ltl.support.display import probability_text
from pareto_ltl.support.medium import AIR, Medium
from pareto_ltl.world.scene import Scene


def limit_texts(scene: Scene, plan: Plan, medium: Medium = AIR) -> dict[str, Any]:
    """Rows of both tables, and the texts around them."""
    return {
        "fails": "" if plan.promise is None else probability_text(plan.promise.rate.failure),
        "tight_price": probability_text(TIGHT_PRICE),
        "tight_risk": probability_text(TIGHT_RISK * plan.epsilon),
        "no_prices": unsure_text(plan) or NO_PRICES,
        "unsure": unsure_text(plan),
        "no_segments": NO_SEGMENTS,
        "prices": [
            {
                "limit": row.limit, "time": row.time or "–", "change": row.change,
                "saved": points_text(row.saving),
            }
            for row in price_rows(scene, plan, medium=medium)
        ],
        "segments": [
            {
                "time": f"{row.begin}\u00a0– {row.end}", "barrier": row.barrier,
                "deviations": f"{row.deviations:.1f}", "probability": probability_text(row.probability),
                "allowed": epsilon_text(plan),
            }
            for row in segment_rows(scene, plan)
        ],
    }  # fmt: skip


def shown_places(scene: Scene, plan: Plan, medium: Medium = AIR) -> list[dict[str, Any]]:
    """The tight places of the plan: the step at which each begins, and lines of text for the pointer."""
    return [{"step": step, "lines": lines} for step, lines in tight_places(scene, plan, medium)]
