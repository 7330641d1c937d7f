// Questions beside a plan: when to leave (a heat map of starts), what a beacon would buy, the wind before a plan.

import { ask, follow } from "./api.js";
import { localText } from "./clock.js";
import { lengthText } from "./geo.js";
import { byId, html, percent, svg } from "./shapes.js";
import { WindLayer } from "./wind.js";

const EDGE = { left: 58, right: 6, top: 6, bottom: 34 };  // of the heat map [pixels]
const HALF_HOUR = 1800e3;  // [ms] between two positions of the slider of departures
const utcText = time => `${time.slice(0, 10)} ${time.slice(11, 16)} UTC`, bothTexts = time => `${utcText(time)}${localText(time)}`;

export class Studies {
  /** `departs(time)` takes a departure; `request(command)` is the body of a plan. */
  constructor({ redraw, failed, departs, request, id }) {
    Object.assign(this, { redraw, failed, departs, request, id, beacons: null, before: new WindLayer(), time: 0, working: null, shownId: null });
    const on = (name, kind, act) => byId(name).addEventListener(kind, event => { Promise.resolve(act.call(this, event)).catch(failed); });
    on("find-beacon", "click", this.findBeacon);
    on("show-check", "click", this.showCheck);
    on("show-wind", "click", this.showWind);
    on("leave", "input", event => this.moveTo(+event.target.value));
    on("leave", "change", event => departs(new Date(+event.target.value).toISOString().slice(0, 16)));
  }

  /** Forget what belongs to a plan. */
  reset() {
    this.working?.abort();
    Object.assign(this, { beacons: null });
    byId("beacon-said").replaceChildren();
    byId("check-said").replaceChildren();
    byId("starts").replaceChildren();
    byId("starts-said").textContent = "";
  }

  /** Run a job and show its progress in `place`; its last state, or null if another began since. */
  async run(path, body, place) {
    this.working?.abort();
    const ends = this.working = new AbortController();
    place.replaceChildren("Working…");
    try {
      const state = await ask("POST", path, body);
      await follow(state.id, event => { if (event.event === "progress") place.replaceChildren(`Working… ${event.state}`); }, ends.signal);
      const last = await ask("GET", `/api/plans/${state.id}`);
      if (last.status !== "done") throw new Error(last.error || "cancelled");
      place.replaceChildren();
      return ends.signal.aborted ? null : last;
    } catch (error) {
      place.replaceChildren();
      if (error.name === "AbortError" || ends.signal.aborted) return null;
      throw error;
    }
  }

  // --- a beacon -----------------------------------------------------------------------------------

  async findBeacon() {
    const id = this.id(), state = await this.run(`/api/plans/${id}/beacons`, {}, byId("beacon-said"));
    if (!state || id !== this.id()) return;
    this.beacons = await ask("GET", `/api/plans/${id}/beacons`);
    byId("beacon-said").replaceChildren(...this.beacons.said.map(line => html("p", { class: "note" }, line)), html("p", { class: "note" }, "On the map: the larger a dot, the fewer flights fail with a beacon there. Draw a landmark there and plan again to use it fully."));
    this.redraw();
  }

  beaconShapes(map) {
    if (!this.beacons?.at) return [];
    const { at, failure } = this.beacons, least = Math.min(...failure), most = Math.max(...failure), best = failure.indexOf(least);
    return at.map((place, n) => {
      const [cx, cy] = map.at(place);
      return svg("circle", { class: n === best ? "beacon best" : "beacon", cx, cy, r: 2 + 6 * (most - failure[n]) / Math.max(most - least, 1e-9) }, svg("title", {}, `beacon here: ${percent(failure[n])} fail`));
    });
  }

  // --- go or wait ---------------------------------------------------------------------------------

  async showCheck() {
    const id = this.id(), { go, wind, said } = await ask("GET", `/api/plans/${id}/check`);
    if (id !== this.id()) return;
    const lines = said.slice(go === null ? 0 : 1).map(line => html("p", { class: "note" }, line));
    const title = go === null ? [] : [html("p", {}, html("strong", {}, go ? "GO" : "NO-GO"), ` in ${wind}`)];
    byId("check-said").replaceChildren(...title, ...lines);
  }

  // --- the wind before a plan ---------------------------------------------------------------------

  async showWind() {
    const state = await this.run("/api/plans", this.request("wind"), byId("leave-said"));
    if (!state) return;
    const view = await ask("GET", `/api/plans/${state.id}/wind`), slider = byId("leave"), dated = Boolean(view.utc);
    Object.assign(this, { before: new WindLayer(view), shownId: state.id });
    byId("leave-part").hidden = !dated;
    document.querySelector("main").classList.add("planned");  // the map stays in sight of the slider
    if (dated) {
      const [first, last] = [Date.parse(view.utc[0]), Date.parse(view.utc.at(-1))];
      Object.assign(slider, { min: first, max: Math.max(last, first + HALF_HOUR), step: HALF_HOUR });
      slider.value = this.departure ? Date.parse(`${this.departure}Z`) : first;
      this.moveTo(+slider.value);
    }
    this.redraw();
  }

  /** The age of the forecast at a departure, in words; nothing if it is not known. */
  age(time) {
    const { issued } = this.before.view, hours = (time - Date.parse(issued)) / (2 * HALF_HOUR);
    return issued && hours >= 0 ? `; forecast of ${utcText(issued)}, then ${hours.toFixed(0)} h old` : "";
  }

  moveTo(time) {
    this.time = (time - Date.parse(this.before.view.utc[0])) / 1000;
    const text = bothTexts(new Date(time).toISOString());
    byId("leave-said").textContent = `Leaves ${text}${this.before.view.level ? `; wind at ${this.before.view.level}` : ""}${this.age(time)}. ${this.before.legend.replace(/^up/, "Up")}`;
    byId("leave").setAttribute("aria-valuetext", text);
    this.redraw();
  }

  // --- when to leave ------------------------------------------------------------------------------

  /** Show the starts of a study: columns are departures, rows lengths, colours failures. */
  showStarts(found) {
    const { starts, lengths_m: lengths } = found, root = byId("starts"), w = 360, h = 190, dx = (w - EDGE.left - EDGE.right) / starts.length, dy = (h - EDGE.top - EDGE.bottom) / lengths.length;
    const cells = starts.flatMap(one => (one.failure_at ?? []).map(cell => cell?.failure)).filter(value => value > 0), low = Math.log(Math.min(...cells)), high = Math.log(Math.max(...cells)), parts = [];
    starts.forEach((one, k) => {
      const column = svg("g", { class: `start-column${one.recommended ? " recommended" : ""}`, tabindex: 0, role: "button", "aria-label": `departure ${utcText(one.departure)}: ${one.verdict ?? "no plan"}`, onclick: () => this.takeStart(one), onkeydown: event => { if (event.key === "Enter") this.takeStart(one); } });
      column.append(svg("rect", { class: "column", x: EDGE.left + k * dx, y: EDGE.top, width: dx, height: dy * lengths.length }));
      (one.failure_at ?? []).forEach((cell, row) => {
        if (!cell || cell.failure === null) return;
        const share = (Math.log(Math.max(cell.failure, Math.exp(low))) - low) / Math.max(high - low, 1e-9);
        column.append(svg("rect", { class: "cell", "fill-opacity": (0.08 + 0.92 * share).toFixed(3), x: EDGE.left + k * dx, y: EDGE.top + (lengths.length - 1 - row) * dy, width: dx, height: dy }, svg("title", {}, `${utcText(one.departure)}, ${(lengths[row] / 1000).toFixed(0)} km: ${percent(cell.failure)} fail`)));
      });
      if (!one.failure_at?.some(cell => cell?.failure !== null)) column.append(svg("text", { x: EDGE.left + (k + 0.5) * dx, y: EDGE.top + dy * lengths.length / 2, "text-anchor": "middle" }, "no plan"));
      parts.push(column);
      if (k % Math.ceil(starts.length / 6) === 0) parts.push(svg("text", { x: EDGE.left + (k + 0.5) * dx, y: h - 18, "text-anchor": "middle" }, one.departure.slice(11, 16)), svg("text", { x: EDGE.left + (k + 0.5) * dx, y: h - 4, "text-anchor": "middle" }, one.departure.slice(5, 10)));
    });
    const frame = starts.findIndex(one => one.recommended);
    if (frame >= 0) parts.push(svg("rect", { class: "frame", x: EDGE.left + frame * dx, y: EDGE.top, width: dx, height: dy * lengths.length }));
    for (const row of [0, lengths.length - 1]) parts.push(svg("text", { x: EDGE.left - 5, y: EDGE.top + (lengths.length - 0.5 - row) * dy + 4, "text-anchor": "end" }, lengthText(1000 * Math.round(lengths[row] / 1000))));
    root.replaceChildren(svg("svg", { viewBox: `0 0 ${w} ${h}`, class: "heat", role: "group", "aria-label": "failure for each departure and length" }, ...parts),
      html("p", { class: "note" }, `The stronger the colour, the more flights fail: ${percent(Math.exp(low))} to ${percent(Math.exp(high))}. The frame marks the recommended start. Click a column to take its departure.`));
    const best = starts.find(one => one.recommended);
    if (best) this.tellStart(best);
  }

  tellStart(one) { byId("starts-said").textContent = `${utcText(one.departure)}: ${one.verdict ?? one.reason ?? "no plan"}.`; }

  takeStart(one) { this.tellStart(one); this.departs(one.departure.slice(0, 16)); }
}
