// Coasts, borders and cities below the map, loaded from the server for what is shown, and the search for a place.

import { ask } from "./api.js";
import { mercator, placeOf } from "./geo.js";
import { GroundLayer } from "./ground.js";
import { byId, html } from "./shapes.js";

const WIDER = 0.6;  // of the view, on each side, that is loaded beyond it
const FINER = 2.2;  // times nearer than the map that was loaded for: it is loaded again
const PAUSE = 120;  // [ms] after the last move
const NEAR = 9000;  // pixels for a unit of the map at a place that was found: about 500 km

export class Earth {
  /** `failed(error)` shows an error. */
  constructor(map, failed) {
    Object.assign(this, { map, failed, layer: new GroundLayer(), box: null, scale: 0, timer: null, found: [], asked: "" });
    byId("go").addEventListener("input", () => this.find().catch(failed));
    byId("go-form").addEventListener("submit", event => { event.preventDefault(); this.go().catch(failed); });
  }

  shapes() {
    const [w, h] = this.map.size, [west, north] = this.map.place([0, 0]), [east, south] = this.map.place([w, h]);
    if (!this.holds(west, south, east, north)) { clearTimeout(this.timer); this.timer = setTimeout(() => this.load(west, south, east, north).catch(this.failed), this.box ? PAUSE : 0); }
    return this.layer.shapes(this.map);
  }

  holds(west, south, east, north) {
    if (!this.box || this.map.scale > FINER * this.scale || this.map.scale < this.scale / FINER) return false;
    if (this.box[2] - this.box[0] > 359.9) return true;
    const turn = 360 * Math.round((this.box[0] + this.box[2] - west - east) / 720);
    return this.box[0] <= west + turn && this.box[2] >= east + turn && this.box[1] <= Math.max(south, -85) && this.box[3] >= Math.min(north, 85);
  }

  async load(west, south, east, north) {
    const middle = (west + east) / 2, reach = Math.min(180, (0.5 + WIDER) * (east - west)), dy = WIDER * (north - south), { scale } = this.map;
    const box = reach < 180 ? [middle - reach, Math.max(-89, south - dy), middle + reach, Math.min(89, north + dy)] : [middle - 180, -89, middle + 180, 89];
    const ground = await ask("GET", `/api/ground?box=${box.map(edge => edge.toFixed(4)).join(",")}&pixels=${Math.round(this.map.size[0] * (1 + 2 * WIDER))}`);
    Object.assign(this, { box, scale });
    this.layer.hold(ground);
    this.map.refresh();
  }

  // --- search -------------------------------------------------------------------------------------

  async find() {
    const text = byId("go").value.trim();
    this.asked = text;
    if (text.length < 2 || placeOf(text)) return;
    const { places } = await ask("GET", `/api/places?find=${encodeURIComponent(text)}`);
    if (text !== this.asked) return;
    this.found = places;
    byId("places").replaceChildren(...places.map(([name]) => html("option", { value: name })));
    const chosen = places.filter(([name]) => name === text);
    if (chosen.length === 1 && places.length === 1) this.show(chosen[0].slice(1));
  }

  /** Go to the coordinates or to the largest city that is typed. */
  async go() {
    const text = byId("go").value.trim(), place = placeOf(text);
    if (!text) return;
    if (place) { this.show(place); return; }
    const { places: [first] } = await ask("GET", `/api/places?find=${encodeURIComponent(text)}`);
    if (!first) throw new Error(`no city has the name ${text}: type a larger one near it, or coordinates such as 41°28′S 72°56′W`);
    this.show(first.slice(1));
  }

  show(place) {
    Object.assign(this.map, { middle: mercator(place), scale: Math.max(this.map.scale, NEAR) });
    this.map.refresh();
  }
}
