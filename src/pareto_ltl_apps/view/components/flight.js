// A path and its flights on the map: expected path, ellipses that hold 95 % of positions, simulated flights.

import { centre, ellipseAround } from "./geo.js";
import { duration, pathOf, speedTexts, svg } from "./shapes.js";

const ELLIPSES = 14;  // at most, along a path

/** The ellipse of 95 % of the positions at a step of a path. */
export const ellipse = (map, view, step, kind = "") => svg("path", { class: `ellipse ${kind}`, d: map.line(ellipseAround(map.plane, view.line[step], view.spread[step]), true) });

/** Ellipses at some steps, the last one first. */
export function ellipses(map, view) {
  const last = view.line.length - 1, stride = Math.max(1, Math.ceil(last / ELLIPSES)), shown = [];
  for (let k = last; k > 0; k -= stride) shown.push(ellipse(map, view, k));
  return shown;
}

export const track = (map, line, kind = "") => svg("path", { class: `track ${kind}`, d: map.line(line) });

/** The expected end, and the vehicle at the step that is shown, which says `text`. */
export function vehicle(map, view, step, text) {
  const [ex, ey] = map.at(view.line.at(-1)), [cx, cy] = map.at(view.line[step]);
  return [svg("rect", { class: "end", x: ex - 5, y: ey - 5, width: 10, height: 10 }, svg("title", {}, "expected end")), svg("circle", { class: "vehicle", cx, cy, r: 7 }, svg("title", {}, text))];
}

const CLEAR = 40;  // [pixels] of a path, from which a name is not moved away

/** Where the name of an outline stands: in its middle, or towards a corner if the path `line` is clearly farther there [pixels]. */
export function nameSpot(corners, line) {
  const gap = ([x, y]) => line.reduce((least, [a, b]) => Math.min(least, Math.hypot(a - x, b - y)), CLEAR);
  const middle = centre(corners), tried = [middle, ...corners.map(([x, y]) => [0.55 * middle[0] + 0.45 * x, 0.55 * middle[1] + 0.45 * y])];
  return tried.reduce((best, spot) => gap(spot) > 1.2 * gap(best) ? spot : best);
}

const CROSS = 4;  // half of the sign of a failed flight [pixels]

/** Simulated flights {at, failed, why} up to a step; those that have failed by then are marked. */
export function flown(map, { at, failed, why }, step) {
  const ends = [], trails = [[], []];
  at.forEach((line, k) => {
    const lost = failed[k] >= 0 && failed[k] <= step, [cx, cy] = map.at(line[Math.min(step, line.length - 1)]);
    trails[+lost].push(map.line(line.slice(0, step + 1)));
    ends.push(lost ? svg("path", { class: "flight lost", d: pathOf([[cx - CROSS, cy - CROSS], [cx + CROSS, cy + CROSS]]) + pathOf([[cx - CROSS, cy + CROSS], [cx + CROSS, cy - CROSS]]) }, svg("title", {}, `this flight ${why[k]}`)) : svg("circle", { class: "flight", cx, cy, r: 2.2 }));
  });
  return [...trails.map((lines, lost) => svg("path", { class: lost ? "trail lost" : "trail", d: lines.join("") })), ...ends];
}

/** Time, place, steering and wind of a step, in lines. */
export function stepLines(map, view, step) {
  const { log } = view, lines = [`${duration(view.t[step])} after departure`, map.plane.text(view.line[step])];
  if (view.label[step].length) lines.push(`in ${view.label[step].join(", ")}`);
  if (view.fixes.includes(step)) lines.push("position fix");
  if (!log || step >= log.airspeed.length) return lines;
  const held = log.calibrated?.[step] ?? null;  // none in the water
  const [air, wind, sd, calibrated] = speedTexts(log.airspeed[step], log.wind_speed[step], log.wind_sd[step], held ?? 0);
  const speed = held === null ? `${air} m/s` : `true airspeed ${air} m/s, calibrated ${calibrated} m/s`;
  lines.push(`${log.heading[step] === null ? "drifts" : `heading ${log.heading[step].toFixed(0)}° true`}, ${speed}`, `${held === null ? `current ${wind} m/s sets to ${((log.wind_from[step] + 180) % 360).toFixed(0)}°` : `wind ${wind} m/s from ${log.wind_from[step].toFixed(0)}°`} (standard deviation ${sd} m/s)`);
  return lines;
}
