// The mission that is drawn: features with roles, what to do, vehicle and wind; kept by the server, with undo.

import { ask } from "./api.js";
import { circle, metresOf, nameOf } from "./geo.js";

const EMPTY = { features: [], pattern: "sequence", goals: [], avoid: [], formula: "", robot: "airframe", wind: "sample", windPath: "", departure: "", planner: "default", settings: "", backdrop: "", plan: null };
const MOST_UNDO = 100, PAUSE = 500;  // steps; [ms] before a change is sent

export const ROLES = {
  start: { label: "Start", one: true }, region: { label: "Region" }, obstacle: { label: "Obstacle" },
  landmark: { label: "Landmark" }, border: { label: "Border", one: true },
};

export class Store {
  /** `changed()` is called after every change; `failed(error)` if the server did not keep it; `state("changed")`, or `state("kept")` when the server has it. */
  constructor(changed, failed, state) {
    Object.assign(this, { changed, failed, state, mission: structuredClone(EMPTY), past: [], future: [], revision: 0, timer: null, stale: false, unsent: false, sending: null });
  }

  async load() {
    const { revision, mission } = await ask("GET", "/api/mission");
    this.revision = revision;
    if (mission) this.mission = { ...structuredClone(EMPTY), ...mission };
    this.state("kept");
  }

  /** Change the mission with `act`, so that it can be undone. */
  change(act) {
    this.past.push(JSON.stringify(this.mission));
    if (this.past.length > MOST_UNDO) this.past.shift();
    this.future = [];
    act(this.mission);
    this.keep();
  }

  /** Change it as a part of the change before, as a drag does at each move. */
  adjust(act) { act(this.mission); this.keep(); }

  undo() { this.turn(this.past, this.future); }
  redo() { this.turn(this.future, this.past); }

  turn(from, to) {
    if (!from.length) return;
    to.push(JSON.stringify(this.mission));
    this.mission = JSON.parse(from.pop());
    this.keep();
  }

  keep() {
    this.unsent = true;
    this.state("changed");
    this.changed();
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.send(), PAUSE);
  }

  /** Send the mission to the server; a second tab is told once that its changes are not kept. */
  async send() {
    clearTimeout(this.timer);
    if (this.sending) await this.sending;
    if (this.stale || !this.unsent) return;
    this.unsent = false;
    this.sending = ask("PUT", "/api/mission", { revision: this.revision, mission: this.mission })
      .then(({ revision }) => { this.revision = revision; if (!this.unsent) this.state("kept"); })
      .catch(error => { this.stale = error.status === 409; this.failed(error); })
      .finally(() => { this.sending = null; });
    await this.sending;
  }

  // --- features ---------------------------------------------------------------------------------

  get names() { return new Set(this.mission.features.filter(one => one.role === "region").map(one => one.name)); }

  /** The title of the region `name`. */
  titleOf(name) { return this.mission.features.find(one => one.role === "region" && one.name === name)?.title ?? name; }

  /** Add a drawn feature; a start or border replaces the one before. Returns its number. */
  add(role, shape, points, radius = "") {
    const title = role === "region" ? nameOf("", this.names) : "";
    this.change(mission => {
      if (ROLES[role].one) mission.features = mission.features.filter(one => one.role !== role);
      mission.features.push({ role, shape, points, title, name: title, buffer: radius, from: "", until: "", fix: "" });
      if (role === "region" && !mission.goals.includes(title)) mission.goals.push(title);
    });
    return this.mission.features.length - 1;
  }

  remove(number) {
    this.change(mission => {
      const [gone] = mission.features.splice(number, 1);
      for (const list of ["goals", "avoid"]) mission[list] = mission[list].filter(name => name !== gone.name || mission.features.some(one => one.name === gone.name));
    });
  }

  /** Give a region another title, and a name that formulas can have. */
  rename(number, title) {
    this.change(mission => {
      const one = mission.features[number], taken = new Set([...this.names].filter(name => name !== one.name)), before = one.name;
      one.title = title;
      if (one.role !== "region") return;
      one.name = nameOf(title, taken);
      for (const list of ["goals", "avoid"]) mission[list] = mission[list].map(name => name === before ? one.name : name);
      mission.formula = mission.formula.replace(new RegExp(`\\b${before}\\b`, "g"), one.name);
    });
  }

  // --- files ------------------------------------------------------------------------------------

  /** The map as the planner reads it. */
  geojson() {
    const features = [], regions = new Map();
    for (const feature of this.mission.features.map(toGeojson)) {
      const { role, name } = feature.properties, first = role === "region" ? regions.get(name) : undefined;
      if (first) first.geometry = { type: "GeometryCollection", geometries: [...first.geometry.geometries ?? [first.geometry], feature.geometry] };
      else { features.push(feature); regions.set(name, feature); }
    }
    return { type: "FeatureCollection", features };
  }

  /** The map with the mission, to be opened again. */
  saved() { return { ...this.geojson(), mission: Object.fromEntries(Object.entries(this.mission).filter(([key]) => !["features", "plan", "backdrop"].includes(key))) }; }

  /** Take the features and the mission of a map in their place; returns what could not be taken, in words. */
  open(map) {
    const features = [], taken = new Set();
    for (const feature of map.features ?? []) features.push(...fromGeojson(feature, taken));
    if (!features.length) throw new Error("the file has no features with a role: start, region, obstacle, landmark or border");
    const names = [...taken], told = map.mission && typeof map.mission === "object" ? map.mission : {};
    this.change(mission => {
      Object.assign(mission, structuredClone(EMPTY), { robot: mission.robot, wind: mission.wind, windPath: mission.windPath, planner: mission.planner, settings: mission.settings, departure: mission.departure, backdrop: mission.backdrop, features, goals: names });
      for (const key of Object.keys(EMPTY)) if (key !== "plan" && key !== "backdrop" && key !== "features" && typeof told[key] === typeof EMPTY[key]) mission[key] = told[key];
    });
    const left = (map.features ?? []).filter(feature => !ROLES[roleOf(feature)]).length, holes = (map.features ?? []).some(feature => rings(feature.geometry).some(part => part.length > 1));
    return [left ? `${left} features without a role were left out.` : "", holes ? "Holes of areas were left out: the desk draws outlines only." : ""].filter(Boolean).join(" ");
  }

  /** Add the features of a map; a start or border replaces the one before. Returns how many were added. */
  include(map) {
    const taken = this.names, features = (map.features ?? []).flatMap(feature => fromGeojson(feature, taken));
    if (!features.length) throw new Error("there is no feature to add: give a GeoJSON geometry, a Feature, or KML with a Placemark");
    this.change(mission => {
      const once = new Set(features.map(one => one.role).filter(role => ROLES[role].one));
      mission.features = [...mission.features.filter(one => !once.has(one.role)), ...features];
      for (const one of features) if (one.role === "region" && !mission.goals.includes(one.name)) mission.goals.push(one.name);
    });
    return features.length;
  }

  clear() { this.change(mission => Object.assign(mission, structuredClone(EMPTY))); }
}

/** A text of GeoJSON whose features have what the reader needs: a name for a region, a radius for points and lines. */
export function withRole(content, role, buffer) {
  if (typeof content !== "string") return content;
  let found;
  try { found = JSON.parse(content); } catch { return content; }  // KML, or a fault that the server names
  const list = found?.features ?? [found?.type === "Feature" ? found : { type: "Feature", properties: {}, geometry: found }];
  if (!Array.isArray(list)) return content;
  const features = list.map((one, number) => {
    const properties = { ...one?.properties }, stated = Object.keys(properties).map(key => key.trim().toLowerCase()), flat = /Point|LineString/.test(one?.geometry?.type ?? "");
    if ((roleOf(one) || role) === "region" && !stated.includes("name")) properties.name = `area ${number + 1}`;
    if (flat && buffer && (roleOf(one) || role) !== "start" && !stated.includes("buffer") && !stated.includes("radius")) properties.buffer = buffer;
    return { ...one, properties };
  });
  return JSON.stringify({ ...found?.features ? found : {}, type: "FeatureCollection", features });
}

/** The outline of a feature on the map [lon, lat]; circles have a radius. */
export function outline(one) {
  return one.shape === "circle" ? circle(one.points[0], metresOf(one.buffer) || 1) : one.points;
}

function toGeojson(one) {
  const properties = { role: one.role }, metres = metresOf(one.buffer || "0");
  if (one.role === "region") Object.assign(properties, { name: one.name });
  if (one.title && one.title !== one.name) properties[one.role === "region" ? "title" : "name"] = one.title;
  if (metres && one.role !== "start") properties.buffer = metres;
  for (const key of ["from", "until", "floor", "ceiling"]) if (one[key]) properties[key] = one[key];
  if (one.role === "landmark" && one.fix) properties.fix = fixOf(one.fix) ?? one.fix;
  const geometry = one.shape === "polygon" ? { type: "Polygon", coordinates: [[...one.points, one.points[0]]] }
    : one.shape === "line" ? { type: "LineString", coordinates: one.points } : { type: "Point", coordinates: one.points[0] };
  return { type: "Feature", properties, geometry };
}

const ERRORS = { sd: "", along: " along", across: " across" };  // of a position fix, as the desk writes them

/** The error of a position fix of "50 m" or "50 m across, 20 km along, 40°"; null for anything else. */
export function fixOf(text) {
  const found = {};
  for (const part of text.split(",").map(one => one.trim())) {
    const [, number, word] = /^(.*?)\s*(along|across|°)?$/i.exec(part), key = { along: "along", across: "across", "°": "bearing", "": "sd" }[(word ?? "").toLowerCase()];
    const value = key === "bearing" ? Number(number || NaN) : metresOf(number);
    if (key in found || !(key === "bearing" ? Math.abs(value) <= 360 : value > 0)) return null;
    found[key] = value;
  }
  const both = "along" in found && "across" in found;
  return "sd" in found !== both && ("sd" in found || both) ? found : null;
}

/** A fix of a map file as :func:`fixOf` reads it; what it cannot read stays as it is, and the planner says what is wrong. */
function fixText(given) {
  let fix = given;
  try { fix = typeof given === "string" ? JSON.parse(given || "null") : given ?? null; } catch { return given; }
  if (!fix || typeof fix !== "object") return "";
  return [...Object.entries(ERRORS).filter(([key]) => key in fix).map(([key, word]) => `${fix[key]} m${word}`), ..."bearing" in fix ? [`${fix.bearing}°`] : []].join(", ");
}

function roleOf(feature) {
  const [, given] = Object.entries(feature?.properties ?? {}).find(([key]) => key.trim().toLowerCase() === "role") ?? [], said = String(given ?? "").trim().toLowerCase();
  return said === "bounds" ? "border" : said;
}

/** The rings of each polygon of a geometry. */
const rings = geometry => geometry?.type === "Polygon" ? [geometry.coordinates] : geometry?.type === "MultiPolygon" ? geometry.coordinates : (geometry?.geometries ?? []).flatMap(rings);

function fromGeojson(feature, taken) {
  const given = Object.fromEntries(Object.entries(feature?.properties ?? {}).map(([key, value]) => [key.trim().toLowerCase(), value])), role = roleOf(feature);
  if (!ROLES[role]) return [];
  const title = String(given.title ?? given.name ?? ""), text = key => String(given[key] ?? "");
  const metres = given.buffer ?? given.radius, base = { role, title, name: "", buffer: metres === undefined || metres === null || metres === "" ? "" : Number.isNaN(Number(metres)) ? String(metres) : `${metres} m`, from: text("from"), until: text("until"), floor: text("floor"), ceiling: text("ceiling"), fix: role === "landmark" ? fixText(given.fix) : "" };
  if (role === "region") {
    base.name = /^[a-z_][a-z0-9_]*$/.test(text("name")) && !taken.has(text("name")) ? text("name") : nameOf(title, taken);
    base.title ||= base.name;
    taken.add(base.name);
  }
  return shapes(feature.geometry).map(shape => ({ ...base, ...shape }));
}

/** Shapes of a geometry; holes are left out, and the parts of a region share its name. */
function shapes(geometry) {
  const flat = corners => corners.map(([lon, lat]) => [lon, lat]), ring = corners => {
    const found = flat(corners), [a, b] = [found[0], found.at(-1)];
    return { shape: "polygon", points: found.length > 1 && a[0] === b[0] && a[1] === b[1] ? found.slice(0, -1) : found };
  };
  const kinds = {
    Point: c => [{ shape: "circle", points: flat([c]) }], MultiPoint: c => c.map(one => ({ shape: "circle", points: flat([one]) })),
    LineString: c => [{ shape: "line", points: flat(c) }], MultiLineString: c => c.map(one => ({ shape: "line", points: flat(one) })),
    Polygon: c => [ring(c[0])], MultiPolygon: c => c.map(one => ring(one[0])),
  };
  if (geometry?.type === "GeometryCollection") return (geometry.geometries ?? []).flatMap(shapes);
  return kinds[geometry?.type]?.(geometry.coordinates) ?? [];
}

const XML_SIGNS = { "&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;" };
const xml = text => String(text).replace(/[^\t\n\r\x20-\ud7ff\ue000-\ufffd\u{10000}-\u{10ffff}]/gu, "?").replace(/[&<>"]/g, sign => XML_SIGNS[sign]);

/** The map as KML, with roles that the planner reads. */
export function kml(collection) {
  const corner = ([lon, lat]) => `${lon},${lat}`, places = collection.features.map(({ properties, geometry }) => {
    const data = Object.entries(properties).map(([key, value]) => `<Data name="${xml(key)}"><value>${xml(typeof value === "object" ? JSON.stringify(value) : value)}</value></Data>`).join("");
    const shape = geometry.type === "Polygon" ? `<Polygon><outerBoundaryIs><LinearRing><coordinates>${geometry.coordinates[0].map(corner).join(" ")}</coordinates></LinearRing></outerBoundaryIs></Polygon>`
      : `<${geometry.type}><coordinates>${(geometry.type === "Point" ? [geometry.coordinates] : geometry.coordinates).map(corner).join(" ")}</coordinates></${geometry.type}>`;
    return `<Placemark><name>${xml(properties.title ?? properties.name ?? properties.role)}</name><ExtendedData>${data}</ExtendedData>${shape}</Placemark>`;
  });
  return `<?xml version="1.0" encoding="UTF-8"?>\n<kml xmlns="http://www.opengis.net/kml/2.2"><Document>\n${places.join("\n")}\n</Document></kml>\n`;
}
