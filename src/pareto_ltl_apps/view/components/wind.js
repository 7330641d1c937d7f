// The wind on the map: arrows of the expected wind, and shades of its standard deviation, at one time. The boxes
// layer-wind and layer-doubt of the page switch them.

import { byId, pathOf, speedTexts, svg } from "./shapes.js";

const LONGEST = 26;  // [pixels] of the arrow of the fastest wind

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

  arrows(map, uv) {
    const scale = LONGEST / Math.max(this.fastest, 1e-9);
    const lines = this.view.at.map((place, n) => {
      const [x, y] = map.at(place), [dx, dy] = [uv[n][0] * scale, -uv[n][1] * scale], tip = [x + dx / 2, y + dy / 2];
      const barb = side => [tip[0] - 0.32 * dx + side * 0.18 * dy, tip[1] - 0.32 * dy - side * 0.18 * dx];
      return pathOf([[x - dx / 2, y - dy / 2], tip]) + pathOf([barb(1), tip, barb(-1)]);
    });
    return svg("path", { class: "wind", d: lines.join("") });
  }

  /** A cell about each place of the lattice, the darker the less certain the wind is. */
  doubt(map, sd) {
    const [across, along] = this.view.shape, most = Math.max(...this.view.sd.flat(), 1e-9), spots = this.view.at.map(place => map.at(place));
    const half = (n, step, last) => { const [a, b] = last ? [n - step, n] : [n, n + step]; return spots[b] ? spots[b].map((value, axis) => (value - spots[a][axis]) / 2) : [LONGEST / 2, LONGEST / 2]; };
    return spots.map(([x, y], n) => {
      const [ex, ey] = across > 1 ? half(n, along, n >= along * (across - 1)) : [LONGEST / 2, 0], [nx, ny] = along > 1 ? half(n, 1, n % along === along - 1) : [0, LONGEST / 2];
      return svg("path", { class: "doubt", "fill-opacity": (0.75 * sd[n] / most).toFixed(3), d: pathOf([[-1, -1], [1, -1], [1, 1], [-1, 1]].map(([a, b]) => [x + a * ex + b * nx, y + a * ey + b * ny]), true) });
    });
  }

  /** Fastest expected wind and largest standard deviation [m/s] in words. */
  get legend() {
    if (!this.fastest) return "";
    const sds = this.view.sd.flat(), [fastest, least, most] = speedTexts(this.fastest, Math.min(...sds), Math.max(...sds));
    const parts = [byId("layer-wind").checked ? `longest arrow ${fastest} m/s` : "", byId("layer-doubt").checked ? `shade: uncertainty of the wind, ${least} to ${most} m/s (standard deviation)` : ""];
    return parts.filter(Boolean).join("; ");
  }
}
