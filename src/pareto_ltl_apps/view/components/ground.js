// The Earth below the grid of the map: land, lakes, borders and cities, as GET /api/ground and the page of a result have them.

import { mercator } from "./geo.js";
import { pathOf, svg } from "./shapes.js";

const LAYERS = ["land", "lakes", "islands", "states", "borders"], CLOSED = new Set(["land", "lakes", "islands"]);
const CITIES = 28;  // names on a map at once
const LETTER_WIDE = 6.2, LETTER_HIGH = 15;  // of a name [pixels]

export class GroundLayer {
  /** `view` has a box and lines of longitudes and latitudes; null: nothing is known, and nothing is drawn. */
  constructor(view = null) { this.hold(view); }

  hold(view) {
    this.view = view;
    this.lines = view ? LAYERS.map(layer => [layer, view[layer].map(line => line.map(mercator))]) : [];
    this.cities = (view?.cities ?? []).map(([name, ...place]) => ({ name, at: mercator(place) }));
    this.corners = view && [mercator([view.box[0], view.box[3]]), mercator([view.box[2], view.box[1]])];
  }

  /** Pixels of places of the Mercator plane, without tearing what lies across 180 degrees. */
  placing(map) {
    const [w, h] = map.size, middle = (this.corners[0][0] + this.corners[1][0]) / 2, turn = map.nearest(middle - map.middle[0]) - middle;
    return ([x, y]) => [(x + turn) * map.scale + w / 2, (map.middle[1] - y) * map.scale + h / 2];
  }

  /** Areas and lines, which lie below the grid of a map of the Earth. */
  shapes(map) {
    if (!this.view || !map.plane.around) return [];
    const at = this.placing(map), [[x, y], [right, low]] = this.corners.map(at);
    return [
      svg("rect", { class: "ground sea", x, y, width: right - x, height: low - y }),
      ...this.lines.map(([layer, lines]) => svg("path", { class: `ground ${layer}`, d: lines.map(line => pathOf(line.map(at), CLOSED.has(layer))).join("") })),
    ];
  }

  /** Names of the largest cities that have room. */
  names(map) {
    if (!this.view || !map.plane.around) return [];
    const at = this.placing(map), [w, h] = map.size, taken = [], shown = [];
    for (const { name, at: place } of this.cities) {
      const [x, y] = at(place), wide = LETTER_WIDE * name.length + 8;
      if (x < 44 || y < 8 || (x < 150 && y > h - 70) || x + wide > w || y > h - 8 || taken.some(([a, b, c]) => Math.abs(y - b) < LETTER_HIGH && x < a + c && a < x + wide)) continue;
      taken.push([x, y, wide]);
      shown.push(svg("circle", { class: "ground city", cx: x, cy: y, r: 2 }), svg("text", { class: "ground cityname", x: x + 5, y: y + 4 }, name));
      if (taken.length === CITIES) break;
    }
    return shown;
  }
}
