// A map of one's own under the drawing: areas, lines and points, or an image, of a file in the folder.

import { ask } from "./api.js";
import { mercator } from "./geo.js";
import { pathOf, svg } from "./shapes.js";

const MOST_NAMES = 60;  // on the map at once

export class Backdrop {
  constructor(redraw) { Object.assign(this, { redraw, name: "", parts: [], box: null, image: null }); }

  /** Copy a file into the folder and show it; returns its name there. */
  async take(file) {
    const found = await ask("POST", `/api/backdrops?name=${encodeURIComponent(file.name)}`, file);
    this.hold(found);
    return found.name;
  }

  /** Show the file `name` of the folder; none if it is empty. */
  async show(name) {
    if (name === this.name) return;
    this.name = name;  // also while it is loaded
    const found = name ? await ask("GET", `/api/backdrops/${encodeURIComponent(name)}`) : { name, shapes: [], image: null };
    if (name === this.name) this.hold(found);
  }

  hold({ name, shapes, image }) {
    this.name = name;
    this.box = image && [[image.box[0], image.box[3]], [image.box[2], image.box[1]]];  // north-west, south-east
    this.image = image && svg("image", { class: "backdrop", href: image.href, preserveAspectRatio: "none" });
    this.parts = shapes.map(shape => {
      const plane = shape.lines.map(line => line.map(mercator)), xs = plane.flat().map(([x]) => x), ys = plane.flat().map(([, y]) => y), least = values => values.reduce((a, b) => Math.min(a, b)), most = values => values.reduce((a, b) => Math.max(a, b));
      return { ...shape, plane, box: [least(xs), most(xs), least(ys), most(ys)] };
    });
    this.redraw();
  }

  get places() { return this.box ?? this.parts.flatMap(part => part.lines.flat()); }

  /** The image where it lies now: one element, so that the browser decodes it once. */
  placed(at) {
    if (!this.image) return [];
    const [[x, y], [u, v]] = this.box.map(place => at(mercator(place)));
    for (const [name, value] of Object.entries({ x, y, width: u - x, height: v - y })) this.image.setAttribute(name, value.toFixed(1));
    return [this.image];
  }

  shapes(map) {
    const [w, h] = map.size, at = ([x, y]) => [(x - map.middle[0]) * map.scale + w / 2, (map.middle[1] - y) * map.scale + h / 2], drawn = { area: [], line: [], point: [] }, names = [];
    for (const part of this.parts) {
      const [west, south] = at([part.box[0], part.box[2]]), [east, north] = at([part.box[1], part.box[3]]);
      if (east < 0 || west > w || south < 0 || north > h) continue;
      for (const line of part.plane) {
        if (part.kind !== "point") drawn[part.kind].push(pathOf(line.map(at), part.kind === "area"));
        else for (const [x, y] of line.map(at)) drawn.point.push(`M${(x - 3).toFixed(1)} ${y.toFixed(1)}h6m-3 -3v6`);
      }
      if (part.name && names.length < MOST_NAMES && (part.kind === "point" || east - west > 40)) names.push(svg("text", { class: "placename", x: part.kind === "point" ? east + 6 : (west + east) / 2, y: (north + south) / 2 + 4, "text-anchor": part.kind === "point" ? "start" : "middle" }, part.name));
    }
    return [...this.placed(at), ...Object.entries(drawn).filter(([, lines]) => lines.length).map(([kind, lines]) => svg("path", { class: `backdrop ${kind}`, d: lines.join("") })), ...names];
  }
}
