// The risk along a path: the share of simulated flights that have failed by each time, and why.

import { EDGE, failureTitle } from "./front.js";
import { ticksBetween } from "./geo.js";
import { pathOf, svg } from "./shapes.js";

const UNITS = [["hours", 3600], ["minutes", 60], ["seconds", 1]];
const ROW = 17;  // of the key [pixels]
const LETTER = 7;  // about the width of one [pixels]

/** Draw the chart of a path {t, risk}; the time of `step` is marked. */
export function drawRisk(root, { t, risk }, step, causes) {
  const w = root.clientWidth || 360, h = root.clientHeight || 240, [unit, seconds] = UNITS.find(([, length]) => t.at(-1) >= 2 * length) ?? UNITS[2];
  root.setAttribute("viewBox", `0 0 ${w} ${h}`);
  const happened = causes.map((name, k) => [name, k]).filter(([, k]) => risk.failed[k].at(-1) > 0), shares = counts => counts.map(n => n / risk.runs);
  const key = keyOf([["all failures", "total"], ...happened.map(([name, k]) => [name, `cause-${k}`])], w), above = EDGE.top + key.height;
  const end = 1.02 * (t.at(-1) || 1), top = Math.min(1, Math.max(...risk.high, 1e-9) * 1.1), base = h - EDGE.bottom;
  const x = time => EDGE.left + time / end * (w - EDGE.left - EDGE.right), y = p => base - Math.min(1, p / top) * (base - above);
  const stairs = values => values.flatMap((p, k) => k ? [[x(t[k]), y(values[k - 1])], [x(t[k]), y(p)]] : [[x(t[0]), y(p)]]);
  const total = shares(t.map((_, k) => risk.failed.reduce((sum, cause) => sum + cause[k], 0)));
  const parts = [];
  for (const tick of ticksBetween(0, 100 * top, 5)) parts.push(svg("path", { class: "grid", d: pathOf([[EDGE.left, y(tick / 100)], [w - EDGE.right, y(tick / 100)]]) }), svg("text", { x: EDGE.left - 6, y: y(tick / 100) + 4, "text-anchor": "end" }, `${tick.toLocaleString("en")} %`));
  for (const tick of ticksBetween(0, end / seconds, w / 70)) parts.push(svg("text", { x: x(tick * seconds), y: base + 16, "text-anchor": "middle" }, tick.toLocaleString("en")));
  parts.push(svg("path", { class: "band", d: pathOf([...stairs(risk.low), ...stairs(risk.high).reverse()], true) }));
  for (const [, k] of happened) parts.push(svg("path", { class: `stairs cause-${k}`, d: pathOf(stairs(shares(risk.failed[k]))) }));
  parts.push(svg("path", { class: "stairs total", d: pathOf(stairs(total)) }), svg("path", { class: "axis", d: pathOf([[EDGE.left, above], [EDGE.left, base], [w - EDGE.right, base]]) }));
  parts.push(failureTitle("flights that have failed", above, base), svg("path", { class: "now", d: pathOf([[x(t[step]), above], [x(t[step]), base]]) }), svg("text", { x: (EDGE.left + w) / 2, y: h - 6, "text-anchor": "middle" }, `${unit} after departure`), ...key.parts);
  root.replaceChildren(...parts);
}

/** Lines with their names, in as many rows as they need. */
function keyOf(entries, width) {
  const parts = [];
  let x = EDGE.left, y = 12;
  for (const [name, kind] of entries) {
    const length = 30 + LETTER * name.length;
    if (x + length > width && x > EDGE.left) { x = EDGE.left; y += ROW; }
    parts.push(svg("path", { class: `stairs ${kind}`, d: pathOf([[x, y - 4], [x + 20, y - 4]]) }), svg("text", { x: x + 25, y }, name));
    x += length + 10;
  }
  return { parts, height: y + 2 };
}
