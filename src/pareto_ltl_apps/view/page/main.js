// Reactions to choices, to the slider and to play; charts, lists, and the layout for printing.

import { branchKeys } from "./branches.js";
import { drawFront } from "./front.js";
import { lengthText } from "./geo.js";
import { drawMachine, markMachine } from "./machine.js";
import { Player } from "./player.js";
import { drawRisk } from "./risk.js";
import { byId, duration, flightsText, html, percent } from "./shapes.js";

const player = new Player(step => {
  shown.step = step;
  showMoment();
  return timeText(moment());
});

/** Show a point in all parts of the page. */
function showPoint(point) {
  if (point === null || !(point in PAGE.points)) return;
  shown.point = point;
  byId("point").value = point;
  byId("previous").disabled = point === 0;
  byId("next").disabled = point === PAGE.points.length - 1;
  byId("home").disabled = point === PAGE.chosen || PAGE.chosen === null;
  byId("map-note").textContent = mapNote();
  limitTime();
  showFacts();
  showFront();
  listFiles();
  listProgress();
  player.go(player.step);
}

/** The numbers at the top: as they were written for the plan, or the numbers of another point that is shown. */
function showFacts() {
  const place = byId("facts"), note = byId("facts-note");
  if (!place) return;
  showFacts.plan ??= [...place.children];
  note.hidden = shown.point === PAGE.chosen || PAGE.chosen === null;
  if (note.hidden) { place.replaceChildren(...showFacts.plan); return; }
  const row = PAGE.points[shown.point], utc = path()?.utc?.at(-1);
  const [count, interval] = row.failure_low === null ? [] : flightsText(row.failure, row.failure_low, row.failure_high);
  const rate = row.failure_low === null ? [`≤ ${percent(row.failure)}`, `upper bound, under ${row.law} ${FLOWS}`] : [count, `${interval} (95 %); ${row.runs.toLocaleString("en")} flights under ${row.law} ${FLOWS}`];
  const facts = [["fails", ...rate], ["length", lengthText(row.length_m), "of the expected path"], ["duration", duration(row.duration_s), `${row.steps} steps`]];
  if (utc) facts.push(["arrival", `${utc.slice(11, 16)} UTC`, utc.slice(0, 10)]);
  facts.push(["shown", `point ${shown.point}`, [`of the front, not the plan (point ${PAGE.chosen})`, ...row.costs].join("; ")]);
  place.replaceChildren(...facts.map(([name, value, small], k) => html("div", { class: k ? "fact" : "fact main" }, html("dt", {}, name), html("dd", {}, value, html("small", {}, small)))));
  note.textContent = `These are the numbers of point ${shown.point}. The sections “How often it fails” and “What limits it” are about the plan, point ${PAGE.chosen}.`;
}

function limitTime() {
  player.limit((path()?.line ?? PAGE.wind.t).length - 1);
}

/** The time that is shown: on the map, in the charts and in words. */
function showMoment() {
  const view = path();
  if (view) byId("moment").textContent = momentText(view);
  map.refresh();
  showRisk();
  markProgress();
}

// --- charts and lists -----------------------------------------------------------------------------

function showFront() {
  if (!byId("front")) return;
  const text = k => [`point ${k}${k === PAGE.chosen ? ", the chosen plan" : ""}`, failureText(PAGE.points[k]), lengthText(PAGE.points[k].length_m), duration(PAGE.points[k].duration_s), ...PAGE.points[k].costs, PAGE.points[k].order].filter(Boolean).join("\n");
  drawFront(byId("front"), PAGE.points, { shown: shown.point, chosen: PAGE.chosen, choose: showPoint, text, hollow: k => !isDrawn(k) });
  const [{ law, runs }] = PAGE.points;
  byId("front-note").textContent = PAGE.judge === "bound" ? `Each point is a path. Up: an upper bound on its failures under ${law} ${FLOWS}. Click a point to see its path.`
    : `Each point is a path. Up: how many of its ${runs.toLocaleString("en")} flights under ${law} ${FLOWS} fail, with the 95 % interval. Click a point to see its path. ${PAGE.trades[shown.point]}`;
}

function showRisk() {
  const view = path();
  if (!byId("risk")) return;
  if (!view) { byId("risk").replaceChildren(); byId("risk-note").textContent = `The flights of point ${shown.point} are not in this page.`; return; }
  drawRisk(byId("risk"), view, shown.step, PAGE.causes);
  const total = view.risk.failed.reduce((sum, cause) => sum + cause.at(-1), 0);
  byId("risk-note").textContent = `${total.toLocaleString("en")} of ${view.risk.runs.toLocaleString("en")} simulated flights of this point fail under ${view.risk.law} ${FLOWS}: how many have failed by each time; the band is the 95 % interval. `
    + `Whether a mission was missed is known at its end. The flights of all points meet the same ${FLOWS}.`;
}

function showMachine() {
  const place = byId("machine"), { automaton } = PAGE;
  if (!place) return;
  if (!automaton) place.closest("section").remove();
  else if (automaton.shapes) drawMachine(place, automaton.shapes);
  else place.append(html("p", { class: "note" }, `The automaton has ${automaton.states} states, too many to draw.`));
}

/** Mark the state of the expected path at the step that is shown, and the states before it. */
function markProgress() {
  const view = path();
  if (!view || !byId("machine")) return;
  markMachine(byId("machine"), view.q[shown.step], new Set([PAGE.automaton?.initial, ...view.q.slice(0, shown.step + 1)]));
  for (const line of byId("progress").children) line.classList.toggle("now", +line.dataset.first <= shown.step && shown.step < +line.dataset.end);
}

/** One line for each stretch of the expected path in one state. */
function listProgress() {
  const view = path(), list = byId("progress");
  if (!view || !PAGE.automaton || !list) return;
  const starts = view.q.map((_, k) => k).filter(k => k === 0 || view.q[k] !== view.q[k - 1]);
  list.replaceChildren(...starts.map((first, n) => {
    const end = starts[n + 1] ?? view.q.length, role = PAGE.automaton.roles[view.q[first]];
    const where = view.label[first].length ? ` in ${view.label[first].join(", ")}` : "";
    const state = role === "goal" ? "mission complete" : role === "lost" ? "mission lost" : first ? "next goal" : "on the way";
    return html("li", { "data-first": first, "data-end": end }, `${timeText(view.t[first])}: state ${view.q[first]}${where}, ${state}`);
  }));
}

// --- the first picture -----------------------------------------------------------------------------

/** Draw map and charts in the size of their places: for printing nothing can be drawn later. */
function drawAll() {
  map.fit(border);
  map.drawNow();
  showFront();
  showRisk();
}

function fillChooser() {
  const select = byId("point");
  if (!select) return;
  PAGE.points.forEach((row, k) => select.append(html("option", { value: k }, `point ${k}${k === PAGE.chosen ? " (chosen)" : ""}: ${lengthText(row.length_m)}, ${failureText(row)}`)));
  select.value = shown.point;
  select.addEventListener("change", () => showPoint(+select.value));
  byId("previous").addEventListener("click", () => showPoint(shown.point - 1));
  byId("next").addEventListener("click", () => showPoint(shown.point + 1));
  byId("home").addEventListener("click", () => showPoint(PAGE.chosen));
  byId("previous").disabled = shown.point === 0;
  byId("next").disabled = shown.point === PAGE.points.length - 1;
  byId("home").disabled = true;
}

function hideUseless() {
  const roles = new Set(PAGE.map.shapes.map(shape => shape.role)), drop = sign => document.querySelector(`.key${sign}`).parentElement.remove();
  if (!PAGE.flights) for (const part of [byId("flights-label"), ...document.querySelectorAll(".flight-key")]) part.remove();
  if (!path()) {
    for (const sign of [".end", ".way", ".robot"]) drop(sign);
    byId("layer-ellipses").parentElement.remove();
    byId("moment").remove();
  }
  if (!PAGE.onEarth) byId("export-command")?.parentElement.remove();
  if (!(PAGE.places.length || PAGE.pricedObstacles.length) || PAGE.chosen === null) for (const id of ["places-label", "places-key"]) byId(id).remove();
  if (!roles.has("landmark")) byId("landmark-key").remove();
  if (!roles.has("obstacle")) drop(".obstacle");
  if (Object.keys(PAGE.paths).length < 2) byId("others-label").remove();
}

function listen() {
  const on = (id, kind, act) => byId(id).addEventListener(kind, act);
  on("zoom-in", "click", () => map.zoom(1.5));
  on("zoom-out", "click", () => map.zoom(1 / 1.5));
  on("fit", "click", () => map.fit(border));
  for (const box of document.querySelectorAll(".layers input")) box.addEventListener("change", () => { map.refresh(); byId("map-note").textContent = mapNote(); byId("wind-keys").replaceChildren(...wind.legends()); });
  for (const [kind, printing] of [["beforeprint", true], ["afterprint", false]]) addEventListener(kind, () => { document.documentElement.classList.toggle("printing", printing); drawAll(); });
  for (const id of ["front", "risk"]) if (byId(id)) new ResizeObserver(() => { showFront(); showRisk(); }).observe(byId(id));
}

hideUseless();
fillChooser();
limitTime();
listen();
byId("map-note").textContent = mapNote();
byId("wind-keys").replaceChildren(...wind.legends());
if (PAGE.tree) document.querySelector("ul.keys").append(...branchKeys(PAGE.tree));
showMachine();
drawAll();
if (byId("files")) listFiles();
listProgress();
player.go(0);
document.documentElement.dataset.ready = "page";
