// The page of a flight: asks for what is new every second, and draws it. Text is set as text, never as markup.

import { ellipses, track } from "./flight.js";
import { centre, EARTHLY, ellipseAround, lengthText, PLANAR, ticksBetween } from "./geo.js";
import { ChartMap } from "./map.js";
import { byId, duration, html, pathOf, percent, svg } from "./shapes.js";

const EVERY = 1000;  // [ms] between two questions
const LISTED = 40;  // lines below each other, at most
const EDGE = { left: 62, right: 10, top: 10, bottom: 34 };
const LEAST = 1e-4;  // smaller rates are drawn here

let plan = null, number = null, next = 0, events = [], rest = { at: [], failed: [] }, map = null;

async function asked(path) {
  const answer = await fetch(path);  // the browser adds the cookie of its session
  if (!answer.ok) throw new Error(`the server answers ${answer.status}`);
  return answer.json();
}

async function look() {
  try {
    const state = await asked(`/api/state?since=${next}`);
    byId("gone").hidden = true;
    if (state.plan !== number) await open(state.plan);
    next = state.next;
    rest = state.rest;
    if (state.events.length) heard(state.events);
  } catch {
    byId("gone").textContent = "The watch does not answer: it has ended, or was interrupted. What you see is old.";
    byId("gone").hidden = false;
  }
  setTimeout(look, EVERY);
}

async function open(told) {
  plan = await asked("/api/plan");
  if (!plan.map) { plan = null; return; }
  if (number !== null) events = events.filter(event => event.event === "alarm");  // times count from another departure
  number = told;
  byId("name").textContent = document.title = plan.name;
  byId("formula").textContent = plan.formula;
  const shape = plan.map.earthly ? EARTHLY : PLANAR;
  map ??= new ChartMap(byId("map"), layers, { press: () => null, drag: () => {}, dropped: () => {}, move: place => { byId("where").textContent = map.plane.text(place); }, click: () => {} }, { plane: shape });
  fit();
}

const fit = () => map?.fit(plan.map.shapes.find(shape => shape.role === "bounds").ring);

function heard(found) {
  const fresh = found.filter(event => event.event === "alarm");
  events.push(...found);
  if (fresh.length && next > found.length && byId("sound").checked) beep();
  draw();
}

/** Two short tones. */
function beep() {
  const sound = new AudioContext();
  for (const [start, pitch] of [[0, 880], [0.25, 660]]) {
    const tone = sound.createOscillator(), volume = sound.createGain();
    tone.frequency.value = pitch;
    volume.gain.value = 0.2;
    tone.connect(volume).connect(sound.destination);
    tone.start(sound.currentTime + start);
    tone.stop(sound.currentTime + start + 0.2);
  }
}

const statuses = () => events.filter(event => event.at);

// --- map ---

function layers() {
  const shapesOf = role => plan.map.shapes.filter(shape => shape.role === role), told = statuses();
  const outline = ({ role, name, ring }) => svg("path", { class: `feature ${role}`, d: map.line(ring, true) }, svg("title", {}, name));
  const names = shapesOf("region").map(({ name, ring }) => {
    const [x, y] = centre(ring.slice(0, -1).map(place => map.at(place)));
    return svg("text", { class: "label", x, y: y + 5, "text-anchor": "middle" }, name);
  });
  const lines = [false, true].map(failed => rest.at.filter((_, k) => rest.failed[k] === failed).map(line => map.line(line)).join(""));
  const parts = [
    svg("path", { class: plan.map.walled ? "feature border walled" : "feature border", d: map.line(shapesOf("bounds")[0].ring, true) }),
    ...["obstacle", "landmark", "region"].flatMap(role => shapesOf(role).map(outline)),
    ...ellipses(map, plan), track(map, plan.line, "planned"), svg("path", { class: "trail", d: lines[0] }), svg("path", { class: "trail lost", d: lines[1] }), ...names,
  ];
  if (told.length) parts.push(svg("path", { class: "believed", d: map.line(told.map(event => event.at)) }));
  for (const fix of events.filter(event => event.place)) parts.push(fixMark(fix));
  if (told.length) parts.push(...here(told.at(-1)));
  return parts;
}

function fixMark({ place, use, line }) {
  const [x, y] = map.at(place), refused = use === "refused";
  const d = refused ? pathOf([[x - 5, y - 5], [x + 5, y + 5]]) + pathOf([[x - 5, y + 5], [x + 5, y - 5]]) : pathOf([[x - 6, y], [x + 6, y]]) + pathOf([[x, y - 6], [x, y + 6]]);
  return svg("path", { class: `mark ${refused ? "refused" : "used"}`, d }, svg("title", {}, line));
}

function here(event) {
  const [cx, cy] = map.at(event.at);
  return [svg("path", { class: "ellipse now", d: map.line(ellipseAround(map.plane, event.at, event.ellipse), true) }), svg("circle", { class: "vehicle", cx, cy, r: 6 }, svg("title", {}, "believed position"))];
}

// --- words and numbers ---

function draw() {
  if (!plan) return;
  map.refresh();
  const told = statuses(), now = told.at(-1);
  if (now) {
    byId("facts").replaceChildren(...facts(now));
    byId("law").textContent = `Simulated flights from where the robot may be, in ${now.law} winds; with their 95 % interval${now.promised === null ? "" : "; dashed: promised at departure"}. Green: positions, red: alarms.`;
    chart(byId("promise"), told);
  }
  const alarms = events.filter(event => event.event === "alarm"), last = events.at(-1)?.time ?? 0;
  byId("alarms").replaceChildren(...alarms.slice(-3).reverse().map(one => html("p", { class: last - one.time > 600 ? "alarm old" : "alarm" }, one.line)));
  document.documentElement.dataset.ready = "flight";
  byId("events").replaceChildren(...events.filter(one => one.line).slice(-LISTED).reverse().map(one => html("li", { class: one.event === "alarm" ? "alarmed" : "" }, one.line)));
}

function fact(name, value, note = "", kind = "") {
  return html("div", { class: kind }, html("dt", {}, name), html("dd", {}, value, note ? html("small", {}, note) : null));
}

const wattHours = joules => `${(joules / 3600).toLocaleString("en", { maximumFractionDigits: joules < 3.6e5 ? 1 : 0 })} Wh`;

function facts(now) {
  const worse = now.promised !== null && now.low > now.promised;
  const found = [
    fact("the rest of the plan fails", percent(now.failure), `95 %: ${percent(now.low)} to ${percent(now.high)}${now.promised === null ? "" : `; promised at departure ${percent(now.promised)}`}`, worse ? "main bad" : "main"),
    fact("after departure", duration(now.time), `the plan ends at ${duration(now.end)}`),
    fact("next", now.goal.length ? now.goal.join(" and ") : "-", now.goal.length ? `in ${duration(Math.max(0, now.goal_time - now.time))}` : "no region is left"),
    fact("position", map.plane.text(now.at), `95 % within ${lengthText(now.ellipse[0])} × ${lengthText(now.ellipse[1])}`),
    fact("from the plan", `${now.corridor.toFixed(1)} standard deviations`, now.corridor > 3.03 ? "outside the 99 % corridor" : "inside the 99 % corridor", now.corridor > 3.03 ? "bad" : ""),
    fact("wind there", `${now.wind_from.toFixed(0)}° ${Math.hypot(...now.wind).toFixed(1)} m/s`, `± ${now.wind_sd.toFixed(1)} m/s (standard deviation in each direction)`),
  ];
  if (now.energy !== null) found.push(fact("energy", `${wattHours(now.energy)} used`, `of ${wattHours(now.energy_needed)} by the end of the plan`));
  if (now.battery !== null) found.push(fact("battery", percent(now.battery), "as the autopilot says"));
  return found;
}

/** The failure rate over time, on a logarithmic axis. */
function chart(root, told) {
  const w = root.clientWidth || 360, h = root.clientHeight || 176, base = h - EDGE.bottom, hours = 3600;
  root.setAttribute("viewBox", `0 0 ${w} ${h}`);
  const end = Math.max(told.at(-1).end, told.at(-1).time, 1), rates = told.flatMap(event => [event.high, event.promised ?? event.high, event.failure]);
  const least = Math.floor(Math.log10(Math.max(LEAST, Math.min(...told.flatMap(event => [event.failure, event.promised ?? 1]).map(rate => Math.max(rate, LEAST)))))), most = Math.min(0, Math.ceil(Math.log10(Math.max(...rates, 10 * LEAST))));
  const x = time => EDGE.left + time / end * (w - EDGE.left - EDGE.right), y = rate => base - Math.max(0, Math.log10(Math.max(rate, 10 ** least)) - least) / Math.max(most - least, 1) * (base - EDGE.top);
  const along = key => told.map(event => [x(event.time), y(event[key])]), cut = told.some(event => event.failure < 10 ** least), parts = [];
  for (let k = least; k <= most; k++) parts.push(svg("path", { class: "grid", d: pathOf([[EDGE.left, y(10 ** k)], [w - EDGE.right, y(10 ** k)]]) }), svg("text", { x: EDGE.left - 5, y: y(10 ** k) + 4, "text-anchor": "end" }, `${k === least && cut ? "≤ " : ""}${percent(10 ** k)}`));
  const unit = end >= 2 * hours ? ["h", hours] : ["min", 60];
  for (const tick of ticksBetween(0, end / unit[1], 6)) parts.push(svg("text", { x: x(tick * unit[1]), y: base + 15, "text-anchor": "middle" }, tick.toLocaleString("en")));
  for (const event of events) if (event.event === "fix" || event.event === "alarm") parts.push(svg("path", { class: event.event === "fix" ? "fixed" : "alarmed", d: pathOf([[x(event.time), EDGE.top], [x(event.time), base]]) }));
  parts.push(svg("path", { class: "rates", d: pathOf([...along("low"), ...along("high").reverse()], true) }), svg("path", { class: "rate", d: pathOf(along("failure")) }));
  const { promised } = told.at(-1);
  if (promised !== null) parts.push(svg("path", { class: "promised", d: pathOf([[EDGE.left, y(promised)], [w - EDGE.right, y(promised)]]) }));
  parts.push(svg("path", { class: "axis", d: pathOf([[EDGE.left, EDGE.top], [EDGE.left, base], [w - EDGE.right, base]]) }), svg("text", { x: (EDGE.left + w) / 2, y: h - 3, "text-anchor": "middle" }, `${unit[0]} after departure`));
  root.replaceChildren(...parts);
}

byId("zoom-in").addEventListener("click", () => map?.zoom(1.6));
byId("zoom-out").addEventListener("click", () => map?.zoom(1 / 1.6));
byId("fit").addEventListener("click", fit);
look();
