// The wind on the map: barbs of the expected wind, and shades of its standard deviation, at one time. The boxes
// layer-wind and layer-doubt of the page switch them.

import { roundAbove } from "./geo.js";
import { byId, html, pathOf, speedTexts, svg } from "./shapes.js";

const LONGEST = 26;  // [pixels] of the arrow of the fastest current, and of a barb's shaft
const COLOURS = [0, 1, 2, 3, 4];  // of speeds, in the style sheet
const SLOW = 2.5;  // [m/s] below which barbs of 5 kt say nothing
export const KT = 1852 / 3600;  // [m/s]

/** An arrow about pixels x, y along (dx, dy). */
export function arrow(x, y, dx, dy) {
  const tip = [x + dx / 2, y + dy / 2], side = one => [tip[0] - 0.32 * dx + one * 0.18 * dy, tip[1] - 0.32 * dy - one * 0.18 * dx];
  return pathOf([[x - dx / 2, y - dy / 2], tip]) + pathOf([side(1), tip, side(-1)]);
}

/** A barb at pixels x, y for a wind toward (dx, dy), a direction, with a speed [m/s]; its shaft is `scale` times LONGEST, and south of the
 *  equator its `side` is -1. */
export function barb(x, y, dx, dy, speed, scale, side) {
  let left = Math.round(speed / KT / 5) * 5;
  if (left === 0) return `M${(x - 3).toFixed(1)} ${y.toFixed(1)}a3 3 0 1 0 6 0a3 3 0 1 0 -6 0`;
  const size = Math.hypot(dx, dy) / scale, [u, v] = [-dx / size, -dy / size], at = (along, across) => [x + along * u - side * across * v, y + along * v + side * across * u], parts = [pathOf([at(0, 0), at(LONGEST, 0)])];
  let along = LONGEST;
  if (left === 5) along -= 5;  // a single short barb is not at the end
  for (; left >= 50; left -= 50, along -= 6) parts.push(pathOf([at(along, 0), at(along - 2, 9), at(along - 5, 0)], true));
  for (; left >= 10; left -= 10, along -= 4.5) parts.push(pathOf([at(along, 0), at(along + 3, 10)]));
  if (left === 5) parts.push(pathOf([at(along, 0), at(along + 1.5, 5)]));
  return parts.join("");
}

/** Speed [m/s] of a vector to east and north, where it comes from and where it sets to [deg]. */
export const flowOf = ([u, v]) => ({ speed: Math.hypot(u, v), from: (Math.atan2(-u, -v) * 180 / Math.PI + 360) % 360, to: (Math.atan2(u, v) * 180 / Math.PI + 360) % 360 });

export class WindLayer {
  /** `view` has the wind at some times `t` [s] and places `at`: `uv`, `sd` [m/s]; null: no wind. */
  constructor(view = null) { Object.assign(this, { view, fastest: Math.max(...view?.uv.flat().map(([u, v]) => Math.hypot(u, v)) ?? [], 0) }); }

  /** Shapes of the time [s after departure]. */
  shapes(map, seconds) {
    const { view } = this;
    if (!view?.at.length) return [];
    const { t } = view, k = Math.max(0, Math.min(t.length - 2, t.findLastIndex(one => one <= seconds))), share = t.length > 1 ? Math.max(0, Math.min(1, (seconds - t[k]) / (t[k + 1] - t[k]))) : 0;
    const between = (before, after) => share ? (1 - share) * before + share * after : before;
    return [...byId("layer-doubt").checked ? this.doubt(map, view.sd[k].map((one, n) => between(one, view.sd[k + 1]?.[n]))) : [], ...byId("layer-wind").checked ? [this.arrows(map, view.uv[k].map((one, n) => one.map((value, axis) => between(value, view.uv[k + 1]?.[n][axis]))))] : []];
  }

  /** Barbs of the expected wind: the shaft comes from where the wind blows, a long barb is 10 kt, a short one 5 kt, a flag
   *  50 kt; the colour is the speed. Slow currents are arrows, as long as they are fast. */
  arrows(map, uv) {
    const slow = this.fastest < SLOW, made = COLOURS.map(() => []), scale = LONGEST / Math.max(this.fastest, 1e-9), spots = this.view.at.map(place => map.at(place));
    const gap = spots.length > 1 ? Math.hypot(spots[1][0] - spots[0][0], spots[1][1] - spots[0][1]) : LONGEST, size = Math.max(0.4, Math.min(1, 0.8 * gap / LONGEST));
    spots.forEach(([x, y], n) => {
      const [u, v] = uv[n], speed = Math.hypot(u, v), colour = Math.min(COLOURS.length - 1, Math.floor(COLOURS.length * speed / this.top));
      made[colour].push(slow ? arrow(x, y, u * scale * size, -v * scale * size) : barb(x, y, u, -v, speed, size, map.plane.around && this.view.at[n][1] < 0 ? -1 : 1));
    });
    return svg("g", { class: "wind" }, ...made.map((lines, k) => svg("path", { class: `speed speed-${k}`, d: lines.join("") })));
  }

  /** The speed [m/s] at the end of the colours, a round number. */
  get top() { return roundAbove(Math.max(this.fastest, 1e-9)); }

  /** The number of the node of the lattice nearest to a place; null if there is none near it. */
  node(place) {
    const { view } = this;
    if (!view?.at.length) return null;
    const away = view.at.map(([lon, lat]) => Math.hypot(((lon - place[0] + 540) % 360 - 180) * Math.cos(lat * Math.PI / 180), lat - place[1])), n = away.indexOf(Math.min(...away));
    const gap = view.at.length > 1 ? Math.hypot(view.at[1][0] - view.at[0][0], view.at[1][1] - view.at[0][1]) : 1;
    return away[n] > 2 * gap ? null : n;
  }

  /** Whether it is a current. */
  get water() { return String(this.view?.level ?? "").endsWith("depth"); }

  /** The expected wind at the node nearest to a place: speed [m/s], where it comes from and sets to [deg], sd [m/s]; or null. */
  near(place, seconds) {
    const { view } = this, n = this.node(place);
    if (n === null) return null;
    const k = Math.max(0, view.t.findLastIndex(one => one <= seconds));
    return { ...flowOf(view.uv[k][n]), sd: view.sd[k][n], water: this.water };
  }

  /** A cell about each place of the lattice, the darker the less certain the wind is. */
  doubt(map, sd) {
    const [across, along] = this.view.shape, most = Math.max(...this.view.sd.flat(), 1e-9), spots = this.view.at.map(place => map.at(place));
    const half = (n, step, last) => { const [a, b] = last ? [n - step, n] : [n, n + step]; return spots[b] ? spots[b].map((value, axis) => (value - spots[a][axis]) / 2) : [LONGEST / 2, LONGEST / 2]; };
    const cells = spots.map(([x, y], n) => {
      const [ex, ey] = across > 1 ? half(n, along, n >= along * (across - 1)) : [LONGEST / 2, 0], [nx, ny] = along > 1 ? half(n, 1, n % along === along - 1) : [0, LONGEST / 2], shade = `color-mix(in srgb, var(--doubt) ${(100 * sd[n] / most).toFixed(0)}%, var(--paper))`;
      return svg("path", { fill: shade, stroke: shade, d: pathOf([[-1, -1], [1, -1], [1, 1], [-1, 1]].map(([a, b]) => [x + a * ex + b * nx, y + a * ey + b * ny]), true) });
    });
    return [svg("g", { class: "doubt" }, ...cells)];  // opaque cells in a group that is not: no seams
  }

  /** What the colours and shades mean, as elements. */
  legends() {
    if (!this.fastest) return [];
    const sds = this.view.sd.flat(), [least, most] = speedTexts(Math.min(...sds), Math.max(...sds)), { top } = this, ends = COLOURS.map(k => +(top * (k + 1) / COLOURS.length).toPrecision(3));
    const keys = COLOURS.map(k => html("span", { class: `key speed-${k}`, title: `${k ? ends[k - 1] : 0} to ${ends[k]} m/s` })), slow = this.fastest < SLOW;
    return [
      ...byId("layer-wind").checked ? [html("span", { class: "speeds" }, "0", ...keys, `${top} m/s (${(top / KT).toFixed(slow ? 1 : 0)} kt)${slow ? "" : "; long barb 10 kt, short 5 kt"}`)] : [],
      ...byId("layer-doubt").checked ? [html("span", { class: "speeds" }, `uncertainty ${least}`, html("span", { class: "key doubts" }), `${most} m/s`)] : [],
    ];
  }

  /** The same in words. */
  get legend() {
    if (!this.fastest) return "";
    const sds = this.view.sd.flat(), [fastest, least, most] = speedTexts(this.fastest, Math.min(...sds), Math.max(...sds));
    const parts = [byId("layer-wind").checked ? `up to ${fastest} m/s (${(this.fastest / KT).toFixed(this.fastest < SLOW ? 1 : 0)} kt)${this.fastest < SLOW ? "" : ", long barb 10 kt, short barb 5 kt"}` : "", byId("layer-doubt").checked ? `shade: uncertainty of the wind, ${least} to ${most} m/s (standard deviation)` : ""];
    return parts.filter(Boolean).join("; ");
  }
}
