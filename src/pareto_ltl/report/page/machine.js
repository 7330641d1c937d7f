// The automaton of the mission: its drawing, and the current state of the expected path.

const SVG = "http://www.w3.org/2000/svg";
const STATE_COLOURS = { goal: COLOURS.flight, lost: "#8a8a8a", open: COLOURS.ink };

const inSvg = (tag, attributes, text = null) => element(tag, attributes, text, SVG);

function drawMachine() {
  const machine = PAGE.automaton;
  if (!machine) { byId("machine").closest("section").remove(); return; }
  if (!machine.shapes) {
    byId("machine").append(element("p", { class: "note" }, `The automaton has ${machine.states} states, too many to draw.`));
    return;
  }
  const { width, height, states, edges, entry, radius } = machine.shapes;
  const svg = inSvg("svg", { width, height, viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": `automaton of the mission with ${machine.states} states` });
  svg.append(arrowHead());
  for (const edge of edges) svg.append(edgeShape(edge));
  svg.append(inSvg("path", { d: `M${entry[0] - radius - 32} ${entry[1]}H${entry[0] - radius}`, stroke: COLOURS.ink, fill: "none", "stroke-width": 1.3, "marker-end": "url(#head)" }));
  for (const edge of edges) svg.append(edgeLabel(edge));
  for (const one of states) svg.append(stateShape(one, radius));
  byId("machine").append(svg);
  svg.style.width = `${Math.min(width, Math.max(byId("machine").clientWidth, 0.72 * width))}px`;  // still readable
}

function arrowHead() {
  const defs = inSvg("defs", {}), head = inSvg("marker", { id: "head", viewBox: "0 0 10 10", refX: 9, refY: 5, markerWidth: 8, markerHeight: 8, orient: "auto-start-reverse" });
  head.append(inSvg("path", { d: "M0 1L10 5L0 9z", fill: "context-stroke" }));
  defs.append(head);
  return defs;
}

const edgeShape = edge => inSvg("path", {
  d: edge.d, fill: "none", stroke: edge.lost ? "#9a9a9a" : COLOURS.ink, "stroke-width": 1.2, "marker-end": "url(#head)", "data-edge": `${edge.start}-${edge.end}`,
});

function edgeLabel(edge) {
  const [x, y] = edge.at, text = inSvg("text", { x, y: y + 4 - 7 * (edge.lines.length - 1), "text-anchor": "middle", fill: edge.lost ? COLOURS.stone : COLOURS.ink, stroke: COLOURS.paper, "stroke-width": 7, "paint-order": "stroke" });
  edge.lines.forEach((line, k) => text.append(inSvg("tspan", { x, dy: k ? 14 : 0 }, line)));
  return text;
}

function stateShape(one, radius) {
  const [cx, cy] = one.at, group = inSvg("g", { "data-state": one.number }), colour = STATE_COLOURS[one.role];
  group.append(inSvg("circle", { cx, cy, r: radius, fill: COLOURS.paper, stroke: colour, "stroke-width": 1.6, "stroke-dasharray": one.role === "lost" ? "4 3" : "none" }));
  if (one.role === "goal") group.append(inSvg("circle", { cx, cy, r: radius - 4, fill: "none", stroke: colour, "stroke-width": 1.2 }));
  group.append(inSvg("text", { x: cx, y: cy + 4, "text-anchor": "middle", fill: colour }, one.number));
  return group;
}

/** Mark the state of the expected path at the step that is shown, and the states before it. */
function markMachine() {
  const way = path();
  if (!way) return;
  const passed = new Set([PAGE.automaton?.initial, ...way.q.slice(0, shown.step + 1)]), now = way.q[shown.step];
  for (const group of document.querySelectorAll("#machine [data-state]")) {
    const number = +group.dataset.state, circle = group.querySelector("circle");
    circle.setAttribute("fill", number === now ? COLOURS.mark : passed.has(number) ? (DARK ? "#5a4a1e" : "#fbe8c1") : COLOURS.paper);
    circle.setAttribute("stroke-width", number === now ? 3 : 1.6);
  }
  for (const line of byId("progress").children) line.classList.toggle("now", +line.dataset.first <= shown.step && shown.step < +line.dataset.end);
}

/** One line for each stretch of the expected path in one state. */
function listProgress() {
  const way = path(), list = byId("progress");
  if (!way || !PAGE.automaton) return;
  const starts = way.q.map((q, k) => k).filter(k => k === 0 || way.q[k] !== way.q[k - 1]);
  list.replaceChildren(...starts.map((first, n) => {
    const end = starts[n + 1] ?? way.q.length, role = PAGE.automaton.roles[way.q[first]];
    const where = way.label[first].length ? ` in ${way.label[first].join(", ")}` : "";
    const told = role === "goal" ? "mission complete" : role === "lost" ? "mission lost" : first ? "next goal" : "on the way";
    const line = element("li", { "data-first": first, "data-end": end });
    line.append(`${clockText(way, first)}: state ${way.q[first]}${where}, ${told}`);
    return line;
  }));
}
