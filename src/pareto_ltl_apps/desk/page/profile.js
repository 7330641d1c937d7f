// The wind at the pointer: speed and direction against height and against time, at a node of the wind of the map.

import { ask } from "./api.js";
import { placeText, ticksBetween } from "./geo.js";
import { byId, pathOf, svg } from "./shapes.js";
import { arrow, barb, flowOf, KT } from "./wind.js";

const EDGE = { left: 66, right: 72, top: 30, bottom: 34 };  // of the chart of heights [pixels]
const TIMES = { left: 40, right: 22, top: 34, bottom: 34 };
const ROW = 14;  // [pixels] of a line of text
const SIGN = 44;  // [pixels] between two barbs
const HOUR = 3600;  // [s]
const STEPS = [1, 2, 3, 6, 12, 24, 48];  // [h] between two times
const KEPT = "pareto_ltl.unit";  // of speeds, in the browser

export class Profile {
  /** `shown()` is the wind of the map: {id, layer, time}, or null; `map` is asked to draw the node again. */
  constructor({ map, shown, failed }) {
    Object.assign(this, { map, shown, failed, place: null, node: null, asked: null, levels: null });
    try { byId("profile-unit").value = localStorage.getItem(KEPT) || "kt"; } catch { /* it is not kept */ }
    byId("profile-unit").addEventListener("change", event => { try { localStorage.setItem(KEPT, event.target.value); } catch { /* it is not kept */ } this.draw(); });
    byId("profile-part").addEventListener("toggle", () => { if (byId("profile-part").open && !this.place) this.takeMiddle(); map.refresh(); });
    map.root.addEventListener("keydown", () => this.takeMiddle());  // after the map has moved
    new ResizeObserver(() => this.draw()).observe(byId("profile-times"));
  }

  get open() { return byId("profile-part").open && !byId("profile-part").hidden; }

  /** The speed unit: its name and its size [m/s]. */
  get unit() { const name = byId("profile-unit").value; return { name, size: name === "kt" ? KT : 1 }; }

  takeMiddle() { this.take(this.map.place(this.map.size.map(length => length / 2))); }

  /** Show the wind at a place [deg]. */
  take(place) {
    this.place = place;
    const node = this.shown()?.layer.node(place) ?? null;
    if (node !== null && node !== this.node && this.open) this.map.refresh();
  }

  /** The node whose wind is shown, on the map; the charts are drawn with it. */
  shapes(map) {
    const shown = this.shown(), found = shown && this.place ? shown.layer.node(this.place) : null;
    byId("profile-part").hidden = !shown;
    byId("profile-title").textContent = shown?.layer.water ? "Current at the pointer" : "Wind at the pointer";
    if (!shown) { this.node = null; return []; }
    if (found !== null) this.node = found;  // beside the map it stays where it was
    if (!this.open || this.node === null || !shown.layer.view.at[this.node]) return [];
    this.draw();
    const [cx, cy] = map.at(shown.layer.view.at[this.node]);
    return [svg("circle", { class: "profile-node", cx, cy, r: 5 })];
  }

  /** Ask once for the levels of the result that is shown. */
  async load(id) {
    Object.assign(this, { asked: id, levels: null });
    try {
      const found = await ask("GET", `/api/plans/${id}/levels`);
      if (this.asked === id) this.levels = found;
    } catch (error) { if (this.asked === id) this.levels = { levels: [], said: `The levels cannot be read: ${error.message}.` }; }
    this.draw();
  }

  draw() {
    const shown = this.shown();
    if (!this.open || !shown || this.node === null || !shown.layer.view.at[this.node]) return;
    if (this.asked !== shown.id) this.load(shown.id);
    const { view, water } = shown.layer, { unit } = this, k = Math.max(0, view.t.findLastIndex(one => one <= shown.time)), here = flowOf(view.uv[k][this.node]);
    const speed = value => `${(value / unit.size).toFixed(water ? 2 : 1)} ${unit.name}`, turn = flow => water ? `sets to ${flow.to.toFixed(0)}°` : `from ${flow.from.toFixed(0)}°`;
    const kind = { unit, water, south: view.at[this.node][1] < 0, speed, turn };
    const when = view.utc ? `${view.utc[k].slice(0, 10)} ${view.utc[k].slice(11, 16)} UTC` : `${(view.t[k] / HOUR).toFixed(1)} h`;
    byId("profile-said").textContent = `${placeText(view.at[this.node])}, ${when}, ${view.level}: ${speed(here.speed)} ${turn(here)}, ± ${speed(view.sd[k][this.node])} a component. Arrow keys on the map move this place.`;
    this.drawHeights(k, kind);
    this.drawTimes(view, shown.time, kind);
  }

  drawHeights(k, { unit, water, south, speed, turn }) {
    const root = byId("profile-heights"), levels = this.levels?.levels ?? [];
    byId("profile-levels").textContent = this.levels?.said ?? "Reading the levels of the file…";
    root.toggleAttribute("hidden", levels.length < 2);
    if (levels.length < 2) { root.replaceChildren(); return; }
    const w = root.clientWidth || 240, h = root.clientHeight || 176, flows = levels.map(one => flowOf(one.uv[k][this.node])), heights = levels.map(one => one.height);
    const low = Math.min(...heights), high = Math.max(...heights), top = Math.max(...flows.map(one => one.speed / unit.size), 1e-6) * 1.08;
    const x = value => EDGE.left + value / top * (w - EDGE.left - EDGE.right), y = metres => h - EDGE.bottom - (metres - low) / Math.max(high - low, 1) * (h - EDGE.top - EDGE.bottom);
    const parts = ticksBetween(0, top, Math.max(2, (w - EDGE.left - EDGE.right) / 40)).flatMap(tick => [svg("path", { class: "grid", d: pathOf([[x(tick), EDGE.top], [x(tick), h - EDGE.bottom]]) }), svg("text", { x: x(tick), y: h - EDGE.bottom + 14, "text-anchor": "middle" }, tick)]);
    parts.push(svg("path", { class: "axis", d: pathOf([[EDGE.left, EDGE.top], [EDGE.left, h - EDGE.bottom], [w - EDGE.right, h - EDGE.bottom]]) }), svg("text", { x: (EDGE.left + w - EDGE.right) / 2, y: h - 4, "text-anchor": "middle" }, `speed [${unit.name}]`));
    const spots = flows.map((flow, n) => [x(flow.speed / unit.size), y(heights[n])]);
    parts.push(svg("path", { class: "curve", d: pathOf(spots) }));
    const told = [];  // heights of texts, which do not overlap; the level of the flight comes first
    const order = levels.map((_, n) => n).sort((a, b) => levels[b].flown - levels[a].flown || b - a);
    for (const n of order) {
      const { level, flown } = levels[n], [cx, cy] = spots[n], flow = flows[n], text = `${level}${level.endsWith("hPa") ? `, about ${Math.round(heights[n])} m` : ""}: ${speed(flow.speed)} ${turn(flow)}`;
      parts.push(svg("circle", { class: flown ? "dot flown" : "dot", cx, cy, r: flown ? 5 : 3.5 }, svg("title", {}, text)));
      if (told.some(one => Math.abs(one - cy) < ROW)) continue;
      told.push(cy);
      const name = flown ? "flown" : "";
      parts.push(svg("text", { class: name, x: EDGE.left - 8, y: cy + 4, "text-anchor": "end" }, level.replace("hPa", " hPa").replace(" depth", "")), svg("text", { class: name, x: w - 2, y: cy + 4, "text-anchor": "end" }, `${(water ? flow.to : flow.from).toFixed(0)}°`), signOf(w - 48, cy, flow, { water, south }));
    }
    parts.push(svg("text", { x: w - 2, y: 12, "text-anchor": "end" }, water ? "sets to" : "from"));
    root.setAttribute("viewBox", `0 0 ${w} ${h}`);
    root.setAttribute("aria-label", levels.map((one, n) => `${one.level}${one.flown ? ", of the plan" : ""}: ${speed(flows[n].speed)} ${turn(flows[n])}`).join("; "));
    root.replaceChildren(...parts);
  }

  drawTimes(view, time, { unit, water, south, speed, turn }) {
    const root = byId("profile-times"), n = this.node, several = view.t.length > 1;
    root.toggleAttribute("hidden", !several);
    byId("profile-time-note").textContent = several ? `${water ? "Current" : "Wind"} at ${view.level} in the plan, with its standard deviation of a component.` : "It is known at one time only, and held.";
    if (!several) { root.replaceChildren(); return; }
    const w = root.clientWidth || 360, h = root.clientHeight || 176, flows = view.uv.map(one => flowOf(one[n])), speeds = flows.map(one => one.speed / unit.size), sds = view.sd.map(one => one[n] / unit.size), last = view.t.at(-1);
    const top = Math.max(...speeds.map((one, k) => one + sds[k]), 1e-6) * 1.05, x = t => TIMES.left + t / last * (w - TIMES.left - TIMES.right), y = value => h - TIMES.bottom - Math.max(0, value) / top * (h - TIMES.top - TIMES.bottom);
    const parts = ticksBetween(0, top, 4).flatMap(tick => [svg("path", { class: "grid", d: pathOf([[TIMES.left, y(tick)], [w - TIMES.right, y(tick)]]) }), svg("text", { x: TIMES.left - 6, y: y(tick) + 4, "text-anchor": "end" }, tick)]);
    parts.push(svg("path", { class: "spread", d: pathOf([...speeds.map((one, k) => [x(view.t[k]), y(one + sds[k])]), ...speeds.map((one, k) => [x(view.t[k]), y(one - sds[k])]).reverse()], true) }), svg("path", { class: "curve", d: pathOf(speeds.map((one, k) => [x(view.t[k]), y(one)])) }));
    const begin = view.utc ? Date.parse(view.utc[0]) / 1000 : 0, step = HOUR * (STEPS.find(one => last / HOUR / one <= (w - TIMES.left) / 58) ?? STEPS.at(-1));
    for (let at = Math.ceil(begin / step) * step; at <= begin + last; at += step) {
      const text = !view.utc ? `${(at / HOUR).toFixed(0)} h` : at % (24 * HOUR) ? new Date(at * 1000).toISOString().slice(11, 16) : new Date(at * 1000).toISOString().slice(5, 10);
      parts.push(svg("text", { x: x(at - begin), y: h - TIMES.bottom + 14, "text-anchor": "middle" }, text));
    }
    const stride = Math.max(1, Math.ceil(view.t.length * SIGN / (w - TIMES.left - TIMES.right)));
    flows.forEach((flow, k) => { if (k % stride === 0) parts.push(signOf(x(view.t[k]), 18, flow, { water, south })); });
    parts.push(svg("path", { class: "axis", d: pathOf([[TIMES.left, TIMES.top], [TIMES.left, h - TIMES.bottom], [w - TIMES.right, h - TIMES.bottom]]) }), svg("path", { class: "now", d: pathOf([[x(Math.max(0, Math.min(last, time))), TIMES.top], [x(Math.max(0, Math.min(last, time))), h - TIMES.bottom]]) }), svg("text", { x: 0, y: TIMES.top - 6 }, unit.name), svg("text", { x: (TIMES.left + w) / 2, y: h - 4, "text-anchor": "middle" }, view.utc ? "time (UTC)" : "hours after the first time"));
    root.setAttribute("viewBox", `0 0 ${w} ${h}`);
    root.setAttribute("aria-label", flows.filter((_, k) => k % stride === 0).map((flow, k) => `${view.utc ? view.utc[k * stride].slice(11, 16) : `${(view.t[k * stride] / HOUR).toFixed(1)} h`}: ${speed(flow.speed)} ${turn(flow)}`).join("; "));
    root.replaceChildren(...parts);
  }
}

/** A barb, or for a current an arrow, at pixels x, y. */
function signOf(x, y, { speed, to }, { water, south }) {
  const size = 0.6, [u, v] = [Math.sin(to * Math.PI / 180), -Math.cos(to * Math.PI / 180)];
  if (water || speed < KT * 2.5) return svg("path", { class: "barb", d: arrow(x, y, 20 * u, 20 * v) });
  return svg("g", { transform: `translate(${x.toFixed(1)} ${y.toFixed(1)}) scale(.7)` }, svg("path", { class: "barb", d: barb(13 * u * size, 13 * v * size, u, v, speed, 1, south ? -1 : 1) }));
}
