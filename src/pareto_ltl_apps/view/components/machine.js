// The automaton of a mission as a drawing; states can be marked.

import { svg } from "./shapes.js";

/** Draw `shapes` {width, height, radius, states, edges, entry} into `root`. */
export function drawMachine(root, { width, height, radius, states, edges, entry }) {
  const head = svg("marker", { id: "head", viewBox: "0 0 10 10", refX: 9, refY: 5, markerWidth: 8, markerHeight: 8, orient: "auto-start-reverse" }, svg("path", { d: "M0 1L10 5L0 9z" }));
  const begin = svg("path", { class: "edge", d: `M${entry[0] - radius - 32} ${entry[1]}H${entry[0] - radius}`, "marker-end": "url(#head)" });
  const lines = edges.map(edge => svg("path", { class: edge.lost ? "edge lost" : "edge", d: edge.d, "marker-end": "url(#head)", "data-edge": `${edge.start}-${edge.end}` }));
  const drawing = svg("svg", { viewBox: `0 0 ${width} ${height}`, width, height, role: "img", "aria-label": `automaton of the mission with ${states.length} states` }, svg("defs", {}, head), ...lines, begin, ...edges.map(labelOf), ...states.map(one => stateOf(one, radius)));
  root.replaceChildren(drawing);
  drawing.style.width = `${Math.min(width, Math.max(root.clientWidth, 0.72 * width))}px`;  // still readable
}

function labelOf({ at: [x, y], lines, lost }) {
  const rows = lines.map((line, k) => svg("tspan", { x, dy: k ? 14 : 0 }, line));
  return svg("text", { class: lost ? "lost" : null, x, y: y + 4 - 7 * (lines.length - 1), "text-anchor": "middle" }, ...rows);
}

function stateOf({ number, role, at: [cx, cy] }, radius) {
  const ring = role === "goal" ? svg("circle", { class: "ring", cx, cy, r: radius - 4 }) : null;
  return svg("g", { class: `state ${role}`, "data-state": number }, svg("circle", { cx, cy, r: radius }), ring, svg("text", { x: cx, y: cy + 4, "text-anchor": "middle" }, number));
}

/** Mark the state `now`, and those before it. */
export function markMachine(root, now, passed) {
  for (const group of root.querySelectorAll("[data-state]")) {
    const number = +group.dataset.state;
    group.classList.toggle("now", number === now);
    group.classList.toggle("passed", number !== now && passed.has(number));
  }
}
