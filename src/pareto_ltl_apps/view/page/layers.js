// What the map shows: the mission, the wind, the path of the point that is shown, its flights and tight places.

import { branchNote, branchShapes } from "./branches.js";
import { ellipse, ellipses, flown, nameSpot, stepLines, track, vehicle } from "./flight.js";
import { EARTHLY, PLANAR } from "./geo.js";
import { GroundLayer } from "./ground.js";
import { ChartMap } from "./map.js";
import { byId, percent, svg } from "./shapes.js";
import { WindLayer } from "./wind.js";

const NEAR = 18;  // [pixels] from a click to a step of the path
const ground = new GroundLayer(PAGE.geography), wind = new WindLayer(PAGE.wind);
const ticked = id => byId(id)?.checked ?? false;
const closed = ring => ring.slice(0, -1);
const shapesOf = role => PAGE.map.shapes.filter(shape => shape.role === role);
const border = shapesOf("bounds")[0].ring;

const map = new ChartMap(byId("map"), layers, {
  press: () => null, drag: () => {}, dropped: () => {},
  move: place => { byId("where").textContent = map.plane.text(place); },
  click: place => goNear(place),
}, { plane: PAGE.map.earthly ? EARTHLY : PLANAR, scrolls: true, under: map => ground.shapes(map) });

/** All layers, the lowest first. */
function layers() {
  const view = path();
  return [
    ...ground.names(map), ...wind.shapes(map, moment()), svg("path", { class: PAGE.map.walled ? "feature border walled" : "feature border", d: map.line(border, true) }),
    ...["obstacle", "landmark", "region"].flatMap(role => shapesOf(role).map(shape => outline(shape))), ...closedRegions(moment()), ...trees(),
    ...otherPaths(), ...PAGE.tree && shown.point === PAGE.chosen || PAGE.tree?.trunk ? branchShapes(map, PAGE.tree) : [], ...view ? pathShapes(view) : [...PAGE.planned ? [track(map, PAGE.planned)] : [], startShape()], ...names(),
  ];
}

const outline = ({ role, name, ring }) => svg("path", { class: `feature ${role}`, d: map.line(ring, true), "data-name": name }, svg("title", {}, name));

function startShape() {
  const [cx, cy] = map.at(PAGE.map.start);
  return svg("circle", { class: "feature start", cx, cy, r: 5.5 }, svg("title", {}, "start"));
}

/** Names of regions where they fit, away from the path. */
function names() {
  const line = path()?.line.map(place => map.at(place)) ?? [];
  return shapesOf("region").map(({ name, ring }) => {
    const [x, y] = nameSpot(closed(ring).map(place => map.at(place)), line);
    return svg("text", { class: "label", x, y: y + 5, "text-anchor": "middle" }, name);
  });
}

/** Regions that are forbidden at time t. */
function closedRegions(t) {
  const now = PAGE.map.windows.filter(w => w.forbidden && (w.begin === null || w.begin <= t) && (w.end === null || t <= w.end)).map(w => w.region);
  return shapesOf("region").filter(shape => now.includes(shape.name)).map(({ ring }) => svg("path", { class: "shut", d: map.line(ring, true) }));
}

const trees = () => PAGE.trees.length ? [svg("path", { class: "branches", d: PAGE.trees.map(edge => map.line(edge)).join("") })] : [];

function otherPaths() {
  if (!ticked("layer-others")) return [];
  return [svg("path", { class: "others", d: Object.keys(PAGE.paths).filter(k => +k !== shown.point).map(k => map.line(PAGE.paths[k].line)).join("") })];
}

/** The path that is shown and what belongs to it. */
function pathShapes(view) {
  const rings = ticked("layer-ellipses"), flights = PAGE.flights && shown.point === PAGE.chosen && ticked("layer-flights") ? flown(map, PAGE.flights, shown.step) : [];
  return [
    ...rings ? ellipses(map, view) : [], ...flights, ...placeShapes(view), track(map, view.line), startShape(), ...rings ? [ellipse(map, view, shown.step, "now")] : [],
    ...vehicle(map, view, shown.step, [`step ${shown.step} of ${view.line.length - 1}, ${timeText(view.t[shown.step])}`, ...stepLines(map, view, shown.step)].join("\n")),
  ];
}

/** Tight places of the chosen plan: stretches of its path that give the reason, and the numbers of the obstacles
 *  that have a price. */
function placeShapes(view) {
  if (shown.point !== PAGE.chosen || !ticked("layer-places")) return [];
  const places = PAGE.places.map(({ step, lines }) => svg("path", { class: "place", "data-step": step, d: map.line(view.line.slice(step, step + 2)) }, svg("title", {}, lines.join("\n"))));
  const obstacles = shapesOf("obstacle"), numbers = PAGE.pricedObstacles.map(number => {
    const [x, y] = centre(closed(obstacles[number - 1].ring).map(place => map.at(place)));
    return svg("text", { class: "number", x, y: y + 5, "text-anchor": "middle" }, number);
  });
  return [...places, ...numbers];
}

/** Show the step of the path that is nearest to a place, if it is near. */
function goNear(place) {
  const view = path(), [x, y] = map.at(place);
  if (!view) return;
  const away = view.line.map(one => map.at(one)).map(([a, b]) => Math.hypot(a - x, b - y)), nearest = away.indexOf(Math.min(...away));
  if (away[nearest] < NEAR) { player.stop(); player.go(nearest); }
}

/** What the map says below itself. */
function mapNote() {
  if (shown.point !== null && !isDrawn(shown.point)) return `The path of point ${shown.point} is not in this page: pareto-ltl choose DIR --point ${shown.point} makes it the plan.`;
  const notes = [];
  if (PAGE.flights) notes.push(`${PAGE.flights.at.length} of ${PAGE.flights.runs.toLocaleString("en")} simulated flights of the chosen plan are drawn, as they come, under ${PAGE.flights.law} ${FLOWS}; those that have failed are dashed and dark red, with a cross.`);
  if (PAGE.law && path()) notes.push(`Ellipses hold 95 % of positions at a time under ${PAGE.law} ${FLOWS}.`);
  notes.push(wind.fastest ? [`${capital(MEDIUM.flow)} at ${PAGE.wind.level}`, wind.legend].filter(Boolean).join("; ") + "." : `${capital(MEDIUM.still)}.`, PAGE.map.walled ? "The border is a wall: leaving the map is a failure." : "The border is open.");
  for (const { name, forbidden, told } of PAGE.map.windows) notes.push(`${forbidden ? "Forbidden" : `${name} holds`} ${told}.`);
  if (PAGE.map.windows.some(w => w.forbidden)) notes.push("What is forbidden at the time of the slider is dark, with a dashed outline.");
  if (PAGE.planned) notes.push("The line is the expected path of the plan, which has no failure rate.");
  if (PAGE.tree) notes.push(branchNote(PAGE.tree));
  if (PAGE.trees.length) notes.push("Grey lines: the oldest branches of the search trees, as far as they came.");
  return notes.join(" ");
}

/** The time and the state of the flight in words. */
function momentText(view) {
  const k = shown.step, { failed, runs, law } = view.risk, count = failed.reduce((sum, cause) => sum + cause[k], 0);
  const [after, , ...more] = stepLines(map, view, k);
  return `Step ${k} of ${view.line.length - 1}, ${[after, ...more].join(", ")}; ${count} of ${runs} flights (${percent(count / runs)}) have failed so far under ${law} ${FLOWS}.`;
}
