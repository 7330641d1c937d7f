// The panels beside the map: the list of features and their form, the mission, the vehicle and the wind.

import { ask } from "./api.js";
import { metresOf, placeOf, placeText } from "./geo.js";
import { titleOf } from "./drawing.js";
import { fixOf } from "./store.js";
import { drawMachine } from "./machine.js";
import { byId, html } from "./shapes.js";

const PATTERNS = {
  sequence: { label: "Visit these in this order", goals: "Regions, in the order in which you press them" },
  coverage: { label: "Visit all of these, in any order", goals: "Regions to visit" },
  either: { label: "Visit one of these", goals: "Regions, one of which is enough" },
  reach_avoid: { label: "Visit in order, and stay out of others", goals: "Regions, in the order in which you press them", avoid: true },
  avoid_until: { label: "Stay out of some until one is reached", goals: "Until this region is reached", avoid: true },
  patrol: { label: "Go round and return to the first", goals: "Regions, in the order in which you press them" },
  formula: { label: "A formula of temporal logic" },
};
const WINDS = { sample: "Packaged: USA, 9 to 10 October 2018", calm: "No wind", noaa: "Newest forecast of NOAA (downloads)", file: "A file of mine…" };
const WIND_NOTES = {
  sample: "For trying the desk: a map elsewhere needs another wind.", calm: "Every flight follows its plan.",
  noaa: "This plan loads a forecast from NOAA; nothing else leaves this machine. It needs the extra grib.",
};
const PLANNERS = { quick: "quick", default: "normal", dense: "thorough" };
const SOURCES = [[/\.csv(\.gz)?$/i, "csv"], [/\.nc4?$/i, "netcdf"], [/\.(grib2?|grb2?)$/i, "grib"]];
const WEEK = { report: "none", "robot.dt": 1800, "planner.max_steps": 336 };  // the wind for as long, whatever the vehicle
const FIX_NOTE = "Standard deviation: 50 m in each direction; for a coast or a road 50 m across, 20 km along (its longer side, or a direction such as 40°). Empty: as accurate as the vehicle's fixes.";
const TYPING = 250;  // [ms] after a key before the formula is explained

export class Panels {
  /** `failed(error)` shows an error; `explained` is the last answer on the formula. */
  constructor(store, drawing, failed) {
    Object.assign(this, { store, drawing, failed, explained: null, asked: "", timer: null, asking: null });
    fill("pattern", Object.entries(PATTERNS).map(([name, { label }]) => [name, label]));
    fill("wind", Object.entries(WINDS));
    fill("planner", Object.entries(PLANNERS));
    this.listen();
  }

  listen() {
    const { store } = this, on = (id, kind, act) => byId(id).addEventListener(kind, act);
    for (const key of ["pattern", "robot", "planner", "settings"]) on(key, "change", event => store.change(mission => { mission[key] = event.target.value; }));
    on("departure", "change", event => this.edit(event.target, text => { const departure = utcOf(text); store.change(mission => { mission.departure = departure; }); }));
    on("formula", "input", event => store.change(mission => { mission.pattern = "formula"; mission.formula = event.target.value; }));
    on("wind", "change", event => {
      if (event.target.value !== "file") { store.change(mission => { mission.wind = event.target.value; mission.windPath = ""; }); return; }
      event.target.value = store.mission.windPath ? "file" : store.mission.wind;
      byId("wind-file").click();
    });
    on("wind-file", "change", event => this.takeWind(event.target).catch(this.failed));
  }

  async takeWind(input) {
    const [file] = input.files;
    input.value = "";
    if (!file) return;
    const source = SOURCES.find(([pattern]) => pattern.test(file.name))?.[1];
    if (!source) throw new Error(`${file.name}: winds are read from .csv, .nc, .grib and .grib2 files`);
    const { path } = await ask("POST", `/api/winds?name=${encodeURIComponent(file.name.replace(/[^A-Za-z0-9._-]/g, "_"))}`, file);
    this.store.change(mission => { mission.wind = source; mission.windPath = path; });
  }

  offer(choices) {
    this.robots = choices.robot;
    fill("robot", choices.robot.map(({ name }) => [name, name.replaceAll("_", " ")]));
    for (const name of choices.examples) byId("example").append(html("option", { value: name }, name));
  }

  // --- showing the mission --------------------------------------------------------------------------

  show() {
    const { mission } = this.store, file = Boolean(mission.windPath);
    for (const key of ["pattern", "robot", "planner", "settings"]) if (byId(key).value !== mission[key]) byId(key).value = mission[key];
    if (document.activeElement !== byId("departure")) byId("departure").value = mission.departure.replace("T", " ");
    byId("wind").value = file ? "file" : mission.wind;
    byId("wind-note").textContent = file ? `File ${mission.windPath.split("/").pop()}.` : WIND_NOTES[mission.wind] ?? "";
    byId("robot-note").textContent = this.robots?.find(({ name }) => name === mission.robot)?.note.split(". ")[0].replace(/\.?$/, ".") ?? "";
    this.listFeatures();
    this.showEditor();
    this.showGoals();
    byId("undo").disabled = !this.store.past.length;
    byId("redo").disabled = !this.store.future.length;
    this.explain();
  }

  listFeatures() {
    const { features } = this.store.mission, missing = ["start", "region"].filter(role => !features.some(one => one.role === role));
    byId("draw-note").textContent = missing.length ? `Use the tools above the map: the mission needs ${missing.map(role => role === "start" ? "a start" : "a region to visit").join(" and ")}.` : "Click a feature on the map to move it or its corners. Without a border the sky is open: leaving the map is no failure.";
    const counts = {};
    byId("features").replaceChildren(...features.map((one, number) => {
      counts[one.role] = (counts[one.role] ?? 0) + 1;
      return html("li", {}, html("span", { class: `sign ${one.role}` }), html("button", { type: "button", class: "plain", "aria-pressed": number === this.drawing.chosen, onclick: () => this.drawing.choose(number) }, titleOf(one, counts[one.role])),
        html("button", { type: "button", class: "plain remove", "aria-label": `remove ${titleOf(one, counts[one.role])}`, onclick: () => { this.drawing.chosen = null; this.store.remove(number); } }, "×"));
    }));
  }

  /** The form of the chosen feature; it stays as it is while somebody types into it. */
  showEditor() {
    const form = byId("editor"), number = this.drawing.chosen, one = this.store.mission.features[number];
    form.hidden = !one;
    if (!one || (form.contains(document.activeElement) && form.dataset.feature === String(number))) return;
    form.dataset.feature = number;
    const field = (key, label, value, read) => html("label", {}, label, html("input", { value, "data-key": key, autocomplete: "off", onchange: event => this.edit(event.target, read) }));
    const fields = [];
    if (one.role === "region" || one.role === "obstacle") fields.push(field("title", "Name", one.title, text => { this.store.rename(number, text.trim() || one.name); }));
    if (one.shape === "circle") fields.push(field("place", one.role === "start" ? "Position" : "Centre", placeText(one.points[0]), text => this.put(number, "points", placeOf(text), "latitude and longitude, e.g. 36°45.7′N 92°24.2′W or 36.76, -92.40", place => [place])));
    if (one.role !== "start") fields.push(field("buffer", one.shape === "circle" ? "Radius" : one.shape === "line" ? "Width to each side" : "Safety distance", one.buffer, text => this.put(number, "buffer", text.trim() && metresOf(text) >= 0 ? text.trim() : text.trim() ? null : "", "a distance, e.g. 5 km, 3 nmi or 200 m")));
    if (one.role === "region" || one.role === "obstacle") for (const [key, label] of [["from", "Only from"], ["until", "Only until"]]) fields.push(field(key, label, one[key], text => this.put(number, key, text.trim(), "")));
    if (one.role === "landmark") fields.push(field("fix", "Error of a fix", one.fix ?? "", text => this.put(number, "fix", text.trim() && !fixOf(text) ? null : text.trim(), "e.g. 50 m, or 50 m across, 20 km along, 40°")));
    form.replaceChildren(...fields, html("p", { class: "note" }, one.role === "region" || one.role === "obstacle" ? "Times: 6h, 90min, or 2018-10-09T06:00Z; empty for always." : one.role === "landmark" ? FIX_NOTE : ""));
  }

  edit(input, read) {
    input.setCustomValidity("");
    try { read(input.value); } catch (error) { input.setCustomValidity(error.message); input.reportValidity(); }
  }

  put(number, key, value, wanted, made = one => one) {
    if (value === null || Number.isNaN(value)) throw new Error(`expected ${wanted}`);
    this.store.change(mission => { mission.features[number][key] = made(value); });
  }

  showGoals() {
    const { mission } = this.store, pattern = PATTERNS[mission.pattern], names = [...this.store.names].sort();
    byId("goals-part").hidden = mission.pattern === "formula";
    byId("avoid-part").hidden = !pattern.avoid;
    byId("goals-label").textContent = pattern.goals ?? "";
    for (const list of ["goals", "avoid"]) {
      const chips = names.map(name => {
        const place = mission[list].indexOf(name), one = mission.features.find(feature => feature.role === "region" && feature.name === name);
        return html("button", { type: "button", "aria-pressed": place >= 0, onclick: () => this.store.change(changed => { changed[list] = place >= 0 ? changed[list].filter(other => other !== name) : [...changed[list], name]; }) }, place >= 0 && list === "goals" ? `${place + 1}. ${one.title}` : one.title);
      });
      byId(list).replaceChildren(...chips.length ? chips : [html("span", { class: "note" }, "No regions yet.")]);
    }
  }

  // --- the formula ------------------------------------------------------------------------------------

  /** Ask the server what the mission means, when it has changed and typing has paused. */
  explain() {
    const { pattern, goals, avoid, formula } = this.store.mission, asked = JSON.stringify(pattern === "formula" ? { formula } : { pattern, goals, avoid });
    if (document.activeElement !== byId("formula") && pattern === "formula") byId("formula").value = formula;
    if (asked === this.asked) { this.showMeaning(); return; }
    this.asked = asked;
    clearTimeout(this.timer);
    this.asking?.abort();  // the server stops to work on a formula that has changed
    this.timer = setTimeout(async () => {
      const empty = pattern === "formula" ? !formula.trim() : !goals.length;
      const { signal } = this.asking = new AbortController();
      let told = null;
      try { if (!empty) told = await ask("POST", "/api/formula", JSON.parse(asked), signal); } catch (error) { if (!signal.aborted) this.failed(error); return; }
      if (asked !== this.asked) return;
      this.explained = told;
      if (pattern !== "formula") byId("formula").value = this.explained?.formula ?? "";
      this.showMeaning();
      this.drawMachine();
      this.store.changed();
    }, TYPING);
  }

  /** The formula to plan; empty if there is none without an error. */
  get formula() { return this.explained && !this.explained.error && !this.strange.length ? this.explained.formula : ""; }

  /** Names in the formula that no region has. */
  get strange() { return (this.explained?.names ?? []).filter(name => !this.store.names.has(name)); }

  showMeaning() {
    const place = byId("meaning"), told = this.explained;
    place.classList.toggle("wrong", Boolean(told && (told.error || this.strange.length)));
    if (!told) place.replaceChildren(this.store.names.size ? "Choose what to do." : "Draw a region first.");
    else if (told.error) place.replaceChildren(...told.column === null || told.column === undefined ? [] : [html("code", {}, told.formula.slice(0, told.column), html("mark", {}, told.formula.slice(told.column, told.column + 1) || "␣"), told.formula.slice(told.column + 1)), html("br")], `${told.error[0].toUpperCase()}${told.error.slice(1)}.`);
    else if (this.strange.length) place.replaceChildren(`No region has the name ${this.strange.join(", ")}.`);
    else place.replaceChildren(told.words ? `${told.words[0].toUpperCase()}${told.words.slice(1).replace(/\b[a-z_]\w*\b/g, name => told.names.includes(name) ? this.store.titleOf(name) : name)}.` : "", told.impossible ? " No flight can do this." : "", told.note ? ` ${told.note[0].toUpperCase()}${told.note.slice(1)}.` : "");
  }

  drawMachine() {
    const shapes = this.explained?.automaton?.shapes;
    byId("machine-part").hidden = !shapes;
    if (!shapes) { byId("machine").replaceChildren(); return; }
    drawMachine(byId("machine"), shapes);
  }

  // --- the request --------------------------------------------------------------------------------------

  /** The body of POST /api/plans. */
  request(command = "plan") {
    const { mission } = this.store, settings = { robot: mission.robot, wind: mission.wind, ...command === "wind" ? WEEK : { planner: mission.planner } };
    if (mission.windPath) settings["wind.path"] = mission.windPath;
    if (mission.departure && command !== "wind") settings["mission.start_time"] = `${mission.departure.length === 16 ? `${mission.departure}:00` : mission.departure}Z`;
    if (command === "departure") {
      Object.assign(settings, { report: "none", "departure.flights": 2000, "departure.seeds": 1, "departure.every": +byId("every").value || 6 });
      const latest = utcOf(byId("latest").value);
      if (latest) settings["departure.last"] = `${latest}:00Z`;
    }
    return { command, map: this.store.geojson(), ...command === "wind" ? {} : { formula: this.formula }, settings, overrides: mission.settings.split(/\s+/).filter(Boolean) };
  }
}

/** A time of "2018-10-09 06:00", "2018-10-09T06:00Z" and the like as 2018-10-09T06:00, UTC; empty for none. */
function utcOf(text) {
  const plain = text.trim(), found = /^(\d{4}-\d\d-\d\d)[T ]+(\d\d?):?(\d\d)(?::\d\d)?\s*(?:Z|UTC)?$/i.exec(plain), time = found && `${found[1]}T${found[2].padStart(2, "0")}:${found[3]}`;
  if (!plain || (time && !Number.isNaN(Date.parse(`${time}Z`)))) return time || "";
  throw new Error("expected a time in UTC, as 2018-10-09 06:00");
}

function fill(id, rows) {
  byId(id).replaceChildren(...rows.map(([value, label]) => html("option", { value }, label)));
}
