// The desk: joins map, drawing, panels and result; opens and saves files; shows errors in the page.

import { ask, giveFile } from "./api.js";
import { Backdrop } from "./backdrop.js";
import { BEGIN, Drawing } from "./drawing.js";
import { Earth } from "./earth.js";
import { lengthText, mercator, placeText } from "./geo.js";
import { ChartMap } from "./map.js";
import { Panels } from "./panels.js";
import { Profile } from "./profile.js";
import { Result } from "./result.js";
import { byId, html, percent, svg } from "./shapes.js";
import { kml, outline, Store, withRole } from "./store.js";
import { Studies } from "./studies.js";

const EXAMPLE_FORMULAS = { hop: "F(a & F b)", phi1: "F a & F b & F c", phi2: "F(a & F(b & F c)) | F(a & F(d & F c))" };
let spot = null;  // a place that an error names

function failed(error) {
  const text = error.message.replace(/^scene file maps\/\w+\.\w+: | \[plans\/[^\]]*\]$/g, ""), found = /longitude (-?[0-9.]+), latitude (-?[0-9.]+)/.exec(text);
  spot = found ? [+found[1], +found[2]] : null;
  byId("problem-text").textContent = text.replace(/^[a-z]+(?=[ ,;:])/, word => word[0].toUpperCase() + word.slice(1));  // not the name of a setting
  byId("problem").hidden = false;
  byId("problem").scrollIntoView({ block: "nearest" });
  map.refresh();
}

function forgive() { byId("problem").hidden = true; spot = null; }

const store = new Store(() => { if (ready) { panels.show(); drawing.hint(); } backdrop.show(store.mission.backdrop).catch(failed); byId("no-backdrop").hidden = !store.mission.backdrop; map.refresh(); readyToPlan(); }, failed, state => { document.documentElement.dataset.mission = state; });
let ready = false, earth, drawing, panels, profile, result, studies;
const backdrop = new Backdrop(() => map.refresh());

const map = new ChartMap(byId("map"), view => [...earth?.layer.names(view) ?? [], ...backdrop.shapes(view), ...windShapes(view), ...profile?.shapes(view) ?? [], ...drawing?.shapes(view, result?.view?.line ?? []) ?? [], ...result?.shapes(view) ?? [], ...spotShapes(view)], {
  press: (place, target) => target.dataset?.fix !== undefined ? { kind: "fix" } : drawing.press(place, target),
  drag: (held, place, before) => held.kind === "fix" ? result.dragFix(place) : drawing.drag(held, place, before),
  dropped: held => { if (held.kind !== "fix") store.changed(); },
  move: place => { byId("where").textContent = `${placeText(place)}${windText(place)}`; drawing.move(place); profile?.take(place); },
  click: (place, target) => drawing.click(place, target),
}, { under: () => earth?.shapes() ?? [] });

Object.assign(map, { middle: mercator([-92, 37]), scale: 6000 });  // until there is something to show: 700 km

/** The wind of the plan that is shown, or the wind before one; it lies under what is drawn. */
function windShapes(view) {
  if (!result) return [];
  byId("legend").replaceChildren(...result.view ? result.legends() : studies.before.legends());
  return result.view ? result.wind.shapes(view, result.view.t[result.step]) : studies.before.shapes(view, studies.time);
}

/** The wind that the map shows: its result, layer and time; null if there is none. */
function windShown() {
  if (result?.view) return { id: result.id, layer: result.wind, time: result.view.t[result.step] };
  return studies?.before.view ? { id: studies.shownId, layer: studies.before, time: studies.time } : null;
}

/** The expected wind under the pointer. */
function windText(place) {
  const shown = windShown(), found = shown?.layer.near(place, shown.time);
  return !found ? "" : found.water ? `, current ${found.speed.toFixed(2)} m/s sets to ${found.to.toFixed(0)}°, ± ${found.sd.toFixed(2)} m/s` : `, wind ${found.speed.toFixed(1)} m/s (${(found.speed / 0.514444).toFixed(0)} kt) from ${found.from.toFixed(0)}°, ± ${found.sd.toFixed(1)} m/s`;
}

function spotShapes(view) {
  if (!spot) return [];
  const [cx, cy] = view.at(spot);
  return [svg("circle", { class: "spot", cx, cy, r: 14 }, svg("title", {}, byId("problem-text").textContent))];
}

function everything() {
  const places = store.mission.features.flatMap(outline);
  if (result.view) places.push(...result.view.line);
  return places.length ? places : backdrop.places;
}

function readyToPlan() {
  if (!ready) return;
  const { features } = store.mission, has = role => features.some(one => one.role === role);
  const missing = !has("start") ? "needs a start" : !has("region") ? "needs a region" : !panels.formula ? "needs a mission without an error" : "";
  byId("plan").disabled = byId("compare-starts").disabled = result.working || Boolean(missing);
  byId("missing").textContent = result.working ? "" : missing;
  byId("plan-note").hidden = !byId("result").hidden;
  byId("show-wind").disabled = !has("start");
}

async function plan(command) {
  forgive();
  drawing.stop();
  await store.send();
  byId("plan-title").scrollIntoView();
  await result.open(await ask("POST", "/api/plans", panels.request(command)));
  readyToPlan();
  await listEarlier();
}

/** A plan by what it does and when it was made: "a, then b, 27 Nov 18:35". */
function planName({ id, mission, made_by: maker }) {
  const [, year, month, day, hour, minute] = /^(\d{4})(\d\d)(\d\d)-(\d\d)(\d\d)/.exec(id) ?? [], made = year ? `${year}-${month}-${day} ${hour}:${minute} UTC` : id;
  const kind = maker === "choose" ? "another point: " : maker === "replan" ? "planned again: " : "";
  return `${kind}${mission ? `${mission.replace(/\b[a-z_]\w*\b/g, name => store.names.has(name) ? store.titleOf(name) : name)}, ` : ""}${made}`;
}

async function listEarlier() {
  const plans = (await ask("GET", "/api/plans")).plans.filter(state => state.made_by !== "wind");
  byId("earlier-part").hidden = !plans.length;
  byId("earlier").replaceChildren(...plans.slice(0, 30).map(state => html("li", {}, html("button", { type: "button", class: "plain", onclick: () => { forgive(); result.open(state).then(readyToPlan); } }, planName(state)), html("span", { class: "note" }, state.made_by === "departure" ? `departures, ${state.status}` : state.failure === null ? state.status : `${state.status}: ${lengthText(state.length_m)}, ${percent(state.failure)} fail`), state.status === "running" ? "" : html("button", { type: "button", class: "plain remove", "aria-label": `remove ${planName(state)}`, title: "move its files to the folder removed", onclick: () => removePlan(state).catch(failed) }, "×"))));
}

/** Take a plan from the list, and tell where its files are. */
async function removePlan(state) {
  if (state.id === result.id) { byId("removed").textContent = "This plan is shown; open another one first."; return; }
  if (!confirm(`Remove ${planName(state)} from the list? Its files are moved to the folder "removed".`)) return;
  const { moved } = await ask("POST", `/api/plans/${state.id}/remove`, {});
  await listEarlier();
  byId("removed").textContent = `Its files are in ${moved}.`;
}

// --- files --------------------------------------------------------------------------------------------

async function openFile(input) {
  const [file] = input.files;
  input.value = "";
  if (!file) return;
  take(await ask("POST", `/api/maps?name=${encodeURIComponent(file.name)}`, file));
}

function take(collection) {
  forgive();
  drawing.stop();
  result.reset();
  const left = store.open(collection);
  map.fit(everything());
  const words = [left, ...collection.warnings ?? []].filter(Boolean).join(" ");
  if (words) failed(new Error(words));
}

/** Add the features of a text, or of a file, to what is drawn. */
async function include(content, name) {
  forgive();
  const role = byId("import-role").value, found = await ask("POST", `/api/maps?name=${encodeURIComponent(name)}&role=${role}`, new Blob([withRole(content, role, byId("import-buffer").value.trim())]));
  drawing.stop();
  const added = store.include(found);
  byId("paste").value = "";
  byId("import-part").open = false;
  map.fit(everything());
  byId("hint").textContent = `Added: ${added} ${added === 1 ? "feature" : "features"}.`;
  const words = (found.warnings ?? []).join(" ");
  if (words) failed(new Error(words));
}

async function includeFile(input) {
  const [file] = input.files;
  input.value = "";
  if (file) await include(/\.kmz$/i.test(file.name) ? file : await file.text(), file.name);
}

async function openExample(name) {
  if (name) take({ ...await ask("GET", `/api/examples/${name}`), mission: { pattern: "formula", formula: EXAMPLE_FORMULAS[name] ?? "", robot: name === "hop" ? "light_aircraft" : "airframe", wind: "sample", departure: "" } });
}

async function openBackdrop(input) {
  const [file] = input.files;
  input.value = "";
  if (!file) return;
  forgive();
  const name = await backdrop.take(file);
  store.change(mission => { mission.backdrop = name; });
  map.fit(everything());
}

function listen() {
  const on = (id, kind, act) => byId(id).addEventListener(kind, event => { Promise.resolve(act(event)).catch(failed); });
  on("plan", "click", () => plan("plan"));
  on("compare-starts", "click", () => plan("departure"));
  for (const layer of ["wind", "doubt", "flights"]) on(`layer-${layer}`, "change", () => map.refresh());
  on("open", "click", () => byId("file").click());
  on("file", "change", event => openFile(event.target));
  on("import-text", "click", () => byId("paste").value.trim() ? include(byId("paste").value, "the text") : byId("paste").focus());
  on("import-open", "click", () => byId("import-file").click());
  on("import-file", "change", event => includeFile(event.target));
  on("backdrop", "click", () => byId("backdrop-file").click());
  on("backdrop-file", "change", event => openBackdrop(event.target));
  on("no-backdrop", "click", () => store.change(mission => { mission.backdrop = ""; }));
  on("example", "change", async event => { const name = event.target.value; event.target.value = ""; await openExample(name); });
  on("save", "click", () => giveFile("mission.geojson", new Blob([`${JSON.stringify(store.saved(), null, 1)}\n`], { type: "application/geo+json" })));
  on("save-kml", "click", () => giveFile("mission.kml", new Blob([kml(store.geojson())], { type: "application/vnd.google-earth.kml+xml" })));
  on("clear", "click", () => { drawing.stop(); result.reset(); forgive(); store.clear(); });
  on("zoom-in", "click", () => map.zoom(1.5));
  on("zoom-out", "click", () => map.zoom(1 / 1.5));
  on("fit", "click", () => map.fit(everything()));
  on("problem-close", "click", () => { forgive(); map.refresh(); });
  addEventListener("pagehide", () => { store.send(); });
}

async function begin() {
  earth = new Earth(map, failed);
  drawing = new Drawing(map, store, text => { byId("hint").textContent = text; byId("hint").classList.toggle("begin", text === BEGIN); });
  panels = new Panels(store, drawing, failed);
  studies = new Studies({ redraw: () => map.refresh(), failed, request: command => panels.request(command), id: () => result.id, departs: departure => store.change(mission => { mission.departure = departure; }) });
  result = new Result({ studies, redraw: () => { map.refresh(); readyToPlan(); }, fit: () => map.fit(everything()), failed, title: name => store.titleOf(name), remember: id => store.adjust(mission => { mission.plan = id; }) });
  profile = new Profile({ map, shown: windShown, failed });
  listen();
  panels.offer(await ask("GET", "/api/choices"));
  await store.load();
  ready = true;
  drawing.take("select");
  map.fit(everything());
  document.documentElement.dataset.ready = "desk";
  await listEarlier();
  if (store.mission.plan) {
    const id = store.mission.plan, state = await ask("GET", `/api/plans/${id}`).catch(() => null);
    if (id === store.mission.plan && ["done", "running"].includes(state?.status)) { await result.open(state); readyToPlan(); }
  }
}

begin().catch(failed);
