// Files of the point that is shown, for navigators, maps and autopilots, made from the numbers of the page. They
// are the files of `pareto-ltl export`, without corridors and without the failure rate of flights by position.

import { byId, html } from "./shapes.js";

const XML_SIGNS = { "&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;" };
// Characters that XML 1.0 cannot hold become question marks.
const xml = text => String(text).replace(/[^\t\n\r\x20-\ud7ff\ue000-\ufffd\u{10000}-\u{10ffff}]/gu, "?").replace(/[&<>"]/g, sign => XML_SIGNS[sign]);

const FILES = [
  { name: "dead_reckoning.csv", kind: "text/csv", make: deadReckoning },
  { name: "plan.geojson", kind: "application/geo+json", make: planGeojson, outlined: true },
  { name: "plan.kml", kind: "application/vnd.google-earth.kml+xml", make: planKml, outlined: true },
  { name: "plan.gpx", kind: "application/gpx+xml", make: planGpx },
  { name: "mission.plan", kind: "application/json", make: missionPlan, outlined: true },
];

/** The note in every file: the mission, its failure rate and wind law, and what is not covered. */
function fileNote() {
  const row = PAGE.points[shown.point], told = [`Point ${shown.point} of the front of ${PAGE.name}.`, `Mission ${PAGE.formula}.`];
  const rate = shown.point === PAGE.chosen && PAGE.promise ? { ...PAGE.promise, failure_low: PAGE.promise.low, failure_high: PAGE.promise.high } : row;
  told.push(rateSentence(rate));
  told.push("An autopilot that flies by position fails at another rate; pareto-ltl export computes it.");
  told.push(PAGE.height.sentence);
  if (PAGE.notCovered) told.push(`Not covered: ${PAGE.notCovered.replace(/\.$/, "")}.`);
  return told.join(" ");
}

/** The failure rate in the words of exports/exported.py, or the bound on it. */
function rateSentence({ failure, failure_low: low, failure_high: high, law, runs, method }) {
  if (low === null) return `Flown by heading and airspeed in ${law} winds it fails with at most ${percent(failure)} (bound).`;
  const sample = `${runs.toLocaleString("en")} ${method === "weighted" ? "weighted " : ""}flights`;
  return `Of ${sample} flown by heading and airspeed in ${law} winds, ${percent(failure)} (95 %: ${percent(low).replace(" %", "")} to ${percent(high)}) fail.`;
}

const CSV_COLUMNS = [
  ["heading_true_deg", "heading"], ["airspeed_tas_m_s", "airspeed"], ["airspeed_cas_m_s", "calibrated"], ["duration_s", null], ["wind_m_s", "wind_speed"], ["wind_from_deg", "wind_from"],
  ["wind_sd_m_s", "wind_sd"], ["track_true_deg", "track"], ["ground_speed_m_s", "ground_speed"], ["distance_m", "distance"], ["lat_deg", "lat"], ["lon_deg", "lon"],
  ["radius_95_m", "radius"], ["ellipse_major_m", "major"], ["ellipse_minor_m", "minor"], ["ellipse_azimuth_deg", "azimuth"],
];

function deadReckoning(way) {
  const lines = [["leg", "time_utc", "t_s", ...CSV_COLUMNS.map(column => column[0]), "fix", "wind_law"].join()];
  way.t.forEach((t, k) => {
    const cells = CSV_COLUMNS.map(([, key]) => key ? way.log[key][k] ?? "" : k + 1 < way.t.length ? way.t[k + 1] - t : "");
    lines.push([k, way.utc ? way.utc[k] : "", t, ...cells, way.fixes.includes(k) ? 1 : 0, way.risk.law].join());
  });
  return `${lines.join("\n")}\n`;
}

/** The leg that begins at step k, by the names of the exported files. */
function legFacts(way, k) {
  const told = { time_utc: way.utc ? way.utc[k] : null, t_s: way.t[k], duration_s: way.t[k + 1] - way.t[k] };
  for (const [name, key] of CSV_COLUMNS.slice(0, 10)) if (key) told[name] = way.log[key][k];
  return { ...told, wind_law: way.risk.law };
}

const lonLat = (way, k) => [way.log.lon[k], way.log.lat[k]];
const feature = (type, coordinates, properties) => ({ type: "Feature", properties, geometry: { type, coordinates } });

function planGeojson(way) {
  const places = way.t.map((_, k) => lonLat(way, k)), row = PAGE.points[shown.point];
  const features = [feature("LineString", places, { role: "route", name: PAGE.name, formula: PAGE.formula, order: row.order, length_m: row.length_m })];
  for (let k = 0; k + 1 < places.length; k++) features.push(feature("LineString", [places[k], places[k + 1]], { role: "leg", leg: k, ...legFacts(way, k) }));
  places.forEach((place, k) => features.push(feature("Point", place, { role: "position", step: k, time_utc: way.utc ? way.utc[k] : null, t_s: way.t[k], radius_95_m: way.log.radius[k], regions: way.label[k], fix: way.fixes.includes(k), wind_law: way.risk.law })));
  for (const { role, name, ring } of PAGE.map.shapes) features.push(feature("Polygon", [ring], { role, name }));
  features.push(feature("Point", places[0], { role: "start", name: "start" }));
  return `${JSON.stringify({ type: "FeatureCollection", name: PAGE.name, description: fileNote(), features })}\n`;
}

// Line colour, its width and fill colour (aabbggrr) of the route and of each role, as exports/kml.py has them.
const KML_STYLES = {
  route: ["ff00a5ff", 3], region: ["ff3c8c3c", 2, "503c8c3c"], obstacle: ["ff303030", 2, "80303030"],
  landmark: ["ffb46432", 2, "50b46432"], bounds: ["ff808080", 1, "00808080"],
};

function planKml(way) {
  const height = PAGE.height.metres.toFixed(1), above = `<altitudeMode>${PAGE.height.ofSea ? "absolute" : "relativeToGround"}</altitudeMode>`;
  const styles = Object.entries(KML_STYLES).map(([name, [line, width, fill]]) => `<Style id="${name}"><LineStyle><color>${line}</color><width>${width}</width></LineStyle>${fill ? `<PolyStyle><color>${fill}</color></PolyStyle>` : ""}</Style>`);
  const placemark = (name, inside, style) => `<Placemark><name>${xml(name)}</name>${style ? `<styleUrl>#${style}</styleUrl>` : ""}${inside}</Placemark>`;
  const coordinates = (list, high = "") => `<coordinates>${list.map(([lon, lat]) => `${lon},${lat}${high}`).join(" ")}</coordinates>`;
  const places = way.t.map((_, k) => lonLat(way, k));
  const steps = places.map((place, k) => placemark(`${k} ${way.label[k].join(" ")}`.trim(),
    `${way.utc ? `<TimeStamp><when>${way.utc[k]}</when></TimeStamp>` : ""}<Point>${above}${coordinates([place], `,${height}`)}</Point>`));
  const areas = PAGE.map.shapes.map(({ name, ring, role }) => placemark(name,
    `<Polygon><tessellate>1</tessellate><outerBoundaryIs><LinearRing>${coordinates(ring)}</LinearRing></outerBoundaryIs></Polygon>`, role));
  return `<?xml version="1.0" encoding="UTF-8"?>\n<kml xmlns="http://www.opengis.net/kml/2.2"><Document><name>${xml(PAGE.name)}</name><description>${xml(fileNote())}</description>${styles.join("")}`
    + placemark("route", `<LineString>${above}${coordinates(places, `,${height}`)}</LineString>`, "route")
    + `<Folder><name>positions</name>${steps.join("")}</Folder><Folder><name>map</name>${areas.join("")}</Folder></Document></kml>\n`;
}

function planGpx(way) {
  const { metres, ofSea: sea } = PAGE.height;
  const points = way.t.map((_, k) => {
    const [lon, lat] = lonLat(way, k), time = way.utc ? `<time>${way.utc[k]}</time>` : "";
    return `<rtept lat="${lat}" lon="${lon >= 180 ? -180 : lon}">${sea ? `<ele>${metres.toFixed(1)}</ele>` : ""}${time}<name>${xml([k, ...way.label[k]].join(" "))}</name><desc>95 % of positions within ${(way.log.radius[k] / 1000).toFixed(3)} km, ${way.risk.law} winds${sea ? "" : `, ${metres} m above the ground of the start`}</desc></rtept>`;
  });
  const begin = way.utc ? `<time>${way.utc[0]}</time>` : "", departure = way.utc ? `<extensions><opencpn:planned_departure>${way.utc[0]}</opencpn:planned_departure></extensions>` : "";
  return `<?xml version="1.0" encoding="UTF-8"?>\n<gpx version="1.1" creator="pareto_ltl" xmlns="http://www.topografix.com/GPX/1/1" xmlns:opencpn="http://www.opencpn.org"><metadata><name>${xml(PAGE.name)}</name><desc>${xml(fileNote())}</desc>${begin}</metadata>`
    + `<rte><name>${xml(PAGE.name)}</name>${departure}${points.join("")}</rte></gpx>\n`;
}

const HOVERS = "The last item hovers at the end of the plan until the pilot takes over; the energy of the plan is without it. ";

/** Waypoints, speeds and geofence for QGroundControl, as exports/qgc.py writes them. */
function missionPlan(way) {
  const { metres, aboveSea } = PAGE.height, frame = aboveSea ? 0 : 3, mode = aboveSea ? 2 : 1, items = [];
  const add = (command, place, params, more = {}) => items.push({ type: "SimpleItem", autoContinue: true, doJumpId: items.length + 1, command, frame: place, params, ...more });
  const fly = (command, k) => add(command, frame, [0, 0, 0, null, way.log.lat[k], way.log.lon[k], metres], { AMSLAltAboveTerrain: null, Altitude: metres, AltitudeMode: mode });
  const { kind, takes_off: takesOff, hovers } = PAGE.vehicle;
  if (takesOff) fly(22, 0);
  const held = way.log.airspeed.map((airspeed, k) => hovers ? way.log.ground_speed[k] : way.log.calibrated[k] ?? airspeed);
  let speed = -1;
  held.forEach((one, k) => {
    if (Math.abs(one - speed) > 0.05 && one > 0) add(178, 2, [hovers ? 1 : 0, speed = one, -1, 0, 0, 0, 0]);
    fly(16, k + 1);
  });
  if (hovers) fly(17, held.length);
  const fences = PAGE.map.shapes.filter(({ role }) => role === "obstacle" || (role === "bounds" && PAGE.map.walled));
  const cruise = held.reduce((a, b) => Math.max(a, b), 0);
  return `${JSON.stringify({
    fileType: "Plan", version: 1, groundStation: "pareto_ltl",
    pareto_ltl: { note: `An autopilot flies this mission by position. ${takesOff ? "A landing is" : "Take-off and landing are"} not part of it. ${hovers ? HOVERS : ""}${fileNote()}` },
    mission: { version: 2, firmwareType: 0, vehicleType: kind, cruiseSpeed: cruise, hoverSpeed: cruise, globalPlanAltitudeMode: mode, plannedHomePosition: [way.log.lat[0], way.log.lon[0], 0], items },
    geoFence: { version: 2, circles: [], polygons: fences.map(({ role, ring }) => ({ version: 1, inclusion: role === "bounds", polygon: ring.slice(0, -1).map(([lon, lat]) => [lat, lon]) })) },
    rallyPoints: { version: 2, points: [] },
  })}\n`;
}

let fileAddresses = [];

/** Links to the files of the point that is shown. */
function listFiles() {
  fileAddresses.forEach(address => URL.revokeObjectURL(address));
  fileAddresses = [];
  const way = path(), place = byId("files");
  if (!place) return;
  byId("files-point").textContent = shown.point === PAGE.chosen ? `the chosen plan (point ${shown.point})` : `point ${shown.point}`;
  if (PAGE.onEarth) byId("export-command").textContent = `pareto-ltl export DIR --point ${shown.point}`;
  place.replaceChildren();
  if (!way || !way.log) {
    byId("files-note").textContent = PAGE.onEarth ? "This page has no navigation log of this path: the command below writes its files." : "The map has no place on Earth, so that nothing can be exported.";
    return;
  }
  const possible = FILES.filter(file => !file.outlined || PAGE.map.exported);
  for (const { name, kind, make } of possible) {
    const address = URL.createObjectURL(new Blob([make(way)], { type: kind }));
    fileAddresses.push(address);
    place.append(html("a", { href: address, download: `${PAGE.name.replace(/[^\w.-]+/g, "_")}_point_${shown.point}_${name}` }, name));
  }
  byId("files-note").textContent = "Times are UTC, places WGS 84, headings true. What is promised holds for flights by heading and airspeed.";
}
