// Drawing on the map: tools for each role, corners that can be dragged, and the features as shapes.

import { crossesItself, distance, lengthText, metresOf } from "./geo.js";
import { nameSpot } from "./flight.js";
import { byId, html, svg } from "./shapes.js";
import { outline, ROLES } from "./store.js";

const LETTER = 7;  // about the width of one in a name [pixels]
const TOOLS = [
  { name: "select", label: "Select", hint: "" },
  { name: "start", label: "Start", role: "start", shape: "point", hint: "Click where the flight starts." },
  { name: "region", label: "Region", role: "region", shape: "polygon", hint: "Click the corners of the region; click the first corner again to close it." },
  { name: "region-circle", label: "Round region", role: "region", shape: "circle", hint: "Click the centre of the region, then its edge." },
  { name: "obstacle", label: "Obstacle", role: "obstacle", shape: "polygon", hint: "Click the corners of the obstacle; click the first corner again to close it." },
  { name: "obstacle-circle", label: "Round obstacle", role: "obstacle", shape: "circle", hint: "Click the centre of the obstacle, then its edge." },
  { name: "line", label: "Line", role: "obstacle", shape: "line", hint: "Click along a power line, a cable or a road; click its last corner again, or press Enter, to end it. Its width is set beside the map." },
  { name: "landmark", label: "Landmark", role: "landmark", shape: "polygon", hint: "Click the corners of the area in which the vehicle measures its position." },
  { name: "border", label: "Border", role: "border", shape: "box", hint: "Click two opposite corners of the area that is planned in." },
  { name: "measure", label: "Measure", role: "measure", shape: "measure", hint: "Click along what you measure; Escape ends." },
];
const WIDTH = "200 m";  // from a new line to either side
export const BEGIN = "Begin here: press Start and click on the map, then draw a region; or open an example or a file.";
const NEAR = 12;  // [pixels] from the first corner that close an outline

export class Drawing {
  /** `told(text)` shows a hint. */
  constructor(map, store, told) {
    Object.assign(this, { map, store, told, tool: TOOLS[0], points: [], pointer: null, chosen: null, corner: null });
    for (const tool of TOOLS) byId("tools").append(html("button", { type: "button", "data-tool": tool.name, "aria-pressed": false, onclick: () => this.take(tool.name) }, ...tool.role && tool.role !== "measure" ? [html("span", { class: `sign ${tool.role} ${tool.shape === "line" ? "line" : tool.shape === "circle" ? "round" : ""}`, "aria-hidden": "true" })] : [], tool.label));
    byId("tools").append(html("button", { type: "button", id: "undo", title: "Ctrl+Z", onclick: () => { this.stop(); store.undo(); } }, "Undo"), html("button", { type: "button", id: "redo", title: "Ctrl+Y", onclick: () => { this.stop(); store.redo(); } }, "Redo"));
    document.addEventListener("keydown", event => this.key(event));
    this.take("select");
  }

  take(name) {
    this.tool = TOOLS.find(tool => tool.name === name);
    this.points = [];
    if (this.tool.role) this.chosen = null;
    for (const button of byId("tools").querySelectorAll("[data-tool]")) button.setAttribute("aria-pressed", button.dataset.tool === name);
    byId("map").classList.toggle("drawing", Boolean(this.tool.role));
    this.store.changed();
  }

  /** What to do with the tool that is taken; where to begin on an empty map. */
  hint() { if (!this.points.length) this.told(this.tool.hint || (this.store.mission.features.length ? "" : BEGIN)); }

  stop() { this.points = []; this.chosen = this.corner = null; this.take("select"); }

  choose(number) { this.chosen = number; this.corner = null; this.store.changed(); }

  key(event) {
    if (event.target.closest?.("input, select, textarea")) return;
    const control = event.ctrlKey || event.metaKey, key = event.key.toLowerCase();
    if (control && key === "z") { event.preventDefault(); this.stop(); this.store[event.shiftKey ? "redo" : "undo"](); }
    else if (control && key === "y") { event.preventDefault(); this.stop(); this.store.redo(); }
    else if (event.key === "Escape") this.stop();
    else if (event.key === "Enter" && this.points.length) this.close();
    else if ((event.key === "Backspace" || event.key === "Delete") && this.points.length) { this.points.pop(); this.map.refresh(); }
    else if ((event.key === "Backspace" || event.key === "Delete") && this.chosen !== null) this.erase();
  }

  /** Remove the corner that was pressed last, or the whole feature. */
  erase() {
    const one = this.store.mission.features[this.chosen], corner = this.corner;
    if (!one) return;
    if (corner !== null && one.shape === "polygon" && one.points.length > 3) {
      this.store.change(mission => mission.features[this.chosen].points.splice(corner, 1));
      this.corner = null;
    } else { const number = this.chosen; this.chosen = null; this.store.remove(number); }
  }

  // --- the pointer ----------------------------------------------------------------------------------

  /** What a press holds: a corner, a middle between corners, or a chosen feature; null to move the map. */
  press(place, target) {
    if (this.tool.role) return null;
    const data = target.dataset ?? {};
    if (data.corner !== undefined) { this.corner = +data.corner; return { kind: "corner", index: +data.corner, begun: false }; }
    if (data.middle !== undefined) return { kind: "middle", index: +data.middle, begun: false };
    if (data.feature !== undefined && +data.feature === this.chosen) return { kind: "whole", begun: false };
    return null;
  }

  drag(held, place, before) {
    const number = this.chosen, act = mission => {
      const one = mission.features[number];
      if (held.kind === "middle") { one.points.splice(held.index + 1, 0, place); held.kind = "corner"; held.index += 1; this.corner = held.index; }
      else if (held.kind === "corner" && one.shape === "circle" && held.index === 1) one.buffer = radiusText(distance(one.points[0], place));
      else if (held.kind === "corner") one.points[held.index] = place;
      else one.points = one.points.map(([lon, lat]) => [lon + place[0] - before[0], lat + place[1] - before[1]]);
    };
    held.begun ? this.store.adjust(act) : this.store.change(act);
    held.begun = true;
  }

  move(place) {
    this.pointer = place;
    if (this.points.length) this.map.refresh();
  }

  click(place, target) {
    const { shape, role } = this.tool;
    if (!role) { this.choose(target.dataset?.feature === undefined ? null : +target.dataset.feature); return; }
    if (shape === "point") { this.finish("circle", [place]); return; }
    const [first] = this.points, near = first && Math.hypot(...this.map.at(first).map((a, k) => a - this.map.at(place)[k])) < NEAR;
    if (shape === "polygon" && near && this.points.length >= 3) { this.close(); return; }
    const last = this.points.at(-1);
    if (last && Math.hypot(...this.map.at(last).map((a, k) => a - this.map.at(place)[k])) < 3) { if (shape === "polygon" || shape === "line") this.close(); return; }  // a double click
    this.points.push(place);
    if ((shape === "circle" || shape === "box") && this.points.length === 2) this.close();
    this.map.refresh();
  }

  close() {
    const { shape } = this.tool, points = this.points;
    if (shape === "polygon" && points.length >= 3) {
      if (crossesItself(points)) { this.told("The outline crosses itself: move back with Backspace, or Escape to begin again."); return; }
      this.finish("polygon", points);
    } else if (shape === "line" && points.length >= 2) this.finish("line", points, WIDTH);
    else if (shape === "circle" && points.length === 2) this.finish("circle", [points[0]], radiusText(distance(...points)));
    else if (shape === "box" && points.length === 2) {
      const [[a, b], [c, d]] = points;
      this.finish("polygon", [[Math.min(a, c), Math.min(b, d)], [Math.max(a, c), Math.min(b, d)], [Math.max(a, c), Math.max(b, d)], [Math.min(a, c), Math.max(b, d)]]);
    }
  }

  finish(shape, points, radius = "") {
    const number = this.store.add(this.tool.role, shape, points.map(place => place.map(value => +value.toFixed(6))), radius);
    this.take("select");
    this.choose(number);
  }

  // --- shapes ---------------------------------------------------------------------------------------

  /** All features; names stand away from a `path` of places. */
  shapes(map, path = []) {
    const line = path.map(place => map.at(place)), features = this.store.mission.features, order = ["border", "landmark", "region", "obstacle", "start"];
    const drawn = features.map((one, number) => ({ one, number })).sort((a, b) => order.indexOf(a.one.role) - order.indexOf(b.one.role));
    return [...drawn.map(({ one, number }) => shapeOf(map, one, number, number === this.chosen)), ...drawn.map(({ one }) => labelOf(map, one, line)).filter(Boolean), ...this.handles(map), ...this.draft(map)];
  }

  handles(map) {
    const one = this.store.mission.features[this.chosen];
    if (!one || this.tool.role) return [];
    const points = one.shape === "circle" && one.role !== "start" ? [one.points[0], outline(one)[12]] : one.points, found = [];
    if (one.shape === "polygon") points.forEach((place, k) => {
      const [a, b] = [map.at(place), map.at(points[(k + 1) % points.length])];
      found.push(svg("circle", { class: "handle middle", "data-middle": k, cx: (a[0] + b[0]) / 2, cy: (a[1] + b[1]) / 2, r: 5 }));
    });
    points.forEach((place, k) => { const [cx, cy] = map.at(place); found.push(svg("circle", { class: "handle", "data-corner": k, cx, cy, r: 8 })); });
    return found;
  }

  draft(map) {
    if (!this.points.length) return [];
    const { shape, role } = this.tool, way = this.pointer ? [...this.points, this.pointer] : this.points, found = [];
    if (shape === "circle" && this.pointer) {
      found.push(svg("path", { class: `feature ${role} draft`, d: map.line(outline({ shape: "circle", points: this.points, buffer: `${distance(this.points[0], this.pointer)} m` }), true) }));
      this.told(`Radius ${lengthText(distance(this.points[0], this.pointer))}: click to set it.`);
    } else if (shape === "box" && this.pointer) {
      const [[a, b], [c, d]] = [this.points[0], this.pointer];
      found.push(svg("path", { class: `feature ${role} draft`, d: map.line([[a, b], [c, b], [c, d], [a, d]], true) }));
    } else if (shape === "measure") {
      const total = way.slice(1).reduce((sum, place, k) => sum + distance(way[k], place), 0);
      found.push(svg("path", { class: "measure", d: map.line(way) }));
      this.told(`${lengthText(total)} (${(total / 1852).toFixed(1)} nmi). Click on, or press Escape to end.`);
    } else found.push(svg("path", { class: `feature ${role} draft${shape === "line" ? " line" : ""}`, d: map.line(way, shape !== "line" && way.length > 2) }));
    this.points.forEach((place, k) => { const [cx, cy] = map.at(place); found.push(svg("circle", { class: "handle", cx, cy, r: k ? 4 : 7 })); });
    return found;
  }
}

/** A radius of about three digits. */
function radiusText(metres) { return metres >= 2000 ? `${+(metres / 1000).toPrecision(3)} km` : `${Math.max(1, Math.round(metres))} m`; }

function shapeOf(map, one, number, chosen) {
  const data = { "data-feature": number, class: `feature ${one.role}${chosen ? " chosen" : ""}` };
  if (one.role === "start") {
    const [cx, cy] = map.at(one.points[0]);
    return svg("circle", { ...data, cx, cy, r: 7 });
  }
  if (one.shape === "line") return svg("path", { ...data, class: `${data.class} line`, d: map.line(one.points) });
  return svg("path", { ...data, d: map.line(outline(one), true) });
}

/** The name of a feature, away from the path `line` [pixels]. */
function labelOf(map, one, line) {
  const text = one.role === "start" ? "start" : one.title;
  if (!text || one.role === "border") return null;
  if (one.role === "obstacle" || one.role === "landmark") {  // named where the name has room
    const across = outline(one).map(place => map.at(place)[0]);
    if (Math.max(...across) - Math.min(...across) < LETTER * text.length) return null;
  }
  const [x, y] = one.role === "start" ? map.at(one.points[0]) : nameSpot(outline(one).map(place => map.at(place)), line);
  return svg("text", { class: `label ${one.role}`, x, y: one.role === "start" ? y - 12 : y + 5, "text-anchor": "middle" }, text);
}

/** What a feature is called in the list. */
export function titleOf(one, number) {
  if (one.role === "region") return one.title === one.name ? one.name : `${one.title} (${one.name})`;
  return one.title || (ROLES[one.role].one ? ROLES[one.role].label : `${ROLES[one.role].label} ${number}`);
}

export { metresOf };
