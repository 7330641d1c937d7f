"""Files of a plan that branches: a table for each branch, and cards to print.

``branch_A.csv`` and so on have the columns of ``dead_reckoning.csv``, ``branch_A_card.csv`` the columns of
``flight_card.csv``, both from the fix on; after a second fix branch A goes on as A1, A2, .... In
``branch_cards.html``, for people, a page for each fix asks where the measured position lies, with a map to
plot it on, and each branch has a page.
"""

from __future__ import annotations

import html
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from careful_io.texts import distance_text, probability_text, rate_text
from pareto_ltl.extend import Branch, Branching, FlownAir, Frame, Plan, Problem, plans_on_branches
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl_apps.exports.navigation_log import SHARE, NavigationLog, navigation_log

OF_STEPS = ("t", "x", "utc", "lat", "lon", "major", "minor", "azimuth", "radius")  # T + 1 entries
WHOLE = ("law", "fixes", "late", "swing")  # not by step
SPAN = 3.2  # standard deviations of the measured position that the map of a card shows
SIZE = 560.0  # pixels of that map
STEPS_KM = (0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)  # of the table of what is flown off
COLORS = ("#2a78b5", "#c96f12", "#2f8f4e", "#8a4fa3")  # of the branches, also apart in grey


@dataclass(frozen=True, slots=True)
class ExportedBranch:
    """A branch and its navigation log.

    Attributes
    ----------
    branch : Branch
    tree : Branching
        The fix that selects the branch, with its other branches.
    log : NavigationLog
        From the fix on; legs count from the departure of the plan.
    plan, on_it : Plan
        What is flown without the fix, and with this branch, from the departure on.
    """

    branch: Branch
    tree: Branching
    log: NavigationLog
    plan: Plan
    on_it: Plan

    @property
    def name(self) -> str:
        """A, B, C or D; after a second fix A1, A2, ..."""
        return self.branch.name

    @property
    def first(self) -> int:
        """The step of the fix."""
        return self.tree.fix.step


def exported_branches(problem: Problem, plan: Plan, air: FlownAir | None) -> tuple[ExportedBranch, ...]:
    """The branches of ``plan`` with their logs, A, A1, A2, B, ...; none if it has none."""
    found = []
    for before, branch, on_it in plans_on_branches(plan):
        tree = before.branching
        assert tree is not None
        log = _log_from(problem, on_it, tree.fix.step, air)
        found.append(ExportedBranch(branch, tree, log, before, on_it))
    return tuple(found)


def _log_from(problem: Problem, on_it: Plan, step: int, air: FlownAir | None) -> NavigationLog:
    """The log of a branch from its fix on: winds are those that the flights of its cell expect."""
    log = navigation_log(problem, on_it.path, air)
    cut = {
        field.name: getattr(log, field.name)[step:]
        for field in fields(NavigationLog)
        if field.name not in WHOLE and getattr(log, field.name) is not None
    }
    return replace(log, **cut, fixes=())


def branch_sentences(
    tree: Branching, log: NavigationLog, branches: Sequence[ExportedBranch]
) -> Iterator[str]:
    """Sentences for people: when the plan branches, what then, and how often it fails with its branches.

    ``log`` is the one of the plan that is flown without a fix.
    """
    yield from _selected(tree, _moment(log, tree.fix.step), "At", "the plan")
    for one in branches:
        if (then := one.branch.then) is not None:
            when = _moment(one.log, then.fix.step - one.first)
            yield from _selected(then, when, f"On branch {one.name}, at", f"branch {one.name}")
    rate = tree.rate
    yield (
        f"Of {rate.sample} with these branches, {rate_text(rate.failure, rate.low, rate.high)} fail; of the "
        f"same flights without the fix, {rate_text(tree.alone.failure, tree.alone.low, tree.alone.high)}."
    )


def _moment(log: NavigationLog, k: int) -> str:
    return log.time_utc(k) or f"{log.t[k]:g} s"


def _selected(tree: Branching, moment: str, begin: str, what: str) -> Iterator[str]:
    """What a fix selects, and the cell of each branch; ``what`` goes on without it."""
    yield f"{begin} {moment} a position fix selects {_named(tree)}; without it, {what} goes on."
    for branch in tree.branches:
        yield f"Branch {branch.name}: the measured position is {branch.cell.words}."
    if tree.fix.rejoin:
        yield f"The distance of the measured position from the planned one is flown off {rejoin_text(tree)}."


def _named(tree: Branching) -> str:
    """The branches that a fix selects from."""
    names = [branch.name for branch in tree.branches]
    if len(names) == 1:
        return f"branch {names[0]}"
    return f"one of the branches {', '.join(names[:-1])} and {names[-1]}"


def rejoin_text(tree: Branching) -> str:
    """How the distance from the planned position is flown off, after "flown off"."""
    later = 1000.0 * tree.fix.counter
    rate = 1000.0 / rejoin_seconds(tree) + later
    against = f"; from then on {later:.3g} m/s, against further drift" if later else ""
    return (
        f"in the {clock(rejoin_seconds(tree))} after the fix: for each kilometre ahead of it the velocity "
        f"through the air is {rate:.3g} m/s less along the planned track, for each kilometre left of it "
        f"{rate:.3g} m/s more to the right, within the airspeeds of the robot{against}"
    )


def rejoin_seconds(tree: Branching) -> float:
    """How long the distance from the planned position is flown off [s]."""
    t = tree.branches[0].path.t
    return float(tree.fix.rejoin * (t[1] - t[0]))


def branch_lines(plan: Plan, frame: Frame) -> Iterator[str]:
    """Lines for the terminal: the questions, the answers, and what each number of branches would give."""
    tree = plan.branching
    assert tree is not None
    yield from _question_lines(plan, tree, frame, "the plan")
    for _, branch, on_it in plans_on_branches(plan):
        if on_it.branching is not None:
            yield f"branch {branch.name} branches again:"
            yield from _question_lines(on_it, on_it.branching, frame, f"branch {branch.name}")
    yield (
        f"fails {rate_text(tree.rate.failure, tree.rate.low, tree.rate.high)} with branches, "
        f"{rate_text(tree.alone.failure, tree.alone.low, tree.alone.high)} without"
    )
    if tree.bent is not None:
        middle, low, high = (100.0 * part for part in tree.bent)
        yield (
            f"the plan is bent for its branches: {middle:+.1f} points of failures ({low:+.1f} to "
            f"{high:+.1f}) against the same search without the bend"
        )
    parts = [
        f"{row.leaves if row.fixes else 'none'}{' after two fixes' * (row.fixes > 1)}: "
        f"{probability_text(row.rate.failure)}"
        for row in tree.front
    ]
    yield f"by number of branches, in the flights of the search: {', '.join(parts)}"


def _question_lines(plan: Plan, tree: Branching, frame: Frame, what: str) -> Iterator[str]:
    """When to measure, and what to fly then; without it ``what`` goes on."""
    fix, utc = tree.fix, frame.utc(plan.path.t)
    where = f"{fix.place[0]:.0f}, {fix.place[1]:.0f} m" if frame.crs is None else _place(frame, fix.place)
    bearing = "" if frame.crs is None else f", planned track {track_bearing(frame, tree):.0f}° true"
    yield (
        f"{clock(fix.step * plan.dt)} after departure{'' if utc is None else f' ({utc[fix.step]})'}: "
        f"measure the position (planned: {where}{bearing}; sd {distance_text(fix.sd)})"
    )
    for branch in tree.branches:
        rate = branch.rate
        yield (
            f"  {branch.name}: {branch.cell.words} ({100 * branch.share:.0f} % of flights): branch_"
            f"{branch.name}.csv; order {branch.path.order or '-'}; "
            f"{probability_text(rate.failure)} of them fail"
        )
    if fix.rejoin:
        yield f"  then fly the distance from the planned position off {rejoin_text(tree)}"
    yield f"no fix ({100 * (1 - fix.available):.0f} % expected): {what} goes on"


# --- lines on a map --------------------------------------------------------------------------------


def dividing_lines(tree: Branching, reach: float) -> list[tuple[str, FloatArray]]:
    """The lines between the cells, each with its meaning and two ends (2, 2) [m], at most ``reach`` away."""
    found = set[tuple[int, float, float, float]]()
    for branch in tree.branches:
        box = [np.clip(ends, -reach, reach) for ends in (branch.cell.along, branch.cell.left)]
        for i in (0, 1):
            for end in (branch.cell.along, branch.cell.left)[i]:
                if math.isfinite(end):
                    found.add((i, end, *box[1 - i].tolist()))
    lines = []
    for i, end, low, high in sorted(found):
        # A cell beside several others has the lines of all of them in one.
        if any(
            one[:2] == (i, end) and one[2] <= low and high <= one[3] for one in found - {(i, end, low, high)}
        ):
            continue
        ends = np.empty((2, 2))
        ends[:, i], ends[:, 1 - i] = end, (low, high)
        lines.append((("across the track", "along the track")[i], tree.fix.place + ends @ tree.fix.axes))
    return lines


def cell_outline(branch: Branch, tree: Branching, reach: float) -> FloatArray:
    """The corners (4, 2) [m] of a cell, cut ``reach`` [m] from the planned position."""
    (a, b), (c, d) = (np.clip(ends, -reach, reach) for ends in (branch.cell.along, branch.cell.left))
    return np.asarray(tree.fix.place + np.array([[a, c], [b, c], [b, d], [a, d]]) @ tree.fix.axes, float)


def reach_of(tree: Branching, plan: Plan) -> float:
    """How far from the planned position a map of the fix reaches [m]."""
    cov = plan.path.cov[tree.fix.step] + tree.fix.sd**2 * np.eye(2)
    return SPAN * float(np.sqrt(np.linalg.eigvalsh(cov)[-1]))


def measured_ellipse(tree: Branching, plan: Plan) -> FloatArray:
    """Corners (72, 2) [m] of the ellipse that holds 95 % of the measured positions."""
    cov = plan.path.cov[tree.fix.step] + tree.fix.sd**2 * np.eye(2)
    angle = np.linspace(0.0, 2.0 * math.pi, 72, endpoint=False)
    circle = math.sqrt(-2.0 * math.log(1.0 - SHARE)) * np.column_stack([np.cos(angle), np.sin(angle)])
    return np.asarray(tree.fix.place + circle @ np.linalg.cholesky(cov).T, float)


def track_bearing(frame: Frame, tree: Branching) -> float:
    """True direction of the planned track at the fix [deg]."""
    east, north = tree.fix.ahead
    grid = math.degrees(math.atan2(east, north))
    return (grid + math.degrees(float(frame.north(tree.fix.place)[0]))) % 360.0


# --- the cards --------------------------------------------------------------------------------------

STYLE = """
body { font: 11pt/1.4 system-ui, sans-serif; color: #111; margin: 1.5em auto; max-width: 48em; }
h1 { font-size: 1.4em; margin: 0 0 .3em; } h2 { font-size: 1.15em; margin: 1em 0 .3em; }
section { break-after: page; } section:last-of-type { break-after: auto; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; }
th, td { text-align: right; padding: .15em .5em; border-bottom: 1px solid #bbb; }
td.place { white-space: nowrap; }
th { border-bottom: 2px solid #111; font-weight: 600; } th:first-child, td:first-child { text-align: left; }
.answers td, .answers th { text-align: left; } .letter { font-size: 1.5em; font-weight: 700; width: 1.6em; }
.note { color: #444; } svg { max-width: 100%; height: auto; display: block; margin: .6em auto; }
"""


def branch_cards(name: str, plan: Plan, frame: Frame, branches: Sequence[ExportedBranch]) -> bytes:
    """``branch_cards.html``: the question with its map, a page for each branch, and its second question."""
    tree = plan.branching
    assert tree is not None
    pages = [_question(name, plan, tree, frame, [one for one in branches if one.tree is tree])]
    for one in branches:
        pages.append(_table(one))
        if (then := one.branch.then) is not None:
            title = f"{name}, on table {one.name}"
            pages.append(
                _question(title, one.on_it, then, frame, [b for b in branches if b.tree is then], one.name)
            )
    body = "\n".join(f"<section>\n{page}\n</section>" for page in pages)
    title = html.escape(f"{name}: branches")
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{title}</title>'
        f"<style>{STYLE}</style></head>\n<body>\n{body}\n</body></html>\n"
    ).encode()


def clock(seconds: float) -> str:
    """Hours, minutes and seconds after departure: ``5:00:00``."""
    total = round(seconds)
    return f"{total // 3600}:{total // 60 % 60:02d}:{total % 60:02d}"


def degrees(lat: float, lon: float) -> str:
    """A place in degrees and minutes: ``36° 12.34' N, 93° 05.60' W``."""

    def one(value: float, positive: str, negative: str) -> str:
        minutes = round(abs(value) * 60.0, 2)
        return f"{int(minutes // 60)}° {minutes % 60:05.2f}' {positive if value >= 0 else negative}"

    return f"{one(lat, 'N', 'S')}, {one(lon, 'E', 'W')}"


def _question(
    name: str, plan: Plan, tree: Branching, frame: Frame, branches: Sequence[ExportedBranch], table: str = ""
) -> str:
    """The page of a fix; it is taken on ``table``, or on the flight card of the plan."""
    fix, log = tree.fix, branches[0].log
    lon, lat = (float(part[0]) for part in frame.to_geographic(fix.place[None]))
    when = clock(fix.step * plan.dt) + " after departure" + (f" ({log.utc[0]})" if log.utc else "")
    reach = reach_of(tree, plan)
    rows = "".join(
        f'<tr><td class="letter" style="color:{color}">{one.name}</td>'
        f"<td>{html.escape(one.branch.cell.words)}</td><td>{100 * one.branch.share:.0f} %</td></tr>"
        for one, color in zip(branches, COLORS, strict=False)
    )
    lines = "".join(
        f"<tr><td>{what}</td><td>{_beside(tree, ends, reach)}</td><td>{_place(frame, ends[0])}</td>"
        f"<td>{_place(frame, ends[1])}</td></tr>"
        for what, ends in dividing_lines(tree, reach)
    )
    rate, alone = tree.rate, tree.alone
    landmark = " inside the landmark" if fix.landmark is not None else ""
    without = f"table {table}" if table else "the flight card of the plan"
    flights = f"{rate.runs:,} flights that flew table {table} and then" if table else f"{rate.sample} with"
    return f"""<h1>{html.escape(name)}: which table to fly{" next" * bool(table)}</h1>
<p><b>{when}</b>, measure the position{landmark} (standard deviation {distance_text(fix.sd)}).
<b>Where is it?</b> Plot it on the map, and fly from then on the table of the letter that it lies on.
No position: go on with {without}, and add nothing.</p>
<table class="answers"><tr><th>table</th><th>the measured position is</th><th>how often</th></tr>
{rows}</table>
{_map(tree, plan, frame, reach)}
<p>Planned position {degrees(lat, lon)} ({lat:.4f}, {lon:.4f}); planned track
{track_bearing(frame, tree):.0f}° true. Left and right are seen along the track; ticks are
{_tick(reach):g} km apart. {_by_hand(frame, tree)}
The dashed ellipse holds 95 % of the measured positions. A position outside of the map is out of what
the plan expects: check it before you use it.</p>
{_lines_table(lines)}{_rejoin_table(tree, reach)}
<p class="note">Of {flights} these tables, {rate_text(rate.failure, rate.low, rate.high)} fail;
of the same flights without the fix, {rate_text(alone.failure, alone.low, alone.high)}.</p>"""


def _beside(tree: Branching, ends: FloatArray, reach: float) -> str:
    """The letters on both sides of a line between cells: ``A | B, C``."""
    at = ends[0] + np.linspace(0.02, 0.98, 49)[:, None] * (ends[1] - ends[0])
    along = (ends[1] - ends[0]) / np.hypot(*(ends[1] - ends[0]))
    sides = (1e-3 * reach * np.array([-along[1], along[0]]), 1e-3 * reach * np.array([along[1], -along[0]]))
    names = [sorted({tree.branches[k].name for k in tree.chosen(at + side)}) for side in sides]
    return " | ".join(", ".join(part) for part in sorted(names))


def _by_hand(frame: Frame, tree: Branching) -> str:
    """How to get the two distances from a latitude and a longitude, near the planned position."""
    lon, lat = (float(part[0]) for part in frame.to_geographic(tree.fix.place[None]))
    beside = frame.to_plane(np.array([lon, lon + 0.1]), np.array([lat + 0.1, lat]))
    (ahead_lat, left_lat), (ahead_lon, left_lon) = tree.fix.distances(beside) / 100.0  # km for a degree

    def sum_of(north: float, east: float) -> str:
        return f"{north:.1f} N {'+' if east >= 0.0 else '-'} {abs(east):.1f} E"

    return (
        "In km, by degrees of latitude north (N) and of longitude east (E) of the planned position: "
        f"{sum_of(ahead_lat, ahead_lon)} ahead, {sum_of(left_lat, left_lon)} to the left; less than 0 is "
        "behind, or to the right."
    )


def _lines_table(lines: str) -> str:
    """The lines between the cells by their ends; nothing for one cell."""
    if not lines:
        return ""
    head = '<table class="answers"><tr><th>line</th><th>between</th><th>from</th><th>to</th></tr>'
    return f"{head}{lines}</table><p>On a line, either table will do.</p>"


def _tick(reach: float) -> float:
    """The distance of ticks on the map, and of the rows of the table of velocities [km]."""
    return next((one for one in STEPS_KM if 4.0 * one >= reach / 1e3), STEPS_KM[-1])


def _rejoin_table(tree: Branching, reach: float) -> str:
    """What to add to the table for some time, by the distance from the planned position."""
    if not tree.fix.rejoin:
        return ""
    seconds, later, unit = rejoin_seconds(tree), tree.fix.counter, _tick(reach)
    rows = "".join(
        f"<tr><td>{d:g} km</td><td>{1e3 * d * (1.0 / seconds + later):.{places}f}</td>"
        + (f"<td>{1e3 * d * later:.{places}f}</td>" if later else "")
        + "</tr>"
        for d, places in ((1.0, 4), *((k * unit, 2) for k in (1, 2, 3, 4)))
    )
    again = any(branch.then is not None for branch in tree.branches)
    title, legs = f"for {clock(seconds)}", f"each of its legs until {clock(seconds)} after the fix"
    columns = "<th>velocity to add [m/s]</th>"
    if later:
        title, legs = "then go on against the drift that it tells of", "each of its legs"
        columns = (
            f"<th>velocity to add for {clock(seconds)} after the fix [m/s]</th>"
            f"<th>instead of it, from then to the {'next fix or the ' * again}end [m/s]</th>"
        )
    return f"""<h2>And fly the distance off, {title}</h2>
<p>With whichever table, add to the velocity through the air of {legs} two velocities. Their directions are
of the planned track at the fix, whatever the heading of a leg: along it for what the position is
<b>behind</b> the planned one, or against it for what it is <b>ahead</b>; and to the right for what it is
<b>left</b> of the track, or to the left for what it is <b>right</b> of it. Each is in proportion to its
distance. The sum gives heading and true airspeed; if the robot is not as fast or as slow as that, its nearest
airspeed.</p>
<table class="answers"><tr><th>distance</th>{columns}</tr>{rows}</table>
"""


def _added(tree: Branching, plan: Plan) -> str:
    """What a table says of the velocity that is added to it."""
    until = clock(tree.fix.step * plan.dt + rejoin_seconds(tree))
    if not tree.fix.rejoin:
        return ""
    if not tree.fix.counter:
        return f" <b>Until {until} add the velocity of the page before.</b>"
    return f" <b>Until {until} add the first velocity of the page before, from then on the second one.</b>"


def _place(frame: Frame, point: FloatArray) -> str:
    lon, lat = (float(part[0]) for part in frame.to_geographic(point[None]))
    return f"{lat:.4f}, {lon:.4f}"


def _table(one: ExportedBranch) -> str:
    """The page of a branch; the leg at which it branches again begins with a line that says so."""
    tree, log, branch, plan = one.tree, one.log, one.branch, one.plan
    calibrated, then = plan.air is not None, branch.then
    rows = []
    for k in range(log.legs):
        if then is not None and one.first + k == then.fix.step:
            rows.append(
                f'<tr><td colspan="9"><b>measure the position: the next page says to fly {_tables(then)}. No '
                "position: go on here.</b></td></tr>"
            )
        speed = log.calibrated[k] if calibrated else log.airspeed[k]
        heading = "" if math.isnan(log.heading[k]) else f"{round(log.heading[k]) % 360:03d}°"
        utc = "" if log.utc is None else f"<td>{log.utc[k][11:19]}</td>"
        rows.append(
            f"<tr><td>{one.first + k}</td><td>{clock(log.t[k])}</td>{utc}<td>{heading}</td>"
            f"<td>{speed:.1f}</td>"
            f'<td class="place">{log.lat[k]:.4f}, {log.lon[k]:.4f}</td>'
            f"<td>{log.radius[k] / 1e3:.1f}</td></tr>"
        )
    end = log.legs
    utc = "" if log.utc is None else f"<td>{log.utc[end][11:19]}</td>"
    rows.append(
        f"<tr><td>arrival</td><td>{clock(log.t[end])}</td>{utc}<td></td><td></td>"
        f"<td>{log.lat[end]:.4f}, {log.lon[end]:.4f}</td><td>{log.radius[end] / 1e3:.1f}</td></tr>"
    )
    head = "<th>UTC</th>" if log.utc is not None else ""
    kind = "calibrated airspeed" if calibrated else "speed through the water"
    rate = branch.rate
    return f"""<h1>Table {branch.name}</h1>
<p>Fly it if the position measured {clock(tree.fix.step * plan.dt)} after departure is
<b>{html.escape(branch.cell.words)}</b>. Of {rate.runs:,} flights that flew it,
{rate_text(rate.failure, rate.low, rate.high)} failed.{_added(tree, plan)}</p>
<table><tr><th>leg</th><th>after departure</th>{head}<th>true heading</th><th>{kind} [m/s]</th>
<th>expected position</th><th>95 % within [km]</th></tr>
{"".join(rows)}</table>"""


def _tables(tree: Branching) -> str:
    """The tables of a fix: ``table A``, or ``one of the tables A and B``."""
    names = [branch.name for branch in tree.branches]
    return f"one of the tables {', '.join(names[:-1])} and {names[-1]}" if names[1:] else f"table {names[0]}"


def _map(tree: Branching, plan: Plan, frame: Frame, reach: float) -> str:
    """An SVG of the cells around the planned position, north up, with a graticule to plot a position on."""
    half, fix = 0.5 * SIZE, tree.fix
    scale = half / reach

    def at(points: FloatArray) -> list[str]:
        east, north = (np.asarray(points) - fix.place).T * scale
        return [f"{half + e:.1f},{half - n:.1f}" for e, n in zip(east, north, strict=True)]

    parts = []
    far = 1.5 * reach  # the corners of a turned square
    for branch, color in zip(tree.branches, COLORS, strict=False):
        outline = cell_outline(branch, tree, far)
        parts.append(
            f'<polygon points="{" ".join(at(outline))}" fill="{color}" fill-opacity=".16" stroke="{color}" '
            'stroke-width="2.5"/>'
        )
        near = cell_outline(branch, tree, 0.75 * reach)
        inside = np.clip(near.mean(axis=0), fix.place - 0.85 * reach, fix.place + 0.85 * reach)
        x, y = at(inside[None])[0].split(",")
        parts.append(
            f'<text x="{x}" y="{y}" font-size="44" font-weight="700" text-anchor="middle" fill="{color}">'
            f"{branch.name}</text>"
        )
    parts += _graticule(frame, fix.place, reach, at)
    track = fix.place + np.array([[-far, 0.0], [far, 0.0]]) @ fix.axes
    tip = fix.place + np.array([[0.9 * reach, 0.0]]) @ fix.axes
    a, b = at(track)
    x, y = at(tip)[0].split(",")
    parts.append(
        f'<line x1="{a.split(",")[0]}" y1="{a.split(",")[1]}" x2="{b.split(",")[0]}" y2="{b.split(",")[1]}" '
        'stroke="#111" stroke-dasharray="2 4"/>'
    )
    turn = -math.degrees(math.atan2(fix.ahead[1], fix.ahead[0]))
    parts.append(
        f'<path d="M-12,-7 L2,0 L-12,7 Z" fill="#111" transform="translate({x},{y}) rotate({turn:.1f})"/>'
    )
    ellipse = measured_ellipse(tree, plan)
    parts.append(
        f'<polygon points="{" ".join(at(ellipse))}" fill="none" stroke="#111" stroke-width="1.2" '
        'stroke-dasharray="7 5"/>'
    )
    parts += _ticks(tree, reach, at)
    parts.append(f'<circle cx="{half}" cy="{half}" r="5" fill="#111"/>')
    parts.append(f'<text x="{half + 9}" y="{half - 9}" font-size="13">planned position</text>')
    side = SIZE + 2 * EDGE
    inside = "".join(part for part in parts if RIM not in part)
    return (
        f'<svg viewBox="{-EDGE} {-EDGE} {side} {side}" width="{side:.0f}" role="img" '
        f'aria-label="cells of the measured position"><clipPath id="frame">'
        f'<rect width="{SIZE}" height="{SIZE}"/></clipPath><g clip-path="url(#frame)">{inside}</g>'
        f'<rect width="{SIZE}" height="{SIZE}" fill="none" stroke="#111"/>'
        f"{''.join(part for part in parts if RIM in part)}</svg>"
    )


def _ticks(tree: Branching, reach: float, at: Callable[[FloatArray], list[str]]) -> list[str]:
    """The line across the planned track, and ticks with kilometres on it and on the track."""
    fix, unit, found = tree.fix, _tick(reach), []
    far = 1.5 * reach
    across = at(fix.place + np.array([[0.0, -far], [0.0, far]]) @ fix.axes)
    found.append(
        f'<polyline points="{" ".join(across)}" fill="none" stroke="#111" stroke-width=".8" '
        'stroke-dasharray="2 4"/>'
    )
    for k in (-4, -3, -2, -1, 1, 2, 3, 4):
        for i in (0, 1):
            d, size = k * unit * 1e3, 0.012 * reach
            ends = np.full((3, 2), d)
            ends[:, 1 - i] = (-size, size, -4.0 * size)
            points = at(fix.place + ends @ fix.axes)
            x, y = points[2].split(",")
            found.append(f'<polyline points="{points[0]} {points[1]}" fill="none" stroke="#111"/>')
            if abs(k) == 1:  # beside the name of the planned position
                continue
            found.append(
                f'<text x="{x}" y="{y}" font-size="10" text-anchor="middle" dominant-baseline="middle" '
                f'fill="#333">{abs(k) * unit:g}</text>'
            )
    return found


RIM = 'class="rim"'  # texts outside of the frame of the map
EDGE = 46.0  # pixels around the map for the labels of the graticule
INTERVALS = (1 / 60, 1 / 30, 1 / 12, 0.1, 0.2, 0.25, 0.5, 1.0, 2.0, 5.0)  # of the graticule [deg]


def _graticule(frame: Frame, place: FloatArray, reach: float, at: object) -> list[str]:
    """Lines of latitude and longitude with their labels on the rim."""
    assert callable(at)
    corners = place + reach * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    lon, lat = (np.asarray(part, float) for part in frame.to_geographic(corners))
    found = []
    for which, (low, high) in enumerate(((lon.min(), lon.max()), (lat.min(), lat.max()))):
        step = next((one for one in INTERVALS if (high - low) / one <= 8), INTERVALS[-1])
        other = np.linspace(*(((lat if which == 0 else lon).min(), (lat if which == 0 else lon).max())), 24)
        for value in np.arange(math.ceil(low / step), math.floor(high / step) + 1) * step:
            line = np.full(24, value)
            points = frame.to_plane(*((line, other) if which == 0 else (other, line)))
            found.append(
                f'<polyline points="{" ".join(at(points))}" fill="none" stroke="#666" stroke-width=".7"/>'
            )
            offset = (points - place)[:, which]
            along = (points - place)[:, 1 - which]
            here = float(np.interp(-reach, along, offset))
            if abs(here) > reach:
                continue
            text = f"{abs(value):.3f}".rstrip("0").rstrip(".") + "°"
            text += ("E" if value >= 0 else "W") if which == 0 else ("N" if value >= 0 else "S")
            pixel = 0.5 * SIZE * (1.0 + here / reach)
            x, y = (pixel, SIZE + 16) if which == 0 else (-4, SIZE - pixel + 4)
            anchor = "middle" if which == 0 else "end"
            found.append(
                f'<text {RIM} x="{x:.1f}" y="{y:.1f}" font-size="12" text-anchor="{anchor}">{text}</text>'
            )
    return found
