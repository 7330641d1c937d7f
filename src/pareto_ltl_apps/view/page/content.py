"""The page as one HTML file: texts for its template, numbers for its script, and both in the template.

Style and scripts of this folder and of the components, and the data, are in the file: it loads nothing else,
and a policy in its head forbids loading.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from functools import lru_cache
from importlib.resources import files
from typing import TYPE_CHECKING, Any

import numpy as np

from careful_io.texts import distance_text, interval_text, probability_text
from pareto_ltl import Scene
from pareto_ltl.extend import Deployment, FailureRate, Front, Plan, cost_named
from pareto_ltl.support.display import branched_text, headline_text, winds_text
from pareto_ltl_apps.exports.exported import absent_sentence, height_sentence, vehicle_of
from pareto_ltl_apps.view.components import MODULES, STYLE, bundled, component, page_environment
from pareto_ltl_apps.view.in_words import mission_in_words
from pareto_ltl_apps.view.limits import PlanLimits, chosen_number, priced_obstacles
from pareto_ltl_apps.view.page import points
from pareto_ltl_apps.view.page.ground import map_places, shown_geography, shown_map, shown_trees, shown_wind
from pareto_ltl_apps.view.page.machine import shown_automaton
from pareto_ltl_apps.view.records import ShownRun
from pareto_ltl_apps.view.trade import Trade

if TYPE_CHECKING:
    from jinja2 import Template

SCHEMA = "pareto_ltl.page/2"
FOLDER = "pareto_ltl_apps.view.page"
SCRIPTS = ("basics.js", "layers.js", "files.js", "main.js")
MARKUP = str.maketrans(
    {"<": "\\u003c", ">": "\\u003e", "&": "\\u0026", "\u2028": "\\u2028", "\u2029": "\\u2029"}
)
NO_PLAN_HOURS = 24.0  # of wind that are shown if there is no plan


@dataclass(frozen=True, slots=True)
class Content:
    """The content of a page.

    Attributes
    ----------
    texts : mapping
        For the template, which escapes each text.
    data : mapping
        For the script, as JSON.
    """

    texts: dict[str, Any]
    data: dict[str, Any]


def _height(run: ShownRun) -> dict[str, Any]:
    """The height of the flight for exported files, and what they say of it."""
    sentences = height_sentence(run.height, run.air, run.medium), absent_sentence(run.scene)
    return {
        "metres": run.height.metres,
        "aboveSea": run.height.above_sea,
        "ofSea": run.height.of_sea,
        "sentence": " ".join(filter(None, sentences)),
    }


def page_content(run: ShownRun) -> Content:
    """Texts and numbers of the page of ``run``."""
    plan, front = run.plan, run.front if run.front is not None and run.front.paths else None
    limits = None if plan is None else PlanLimits(run.scene, plan, run.medium)
    chosen = chosen_number(run.front, plan)
    paths, flights = _paths(run, front, chosen)
    last = max((path["t"][-1] for path in paths.values()), default=_horizon(run))
    # the page of a plan that was made after an alarm has no front and no rates
    alone = {} if plan is None or not plan.alarmed else {"planned": map_places(run.scene, plan.path.x)}
    formula = run.automaton.formula if run.automaton is not None else plan.formula if plan else ""
    begin = run.scene.frame.utc(np.zeros(1))
    data = {
        "schema": SCHEMA,
        "name": run.name,
        "formula": formula,
        "law": _law(run),
        "timeZero": None if begin is None else begin[0],
        "map": shown_map(run.scene),
        "geography": shown_geography(run.scene),
        "onEarth": run.scene.crs is not None,
        "height": _height(run),
        "vehicle": None if run.problem is None else vehicle_of(run.height, run.problem)._asdict(),
        "wind": shown_wind(run.scene, run.wind, last),
        "trees": [] if paths or alone else shown_trees(run.scene, run.forest),
        "judge": "flights" if front is not None and front.rates else "bound",
        "points": [] if front is None else points.shown_points(front),
        "trades": [] if front is None else Trade.of(run.scene, front, plan).paragraphs(),
        "chosen": chosen,
        "paths": paths,
        "flights": flights,
        "medium": run.medium._asdict(),
        "tree": None if plan is None or plan.branching is None else shown_tree(run.scene, plan),
        "places": [] if limits is None else limits.places(),
        "pricedObstacles": [] if plan is None else priced_obstacles(plan),
        "causes": list(Deployment.CAUSES),
        "automaton": None if run.automaton is None else shown_automaton(run.automaton),
        "notCovered": "" if plan is None else plan.not_covered,
        "promise": None if plan is None or plan.promise is None else asdict(plan.promise.rate),
    } | alone
    words = mission_in_words(formula)
    texts = {
        "name": run.name,
        "title": (words[:1].upper() + words[1:]) if words else formula or run.name,
        "formula": formula,
        "why": run.why,
        "has_plan": plan is not None,
        "has_front": front is not None,
        "facts": [] if plan is None else list(_headline(run, plan, chosen)),
        "verdicts": [] if plan is None else list(_verdicts(run, plan)),
        "limits": None if limits is None or limits.plan.alarmed else limits.tables(),
        "medium": run.medium._asdict(),
        "covered": "" if plan is None else plan.covered,
        "not_covered": "" if plan is None else plan.not_covered,
        "law": _law(run),
        "origin": run.origin,
    }
    return Content(texts, data)


def shown_tree(scene: Scene, plan: Plan) -> dict[str, Any]:
    """The branches of ``plan`` for a map: lines, names, cells in words, shares; the places of the fixes.

    ``trunk`` is the line of a plan that is bent for its branches, which no point of the front has.
    """
    tree = plan.branching
    assert tree is not None
    branches = [
        {
            "name": one.name,
            "where": one.cell.words,
            "share": one.share,
            "fix": map_places(scene, own.fix.place),
            "line": map_places(scene, one.path.x),
        }
        for own, one in tree.all_branches()
    ]
    return {"trunk": None if tree.bent is None else map_places(scene, plan.path.x), "branches": branches}


def _law(run: ShownRun) -> str:
    """The wind law of the planner."""
    if run.problem is not None:
        return run.problem.fidelity.law
    return run.plan.models.law if run.plan is not None else ""


def _horizon(run: ShownRun) -> float:
    """Time for which the wind is shown if there is no point of a front [s]."""
    hours = NO_PLAN_HOURS if run.plan is None else float(run.plan.path.t[-1]) / 3600.0
    return min(run.wind.known_until, 3600.0 * hours)


def _paths(
    run: ShownRun, front: Front | None, chosen: int | None
) -> tuple[dict[str, Any], dict[str, Any] | None]:
    """The paths by their number in the front, and the flights of the chosen one."""
    if run.problem is None:
        return {}, None
    given = run.deployments.get(run.problem.fidelity.law)
    paths = {}
    if front is not None:
        logged = set(points.told_points(front, chosen))
        for k in points.told_points(front, chosen, points.MAX_PLAIN_LEGS):
            flown = given if k == chosen else None
            paths[str(k)] = points.shown_path(run, run.problem, front.paths[k], flown, logged=k in logged)
    flights = None if given is None or chosen is None else points.shown_flights(run.scene, run.problem, given)
    return paths, flights


# --- texts -----------------------------------------------------------------------------------


def _headline(run: ShownRun, plan: Plan, chosen: int | None) -> Iterator[dict[str, str]]:
    """The numbers at the top: name, value, and a note with the wind law or unit."""

    def fact(name: str, value: str, note: str) -> dict[str, str]:
        return {"name": name, "value": value, "note": note}

    promise, path, flows = plan.promise, plan.path, run.medium.flows
    cost, times = path.objectives, run.scene.frame.utc(path.t)
    if promise is not None:
        gap = plan.level_gap
        promised = promise.rate if plan.branching is None else plan.branching.rate
        where = winds_text(flows, promised.law, gap)
        sample = f"{promised.sample} under {promised.law} {flows}"
        value, note = headline_text(
            promised.failure, promised.low, promised.high, where, sample, promise.floor
        )
        if plan.branching is not None:
            note = branched_text(note, promise.rate.failure, promise.floor)
        yield fact("fails", value, note + (f"; no promise: {gap}" if gap else ""))
    elif plan.alarmed:
        yield fact("fails", "no promise", Plan.NO_PROMISE)
    else:
        note = f"upper bound of failures of the mission and collisions, under {plan.models.law} {flows}"
        yield fact("fails", _at_most(min(1.0, cost.mission_risk + cost.collision_risk)), note)
    if promise is None and run.deployments:  # under the law with the most failures: a bound holds for one law
        rates = [flown.rate for _, flown in sorted(run.deployments.items())]
        worst = max(rates, key=lambda rate: rate.failure)
        yield fact("simulated to fail", probability_text(worst.failure), _interval_note(worst, flows))
    minutes = round((path.t[-1] - path.t[0]) / 60.0)
    seconds = f"{float(path.t[-1] - path.t[0]):,.0f} s"
    duration = f"{minutes // 60} h {minutes % 60:02d} min" if minutes >= 60 else seconds
    yield fact("length", distance_text(cost.length), "of the expected path")
    yield fact("duration", duration, f"{len(path.u)} steps of {plan.dt:,.6g} s")
    for name, amount in cost.further_costs.items():
        yield fact(name, cost_named(name).text(amount), cost_named(name).note)
    if times is not None:
        for name, time in (("departure", times[0]), ("arrival", times[-1])):
            yield fact(name, f"{time[11:16]} UTC", time[:10])
    if chosen is not None:
        yield fact("chosen", f"point {chosen}", f"of the front, rule {plan.rule}")


def _interval_note(rate: FailureRate, flows: str) -> str:
    return f"{interval_text(rate.low, rate.high)} (95 %), under {rate.law} {flows}, {rate.sample}"


def _at_most(bound: float) -> str:
    """``≤ 2.9 %``, or ``< 1e-7 %``."""
    text = probability_text(bound)
    return text if text.startswith("<") else f"≤ {text}"


def _verdicts(run: ShownRun, plan: Plan) -> Iterator[dict[str, str]]:
    """Rows of the table of failures: what, wind law, rate, interval, source."""
    if plan.promise is not None:
        promise = plan.promise
        stands = "the claim stands" if promise.passed else "above what the front claimed"
        promised = "" if plan.level_gap else "promised: "
        fresh = _row(f"{promised}fresh flights of the plan", promise.rate, f"{promise.rate.sample}; {stands}")
        yield fresh | {"rate": promise.fails}
        yield _row("claimed when the front was judged", promise.claimed, promise.claimed.sample)
    if (tree := plan.branching) is not None:
        when = f"{round(tree.fix.step * plan.dt) / 3600:.4g} h"
        off = (
            f", and {round(tree.fix.rejoin * plan.dt) / 3600:.4g} h to fly its distance off"
            f"{', then against its drift' if tree.fix.counter else ''}"
            if tree.fix.rejoin
            else ""
        )
        yield _row(f"the plan with branches after a fix at {when}{off}", tree.rate, tree.rate.sample)
        for _, branch in tree.all_branches():
            told = f"{branch.rate.sample}: {probability_text(branch.share)} of those with the fix"
            yield _row(f"branch {branch.name}, {branch.cell.words}", branch.rate, told)
    for law in _laws(run.deployments, plan.models.law):
        flown = run.deployments[law]
        source = f"{flown.rate.sample}: {_causes(flown)}"
        yield _row("simulated flights of the plan", flown.rate, source)
    for law in _laws(run.forecasts, plan.models.law):
        seen = run.forecasts[law]
        bound = min(1.0, seen.mission_risk + seen.collision_risk)
        yield {
            "what": "upper bound for the plan", "law": law, "rate": _at_most(bound),
            "interval": "", "source": f"{probability_text(seen.mission_risk)} for the mission (V), "
            f"{probability_text(seen.collision_risk)} for collisions (R); it guides the search",
        }  # fmt: skip


def _laws(found: Iterable[str], first: str) -> list[str]:
    """The wind laws of ``found``; ``first``, the law of the plan, comes first."""
    return sorted(found, key=lambda law: (law != first, law))


def _row(what: str, rate: FailureRate, source: str) -> dict[str, str]:
    return {
        "what": what, "law": rate.law, "rate": probability_text(rate.failure),
        "interval": interval_text(rate.low, rate.high), "source": source,
    }  # fmt: skip


def _causes(flown: Deployment) -> str:
    """Numbers of flights that met an obstacle, missed the mission, left the map; one can count in several."""
    causes = [
        f"{int(flown.collided.sum()):,} met an obstacle",
        f"{int((~flown.accepted).sum()):,} missed the mission",
        f"{int(flown.off_map.sum()):,} left the map" + ("" if flown.walled else " (allowed)"),
    ]
    return ", ".join(causes)


# --- the file ----------------------------------------------------------------------------------


def page_bytes(content: Content) -> bytes:
    """The file; the same content gives the same bytes."""
    template = page_template()
    return template.render(**content.texts, data=json_for_script(content.data)).encode()


def json_for_script(data: dict[str, Any]) -> str:
    """``data`` as JSON for a script element: markup characters are escaped, so that no text can end it."""
    return json.dumps(data, allow_nan=False, separators=(",", ":"), ensure_ascii=False).translate(MARKUP)


@lru_cache(maxsize=1)
def page_template() -> Template:
    """The template, with style and scripts of this folder inserted; it escapes everything else."""
    from markupsafe import Markup

    folder, environment = files(FOLDER), page_environment()
    own = {name: folder.joinpath(name).read_text(encoding="utf-8") for name in ("page.css", *SCRIPTS)}
    environment.globals["style"] = Markup(component(STYLE) + own["page.css"])
    parts = [*map(component, MODULES), *(own[name] for name in SCRIPTS)]
    environment.globals["script"] = Markup(bundled(parts))
    return environment.from_string(folder.joinpath("page.html").read_text(encoding="utf-8"))
