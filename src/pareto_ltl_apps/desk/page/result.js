// A plan while it is made and after: progress, front, path with ellipses, wind, what limits it, files, a fix.

import { ask, download, follow } from "./api.js";
import { branchNote, branchShapes } from "./branches.js";
import { localText } from "./clock.js";
import { ellipse, ellipses, flown, stepLines, track, vehicle } from "./flight.js";
import { drawFront } from "./front.js";
import { lengthText, placeText } from "./geo.js";
import { Player } from "./player.js";
import { drawRisk } from "./risk.js";
import { byId, duration, flightsText, html, percent, svg } from "./shapes.js";
import { WindLayer } from "./wind.js";

const STAGES = {
  readings: "Reading the wind", scene: "Reading the map", decomposition: "Dividing the map", automaton: "Reading the mission", observations: "Reading the wind", wind: "Fitting the wind",
  problem: "Preparing the search", forest: "Searching for paths", front: "Improving the paths", plan: "Checking the plan with new flights", forecasts: "Checking the plan with new flights",
  deployment: "Flying the plan", departure: "Comparing departures", export: "Writing files", report: "Drawing figures", page: "Writing the report",
};
const FORMATS = {  // what a button says, and for whom its file is
  dead_reckoning: ["Dead reckoning (CSV)", "headings, airspeeds and times of each leg: spreadsheets, a script of an autopilot"], card: ["Flight card (CSV)", "the same, rounded to what a pilot holds"],
  qgc: ["QGroundControl plan", "waypoints and geofence: QGroundControl, PX4, ArduPilot"], mavlink: ["MAVLink script", "headings and airspeeds with their times: pymavlink"], lua: ["ArduPlane script (Lua)", "flies the table by the clock: ArduPlane 4.6 or later"],
  kml: ["KML", "Google Earth, QGIS"], gpx: ["GPX", "chart plotters, OpenCPN, GPS devices"], fpl: ["Garmin FPL", "Garmin navigators, ForeFlight, SkyDemon"], geojson: ["GeoJSON", "QGIS, web maps"], corridor: ["Corridor (GeoJSON)", "areas that hold 50 to 99 % of the flights: QGIS"], f3548: ["Operational intent (JSON)", "UTM services, ASTM F3548"], netcdf: ["NetCDF", "xarray, Panoply"],
};
const EARLY = {  // where the points come from, while the plan is made
  search: count => `${count} paths of the search so far, with an upper bound on their failures. They are being improved.`,
  refinement: count => `${count} paths so far. They still change, and how often they fail is counted on few flights.`,
  front: count => `The front: ${count} paths, each judged by flights of its own.`,
};
const POINTS = "Each point is a path. Lower is safer, left is shorter; the bar is the 95 % interval. Click a point to see its path.";
const CHECKING = "The plan is being chosen and checked with new flights.";
const SLOW = 4000;  // [ms] of waiting before the page says why
const LEAST_SAVED = 0.01;  // percentage points: less is not worth a line
const SOURCES = { coherent: "winds whose error lasts for hours", independent: "winds whose error changes at every step" };

export class Result {
  /** `redraw()` draws the map again, `fit(places)` shows places, `failed(error)` shows an error. */
  constructor({ redraw, fit, failed, remember, title, studies }) {
    Object.assign(this, { redraw, fit, failed, remember, title, studies, state: null, views: new Map(), fix: null, ends: null, pinned: [], player: new Player(step => this.moveTo(step)) });
    this.reset();
    const on = (id, act) => byId(id).addEventListener("click", act);
    on("cancel", () => this.cancel().catch(failed));
    on("previous", () => this.show(this.shown - 1));
    on("next", () => this.show(this.shown + 1));
    on("choose", () => this.choose().catch(failed));
    on("show-fix", () => { if (!this.view) return; this.fix = this.fix ? null : this.view.line[this.step]; this.showFix(); });
    on("pin", () => { if (this.viewed === this.shown) this.keep(); });  // not while its path is read
    on("unpin", () => { this.pinned = []; this.showFacts(); this.drawFront(); this.redraw(); });
    on("replan", () => this.replan().catch(failed));
    for (const [kind, [label, title]] of Object.entries(FORMATS)) byId("exports").append(html("button", { type: "button", "data-kind": kind, title, onclick: event => this.take(kind, event.target) }, label));
    byId("risk-part").addEventListener("toggle", () => { if (this.view) this.moveTo(this.step); });
    new ResizeObserver(() => this.drawFront()).observe(byId("front"));
  }

  /** Forget the plan that is shown, and stop following it. */
  reset() {
    this.ends?.abort();
    this.player.stop();
    Object.assign(this, { id: null, front: null, shown: null, view: null, viewed: null, wind: new WindLayer(), early: [], looked: null, step: 0, fix: null, working: false, checking: false, picked: false });
    this.views.clear();
    this.studies.reset();
    document.querySelector("main").classList.remove("planned");
    for (const id of ["result", "progress", "timebar", "cancel"]) byId(id).hidden = true;
    byId("show-fix").disabled = true;  // until the path is shown
  }

  /** Forget a front whose plan could not be checked; its paths stay as lines on the map. */
  discard() {
    this.player.stop();
    Object.assign(this, { front: null, shown: null, view: null, viewed: null, fix: null });
    for (const id of ["result", "timebar"]) byId(id).hidden = true;
  }

  // --- while it is made -------------------------------------------------------------------------

  /** Show the plan of a state {id, status, ...}: its progress, then its result. */
  async open(state) {
    this.reset();
    const ends = this.ends = new AbortController();
    Object.assign(this, { id: state.id, studied: state.made_by === "departure", checking: true });
    this.remember(state.id);
    byId("command").textContent = state.command;
    byId("directory").textContent = state.directory;
    const made = state.status === "running";  // else it is opened again: its events are of the past
    this.setWorking(true, made);
    let last = { status: state.status, error: state.error };
    try {
      if (made) await follow(state.id, event => { if (event.event === "status") last = event; else this.hear(event); }, ends.signal);
      if (last.status === "running") last = await ask("GET", `/api/plans/${state.id}`);  // the stream was cut
      const now = made ? await ask("GET", `/api/plans/${state.id}`) : state;
      if (ends.signal.aborted) return;
      Object.assign(this, { state: now, checking: false });
      if (last.status === "done") await this.finish();
      else this.discard();
    } catch (error) {
      if (error.name === "AbortError" || ends.signal.aborted) return;
      this.failed(error);
    }
    if (ends.signal.aborted) return;
    this.setWorking(false);
    if (last.status === "cancelled") { this.say("Cancelled.", 0); byId("progress").hidden = false; }
    this.loadAll();
    if (last.status === "failed") this.failed(new Error(last.error || "the plan failed"));
    this.redraw();
  }

  /** `made`: the plan is being made, and can be cancelled; else its result is read. */
  setWorking(working, made = working) {
    this.working = working;
    byId("cancel").hidden = !made;
    byId("plan").disabled = working;
    byId("progress").hidden = !working;
    if (!working) return;
    if (!made) { this.say("Opening the result…"); return; }
    const text = "Waiting for the planner…", { id } = this;
    this.say(text);
    setTimeout(() => { if (this.id === id && byId("state").textContent === text) this.say(`${text} It loads its compiled code, which is made in some minutes the first time on a machine; or it still makes another plan.`); }, SLOW);
  }

  say(text, share = undefined) {
    byId("state").textContent = text;
    if (share === undefined) byId("bar").removeAttribute("value"); else byId("bar").value = share;
  }

  hear(event) {
    if (event.event === "stage") { this.stage = STAGES[event.stage] ?? event.stage; this.say(`${this.stage}…`); }
    else if (event.event === "progress") this.say(`${this.stage}… ${event.state.split(",")[0]}`, event.total ? event.done / event.total : undefined);
    else if (event.event === "paths" && event.points.length && !this.studied) {
      const first = !this.early.length;
      Object.assign(this, { early: event.points, looked: null });
      byId("result").hidden = false;
      byId("result").classList.add("early");
      byId("front-note").textContent = EARLY[event.source](event.points.length);
      if (first) byId("plan-title").scrollIntoView();
      this.drawFront();
      this.redraw();
      if (event.source === "front") this.takeFront().catch(() => {});  // it is asked for again when the plan is done
    }
  }

  async cancel() { if (this.id) await ask("DELETE", `/api/plans/${this.id}`); }

  // --- the result ---------------------------------------------------------------------------------

  async finish() {
    if (this.studied) { this.studies.showStarts(await ask("GET", `/api/plans/${this.id}/departures`)); byId("starts-part").open = true; return; }
    this.views.clear();  // the plan has more than it had while it was checked
    await this.takeFront();
  }

  /** Show the front: as soon as it is made, and again with the plan. */
  async takeFront() {
    const { id, ends } = this, [front, wind] = await Promise.all([ask("GET", `/api/plans/${id}/front`), ask("GET", `/api/plans/${id}/wind`)]);
    if (id !== this.id || ends.signal.aborted) return;
    if (!front.points.length) return this.showAlarm(front);
    const again = this.front !== null, { picked } = this;
    if (again && front.chosen === null && this.front.chosen !== null) return;  // this answer is the older one
    Object.assign(this, { front, wind: new WindLayer(wind) });
    byId("result").hidden = false;
    byId("result").classList.remove("early");
    document.querySelector("main").classList.add("planned");
    if (!again) byId("plan-title").scrollIntoView();
    await this.show(picked ? this.shown : front.chosen ?? Math.floor(front.points.length / 2), !again, picked);
  }

  /** Show the path of a plan that was made after an alarm; it has no front and no rates. */
  showAlarm({ planned, alarms }) {
    Object.assign(this, { early: planned.length ? [{ line: planned }] : [], looked: 0 });
    if (planned.length) this.fit(planned);
    throw new Error(alarms.length ? `No failure rate is promised: ${alarms.join("; ")}. The path is shown without one.` : "The result has no front.");
  }

  /** Load all points one after another, so that a click shows its path at once. */
  async loadAll() {
    const { id, front } = this;
    for (let k = 0; k < (front?.points.length ?? 0) && id === this.id; k++) await this.load(k).catch(() => this.views.delete(k));
  }

  async load(number) {
    const id = this.id;
    if (!this.views.has(number)) this.views.set(number, ask("GET", `/api/plans/${id}/points/${number}`));
    return this.views.get(number);
  }

  /** Show a point: its path, its numbers, what limits it. */
  async show(number, fitted = false, picked = true) {
    if (!this.front || number < 0 || number >= this.front.points.length) return;
    this.player.stop();
    Object.assign(this, { shown: number, picked });
    let view;
    try { view = await this.load(number); } catch (error) { this.views.delete(number); if (!this.checking) this.failed(error); return; }
    if (this.shown !== number) return;  // another was chosen since
    Object.assign(this, { view, viewed: number, fix: null });
    byId("timebar").hidden = false;
    this.drawFront();
    this.showFacts();
    this.showLimits();
    this.player.limit(view.t.length - 1);
    this.player.go(this.player.step);
    this.showFix();
    if (fitted) this.fit(view.line);
  }

  drawFront() {
    if (byId("result").hidden) return;
    if (this.front) drawFront(byId("front"), this.front.points, { shown: this.shown, chosen: this.front.chosen, choose: k => this.show(k), pinned: this.pinned.map(one => one.row) });
    else if (this.early.length) drawFront(byId("front"), this.early, { shown: this.looked, chosen: null, choose: k => { this.looked = k; this.drawFront(); this.redraw(); } });
  }

  showFacts() {
    const { view } = this, plan = this.shown === this.front.chosen, { promise } = this.front, fresh = plan && (promise?.branched ?? promise);
    const row = { ...this.front.points[this.shown], ...fresh ? { failure: fresh.failure, failure_low: fresh.low, failure_high: fresh.high } : {} };
    const fixless = plan && promise?.branched ? `, with its branches; ${flightsText(promise.failure, promise.low, promise.high)[0].replace(" flights", "")} without a fix` : "";
    byId("point-name").textContent = `Point ${this.shown} of ${this.front.points.length - 1}${plan ? ", the plan" : ""}`;
    byId("previous").disabled = this.shown === 0;
    byId("next").disabled = this.shown === this.front.points.length - 1;
    byId("choose").hidden = plan || this.checking;
    byId("result").classList.toggle("checking", this.checking);
    const [rate, range] = row.failure_low === null ? [`≤ ${percent(row.failure)}`, "upper bound"] : row.failure < (promise?.floor ?? 0) ? [`fewer than ${flightsText(promise.floor, promise.floor, promise.floor)[0]}`, `of the simulated ones ${flightsText(row.failure, row.failure_low, row.failure_high).join(", ")}`] : flightsText(row.failure, row.failure_low, row.failure_high), order = row.order ? row.order.split(">").map(one => one.trim()).filter(one => one && one !== "-") : [];
    const facts = [["Fails", rate, `${range}${row.failure_low === null ? "" : " (95 %)"}, in ${SOURCES[this.front.law] ?? this.front.law}${fixless}`], ["Length", lengthText(row.length_m), order.length ? `order ${order.map(this.title).join(" → ")}` : ""],
      ["Duration", duration(row.duration_s), `${row.steps} steps`], ...view.utc ? [["Arrival", `${view.utc.at(-1).slice(11, 16)} UTC`, `${view.utc.at(-1).slice(0, 10)}${localText(view.utc.at(-1))}`]] : []];
    byId("facts").replaceChildren(...facts.map(([name, value, note]) => html("div", {}, html("dt", {}, name), html("dd", {}, value, html("small", {}, note)))));
    byId("trade").textContent = this.titled(this.front.trades[this.shown]);
    this.showComparison();
    byId("warnings").replaceChildren(...(this.state?.warnings ?? []).map(text => html("li", {}, text)));
    byId("front-note").textContent = [POINTS, ...this.checking ? [CHECKING] : [], ...view.tree ? [branchNote(view.tree)] : []].join(" ");
  }

  /** A sentence of the planner with the titles of regions. */
  titled(text) { return text.replace(/(?<=It turns in )[^,]+/, names => names.split(" and ").map(this.title).join(" and ")); }

  /** Keep the point that is shown, beside others that were kept, also of other plans; once more: let it go. */
  keep() {
    const { id, shown: number } = this, here = this.pinned.findIndex(one => one.id === id && one.number === number);
    if (here >= 0) this.pinned.splice(here, 1);
    else this.pinned.push({ id, number, row: this.front.points[number], view: this.view });
    this.showFacts();
    this.drawFront();
    this.redraw();
  }

  /** The numbers of the points that are kept beside the point that is shown. */
  showComparison() {
    const { pinned } = this, row = this.front.points[this.shown], place = byId("comparison"), held = pinned.some(one => one.id === this.id && one.number === this.shown);
    byId("pin").textContent = held ? "Take it out" : "Add to the comparison";
    byId("pin").setAttribute("aria-pressed", String(held));
    byId("unpin").hidden = !pinned.length;
    place.hidden = !pinned.length;
    if (!pinned.length) return;
    const range = one => one.failure_low === null ? `≤ ${percent(one.failure)}` : `${percent(one.failure)} (${percent(one.failure_low).replace(" %", "")} to ${percent(one.failure_high)})`;
    const columns = [...pinned.map((one, k) => ({ ...one, name: html("th", { class: `kept-${k % 4}` }, html("span", { class: "swatch" }), `point ${one.number}${one.id === this.id ? "" : ", other plan"}`) })), ...held ? [] : [{ row, view: this.view, name: html("th", {}, `point ${this.shown}, shown`) }]];
    const rows = [["Fails", one => range(one.row)], ["Length", one => lengthText(one.row.length_m)], ["Duration", one => duration(one.row.duration_s)], ...columns.every(one => one.view.utc) ? [["Arrival", one => one.view.utc.at(-1).slice(5, 16).replace("T", " ")]] : []];
    place.replaceChildren(html("caption", {}, `Kept for comparison: ${pinned.length}. Show another point, or another plan.`), html("thead", {}, html("tr", {}, html("td"), ...columns.map(one => one.name))), html("tbody", {}, ...rows.map(([name, text]) => html("tr", {}, html("th", {}, name), ...columns.map(one => html("td", {}, text(one)))))));
  }

  showLimits() {
    const { limits } = this.view, place = byId("limits");
    if (!limits) { place.replaceChildren(html("button", { type: "button", id: "find-limits", onclick: event => { event.target.disabled = true; this.findLimits().catch(this.failed); } }, "What limits this path")); return; }
    const rows = limits.prices.filter(row => !(parseFloat(row.saved) < LEAST_SAVED)).slice(0, 4).map(row => html("li", {}, html("strong", {}, row.limit.replace("largest airspeed", "airspeed limit").replace(/^region (\w+)/, (_, name) => `region ${this.title(name)}`)), ` ${row.change}${/\d/.test(row.time) ? ` (${row.time})` : ""}: ${row.saved} percentage points fewer`));
    place.replaceChildren(html("h3", {}, "What limits it"), html("p", { class: "note" }, `What a small change would save of the ${percent(this.front.points[this.shown].failure)} that fail:`), rows.length ? html("ul", { class: "plainlist" }, ...rows) : html("p", { class: "note" }, limits.prices.length ? `No small change of a limit saves ${LEAST_SAVED} percentage points of the failures.` : `${limits.no_prices}.`));
  }

  async findLimits() {
    const { id, viewed, view } = this;  // another point may be shown whose path is still read
    view.limits = await ask("GET", `/api/plans/${id}/points/${viewed}/limits`);
    if (view === this.view) this.showLimits();
  }

  // --- time -----------------------------------------------------------------------------------------

  /** Show a step; returns its time in words. */
  moveTo(step) {
    const { view } = this;
    this.step = step;
    if (byId("risk-part").open) drawRisk(byId("risk"), view, step, view.causes);
    this.redraw();
    return this.clock;
  }

  get clock() {
    const { view, step } = this;
    return view.utc ? `${view.utc[step].slice(0, 10)} ${view.utc[step].slice(11, 16)} UTC${localText(view.utc[step])}` : duration(view.t[step]);
  }

  // --- choose, files, fix -----------------------------------------------------------------------

  async choose() {
    await this.open(await ask("POST", `/api/plans/${this.id}/choose`, { point: this.shown }));
  }

  async take(kind, button) {
    button.disabled = true;
    const point = this.shown === this.front.chosen ? "" : `?point=${this.shown}`;
    try { await download(`/api/plans/${this.id}/exports/${kind}${point}`); } catch (error) { this.failed(error); }
    button.disabled = false;
  }

  showFix() {
    const plan = this.view !== null && this.shown === this.front?.chosen;
    byId("show-fix").textContent = this.fix ? "Remove the fix" : "Place a fix";
    byId("show-fix").disabled = !plan;
    byId("replan").disabled = !this.fix;
    byId("fix-note").textContent = this.fix ? `Fix at ${placeText(this.fix)}, ${this.clock}.` : plan ? "Set the time below the map, place a fix, and drag it to where the vehicle is." : "A fix belongs to the plan: make this point the plan first.";
    this.redraw();
  }

  dragFix(place) { this.fix = place; this.showFix(); }

  async replan() {
    const sd = +byId("fix-sd").value, [lon, lat] = this.fix;
    if (!(sd > 0)) throw new Error("the standard deviation of the fix must be more than 0 m");
    await this.open(await ask("POST", `/api/plans/${this.id}/replan`, { time: this.view.t[this.step], fix: [lat, lon, sd] }));
  }

  // --- on the map -----------------------------------------------------------------------------------

  shapes(map) {
    if (!this.view || !this.front) return [...this.early.map(point => track(map, point.line ?? [], "early")), track(map, this.early[this.looked]?.line ?? [])];
    const { view, step } = this, flights = byId("layer-flights").checked ? flown(map, view.flights, step) : [];
    const parts = [...this.studies.beaconShapes(map), ...flights, ...this.pinned.map((one, k) => track(map, one.view.line, `pinned kept-${k % 4}`)), ...ellipses(map, view), ...view.tree ? branchShapes(map, view.tree) : [], track(map, view.line), ellipse(map, view, step, "now"), ...vehicle(map, view, step, stepLines(map, view, step).join("\n"))];
    if (this.fix) { const [x, y] = map.at(this.fix); parts.push(svg("circle", { class: "fix", "data-fix": "", cx: x, cy: y, r: 11 }), svg("path", { class: "fixcross", d: `M${x - 16} ${y}H${x + 16}M${x} ${y - 16}V${y + 16}` })); }
    return parts;
  }

  /** What the layers show at this time, as elements. */
  legends() {
    const shown = this.wind.legends();
    if (this.view && byId("layer-flights").checked) { const { at, failed } = this.view.flights; shown.push(html("span", { class: "speeds" }, `${at.length} simulated flights, ${failed.filter(step => step >= 0 && step <= this.step).length} failed by now`)); }
    return shown;
  }
}
