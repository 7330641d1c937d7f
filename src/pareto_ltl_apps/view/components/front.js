// The front as a chart: failure on a logarithmic axis against length. A click or Enter selects a point.

import { ticksBetween } from "./geo.js";
import { pathOf, percent, svg } from "./shapes.js";

const REACH = 25;  // [pixels] from a click to its point
export const EDGE = { left: 66, right: 14, top: 12, bottom: 40 };

/** The title of the axis of failures, along it. */
export const failureTitle = (text, top, base) => svg("text", { x: 13, y: (top + base) / 2, "text-anchor": "middle", transform: `rotate(-90 13 ${(top + base) / 2})` }, text);

const decades = (low, high) => {
  const ticks = [], marks = Math.log10(high / low) > 2.2 ? [1] : [1, 2, 5];
  for (let power = -8; power <= 0; power++) for (const m of marks) if (m * 10 ** power >= low * 0.999 && m * 10 ** power <= high * 1.001) ticks.push(m * 10 ** power);
  return ticks;
};

const LEVELS = [0.05, 0.01];  // of the failures, whose shortest path is marked

/** Marks for whom does not know which point to take: {number: words} of the knee and of the shortest paths below some levels.
 *  The knee is the point farthest below the chord from the safest to the shortest, as of the rule selection=knee. */
export function marked(points) {
  const marks = new Map(), add = (k, text) => marks.set(k, [...marks.get(k) ?? [], text]);
  for (const level of LEVELS) {
    const below = points.map((point, k) => k).filter(k => (points[k].failure_high ?? points[k].failure) <= level);
    if (below.length && below.length < points.length) add(below.reduce((a, b) => points[b].length_m < points[a].length_m ? b : a), `${percent(level)}`);
  }
  if (points.length > 2) {
    const scaled = key => { const values = points.map(point => point[key]), low = Math.min(...values), span = Math.max(...values) - low || 1; return values.map(value => (value - low) / span); };
    const risk = scaled("failure"), length = scaled("length_m"), below = points.map((_, k) => 1 - risk[k] - length[k]);
    add(below.indexOf(Math.max(...below)), "knee");
  }
  return marks;
}

const ranged = point => point.failure_low !== null && point.failure_low !== undefined;

/** The scales of the axes: pixels of a length [km] and of a failure, and the lengths and failures at their ends. */
function scales(points, km, w, h) {
  const positive = points.flatMap(point => [point.failure, point.failure_high]).filter(p => p > 0), least = Math.min(...positive, 1);
  const floor = Math.max(1e-7, 10 ** (Math.floor(Math.log10(Math.max(least / 2, 1e-9)) * 3) / 3)), top = Math.min(1, Math.max(...points.map(p => p.failure_high ?? p.failure), floor * 4) * 1.5);
  const pad = Math.max((Math.max(...km) - Math.min(...km)) * 0.06, Math.max(...km) * 0.004), low = Math.min(...km) - pad, high = Math.max(...km) + pad;
  return {
    floor, top, low, high, x: value => EDGE.left + (value - low) / (high - low) * (w - EDGE.left - EDGE.right),
    y: p => EDGE.top + (Math.log(top) - Math.log(Math.min(top, Math.max(p, floor)))) / (Math.log(top) - Math.log(floor)) * (h - EDGE.top - EDGE.bottom),
  };
}

const MARK_WIDTH = 6.2, MARK_HEIGHT = 13;  // of a letter and of a line [px]

/** The words of marks beside their points, within the chart of width `w` and none on another. Of two levels the lower one says both. */
function markTexts(marks, w) {
  const taken = [];
  return marks.sort((a, b) => a.up - b.up).map(({ at, up, words }) => {
    const levels = words.filter(word => word !== "knee"), text = [...levels.length ? [`below ${levels.at(-1)}`] : [], ...words.filter(word => word === "knee")].join(", ");
    const wide = text.length * MARK_WIDTH, left = at + 9 + wide > w, begin = left ? at - 9 - wide : at + 9;
    let y = up - 8;
    for (const other of taken) if (begin < other.end && other.begin < begin + wide && Math.abs(y - other.y) < MARK_HEIGHT) y = other.y + MARK_HEIGHT;
    taken.push({ begin, end: begin + wide, y });
    return svg("text", { class: "mark", x: left ? at - 9 : at + 9, y, "text-anchor": left ? "end" : "start" }, text);
  });
}

/** Draw `points` ({failure, failure_low, failure_high, length_m}); `choose(number)` is called for a chosen one.
 *  `text(number)` is the description of a point; points for which `hollow(number)` is true are empty circles.
 *  Arrow keys lead from one point to the next; the Tab key stops once. */
export function drawFront(root, points, { shown, chosen, choose, pinned = [], text = null, hollow = () => false }) {
  const w = root.clientWidth || 360, h = root.clientHeight || 240, km = points.map(point => point.length_m / 1000);
  root.setAttribute("viewBox", `0 0 ${w} ${h}`);
  const { floor, top, low, high, x, y } = scales([...points, ...pinned], [...km, ...pinned.map(one => one.length_m / 1000)], w, h), base = h - EDGE.bottom, parts = [];
  const zero = points.some(point => !(point.failure > 0)) ? [svg("text", { x: EDGE.left - 6, y: base + 4, "text-anchor": "end" }, "0")] : [];
  for (const tick of decades(floor, top)) {
    if (zero.length && y(tick) > base - 14) continue;
    parts.push(svg("path", { class: "grid", d: pathOf([[EDGE.left, y(tick)], [w - EDGE.right, y(tick)]]) }), svg("text", { x: EDGE.left - 6, y: y(tick) + 4, "text-anchor": "end" }, percent(tick)));
  }
  for (const tick of ticksBetween(low, high, w / 90)) parts.push(svg("path", { class: "grid", d: pathOf([[x(tick), EDGE.top], [x(tick), base]]) }), svg("text", { x: x(tick), y: base + 16, "text-anchor": "middle" }, tick.toLocaleString("en")));
  parts.push(...zero, failureTitle("flights that fail", EDGE.top, base), svg("path", { class: "axis", d: pathOf([[EDGE.left, EDGE.top], [EDGE.left, base], [w - EDGE.right, base]]) }), svg("text", { x: (EDGE.left + w) / 2, y: h - 6, "text-anchor": "middle" }, "length [km]"));
  points.forEach((point, k) => { if (ranged(point)) parts.push(svg("path", { class: "range", d: pathOf([[x(km[k]), y(point.failure_low)], [x(km[k]), y(point.failure_high)]]) })); });
  const named = marked(points), reach = shown ?? chosen ?? 0, pick = k => { choose(k); root.querySelector(`[data-point="${k}"]`)?.focus(); };
  const keys = (event, k) => {
    const to = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1 }[event.key], order = points.map((_, n) => n).sort((a, b) => points[a].length_m - points[b].length_m), next = to ? order[order.indexOf(k) + to] : event.key === "Enter" || event.key === " " ? k : undefined;
    if (to || next !== undefined) event.preventDefault();
    if (next !== undefined) pick(next);
  };
  points.forEach((point, k) => {
    const marks = ["point", k === shown && "shown", k === chosen && "chosen", hollow(k) && "hollow"].filter(Boolean).join(" "), name = text?.(k) ?? `point ${k}: fails ${percent(point.failure)}, ${km[k].toFixed(1)} km`;
    parts.push(svg("g", { class: marks, "data-point": k, tabindex: k === reach ? 0 : -1, role: "button", "aria-label": name, "aria-pressed": String(k === shown), onkeydown: event => keys(event, k) },
      svg("circle", { cx: x(km[k]), cy: y(point.failure), r: k === shown ? 7 : 4.5 }), svg("title", {}, name)));
  });
  parts.push(...markTexts([...named].map(([k, words]) => ({ at: x(km[k]), up: y(points[k].failure), words })), w));
  for (const one of pinned) parts.push(svg("circle", { class: "pinned", cx: x(one.length_m / 1000), cy: y(one.failure), r: 9 }, svg("title", {}, "kept for comparison")));
  root.onclick = event => {  // the nearest point: marks can overlap
    const box = root.getBoundingClientRect(), [px, py] = [event.clientX - box.left, event.clientY - box.top], away = points.map((point, k) => Math.hypot(x(km[k]) - px, y(point.failure) - py));
    const nearest = away.indexOf(Math.min(...away));
    if (away[nearest] < REACH) choose(nearest);
  };
  root.replaceChildren(...parts);
}
