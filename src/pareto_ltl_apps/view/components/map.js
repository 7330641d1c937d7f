// The map: a view of the Mercator plane, or of a plane in metres, in SVG, with a grid and a scale; layers draw on it.

import { EARTHLY } from "./geo.js";
import { pathOf, svg } from "./shapes.js";

const GAP = 84;  // least distance of its lines [pixels]
const FOOT = 56;  // [pixels] of its scale, below what is shown
const DRAG = 5;  // [pixels] beyond which a press is no click

/** Least and largest of many numbers. */
const extent = values => values.reduce(([low, high], value) => [Math.min(low, value), Math.max(high, value)], [Infinity, -Infinity]);

export class ChartMap {
  /** `draw(map)` draws the layers of the page after the grid; `heard` has press, drag, dropped, move and click.
   *  In a page that `scrolls`, the wheel zooms with the Ctrl key only; `under(map)` draws below the grid. */
  constructor(root, draw, heard, { plane = EARTHLY, scrolls = false, under = () => [] } = {}) {
    Object.assign(this, { root, draw, heard, plane, scrolls, under, middle: plane.to([0, 0]), scale: plane.scales[0], pointers: new Map(), pressed: null, waiting: false });
    this.floor = svg("g");
    this.ground = svg("g");
    this.layers = svg("g");
    this.frame = svg("g", { class: "frame" });
    root.append(this.floor, this.ground, this.layers, this.frame);
    new ResizeObserver(() => this.refresh()).observe(root);
    this.listen();
  }

  get size() { return [this.root.clientWidth || 600, this.root.clientHeight || 400]; }

  /** Pixels of a place: [lon, lat] on the Earth, [x, y] in metres in a plane; the nearest turn round the Earth. */
  at(place) {
    const [x, y] = this.plane.to(place), [w, h] = this.size;
    return [this.nearest(x - this.middle[0]) * this.scale + w / 2, (this.middle[1] - y) * this.scale + h / 2];
  }

  /** A difference in x without whole turns round the Earth. */
  nearest(x) { return this.plane.around ? x - this.plane.around * Math.round(x / this.plane.around) : x; }

  /** The place at pixels. */
  place([px, py]) {
    const [w, h] = this.size;
    return this.plane.from([(px - w / 2) / this.scale + this.middle[0], this.middle[1] - (py - h / 2) / this.scale]);
  }

  line(places, close = false) { return pathOf(places.map(place => this.at(place)), close); }

  /** Show all of `places`, with a margin. */
  fit(places) {
    if (!places.length) return;
    const plane = places.map(this.plane.to), first = plane[0][0], [w, h] = this.size;
    const [west, east] = extent(plane.map(([x]) => first + this.nearest(x - first))), [south, north] = extent(plane.map(([, y]) => y));
    this.scale = this.limited(0.86 * Math.min(w / Math.max(east - west, 1e-6), (h - FOOT) / Math.max(north - south, 1e-6)));
    this.middle = [(west + east) / 2, (south + north) / 2 - FOOT / 2 / this.scale];
    this.refresh();
  }

  limited(scale) { return Math.max(this.plane.scales[0], Math.min(this.plane.scales[1], scale)); }

  /** Zoom by a factor and keep the place under `spot` where it is. */
  zoom(factor, spot = this.size.map(length => length / 2)) {
    const [w, h] = this.size, scale = this.limited(this.scale * factor), share = 1 / this.scale - 1 / scale;
    this.middle = [this.middle[0] + (spot[0] - w / 2) * share, this.middle[1] - (spot[1] - h / 2) * share];
    this.scale = scale;
    this.refresh();
  }

  move(dx, dy) {
    const y = this.middle[1] + dy / this.scale;
    this.middle = [this.middle[0] - dx / this.scale, this.plane.around ? Math.max(-3.1, Math.min(3.1, y)) : y];
    this.refresh();
  }

  /** Draw again before the next frame. */
  refresh() {
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => this.drawNow());
  }

  drawNow() {
    this.waiting = false;
    const [w, h] = this.size;
    this.root.setAttribute("viewBox", `0 0 ${w} ${h}`);
    this.floor.replaceChildren(...this.under(this));
    this.grid();
    this.layers.replaceChildren(...this.draw(this));
  }

  grid() {
    const [w, h] = this.size, [west, north] = this.place([0, 0]), [east, south] = this.place([w, h]), { plane } = this;
    const step = plane.step(GAP / this.scale), lines = [], texts = [];
    for (let k = Math.ceil(west / step); k * step <= east && lines.length < 99; k++) {
      const x = (plane.to([k * step, 0])[0] - this.middle[0]) * this.scale + w / 2;
      lines.push([[x, 0], [x, h]]);
      if (x > 70 && x < w - 30) texts.push(svg("text", { x, y: h - 6, "text-anchor": "middle" }, plane.label(k * step, 0, step)));
    }
    for (let k = Math.ceil(south / step); k * step <= north && lines.length < 199; k++) {
      const [, y] = this.at([0, k * step]);
      lines.push([[0, y], [w, y]]);
      if (y > 14 && y < h - 62) texts.push(svg("text", { x: 6, y: y - 4 }, plane.label(k * step, 1, step)));
    }
    this.ground.replaceChildren(svg("path", { class: "graticule", d: lines.map(line => pathOf(line)).join("") }));
    this.frame.replaceChildren(...texts, this.scaleBar(w, h));
  }

  /** Bars of a round number of kilometres and of nautical miles, true at the middle of the map. */
  scaleBar(w, h) {
    const across = this.plane.distance(this.place([w / 2 - 50, h / 2]), this.place([w / 2 + 50, h / 2])) / 100, bar = svg("g", { class: "scale" });
    [["km", 1000], ["nmi", 1852]].forEach(([unit, metres], row) => {
      const most = 110 * across / metres, power = 10 ** Math.floor(Math.log10(most)), round = power * [5, 2, 1].find(m => m * power <= most);
      const length = round * metres / across, y = h - 44 + 15 * row;
      bar.append(svg("path", { d: `M10 ${y - 4}V${y}H${(10 + length).toFixed(1)}V${y - 4}` }), svg("text", { x: 15 + length, y: y + 1 }, `${+round.toPrecision(2)} ${unit}`));
    });
    return bar;
  }

  // --- pointers ---------------------------------------------------------------------------------

  spot(event) {
    const box = this.root.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  }

  listen() {
    const on = (kind, act) => this.root.addEventListener(kind, act);
    on("pointerdown", event => this.down(event));
    on("pointermove", event => this.moved(event));
    on("pointerup", event => this.up(event));
    on("pointercancel", event => this.up(event));
    on("wheel", event => { if (this.scrolls && !event.ctrlKey) return; event.preventDefault(); this.zoom(Math.exp(-event.deltaY * (event.deltaMode ? 0.05 : 0.0016)), this.spot(event)); });
    on("keydown", event => {
      const moves = { ArrowLeft: [60, 0], ArrowRight: [-60, 0], ArrowUp: [0, 60], ArrowDown: [0, -60] };
      if (moves[event.key]) { event.preventDefault(); this.move(...moves[event.key]); }
      if (event.key === "+" || event.key === "=") this.zoom(1.4);
      if (event.key === "-") this.zoom(1 / 1.4);
    });
  }

  down(event) {
    if (event.button > 0) return;
    this.pointers.set(event.pointerId, this.spot(event));
    try { this.root.setPointerCapture(event.pointerId); } catch { /* the pointer has left */ }
    if (this.pointers.size > 1) { this.pressed = null; return; }
    const spot = this.spot(event);
    this.pressed = { from: spot, last: spot, far: false, target: event.target, held: this.heard.press(this.place(spot), event.target) };
  }

  moved(event) {
    const spot = this.spot(event), before = this.pointers.get(event.pointerId);
    if (before && this.pointers.size === 2) {
      const [other] = [...this.pointers].filter(([id]) => id !== event.pointerId).map(([, at]) => at);
      const span = at => Math.hypot(at[0] - other[0], at[1] - other[1]);
      this.move((spot[0] - before[0]) / 2, (spot[1] - before[1]) / 2);
      this.zoom(span(spot) / Math.max(1, span(before)), [(spot[0] + other[0]) / 2, (spot[1] + other[1]) / 2]);
    }
    if (before) this.pointers.set(event.pointerId, spot);
    this.heard.move(this.place(spot));
    const pressed = this.pressed;
    if (!pressed) return;
    pressed.far ||= Math.hypot(spot[0] - pressed.from[0], spot[1] - pressed.from[1]) > DRAG;
    if (!pressed.far) return;
    if (pressed.held) this.heard.drag(pressed.held, this.place(spot), this.place(pressed.last));
    else this.move(spot[0] - pressed.last[0], spot[1] - pressed.last[1]);
    pressed.last = spot;
  }

  up(event) {
    this.pointers.delete(event.pointerId);
    const pressed = this.pressed;
    this.pressed = null;
    if (!pressed) return;
    if (pressed.far) { if (pressed.held) this.heard.dropped(pressed.held); }
    else if (event.type === "pointerup") this.heard.click(this.place(pressed.from), pressed.target);
  }
}
