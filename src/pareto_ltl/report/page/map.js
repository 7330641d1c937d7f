// The map: traces that do not change, then those that the time slider moves. TRACES has their order.

const TRACES = ["doubt", "wind", "obstacles", "landmarks", "regions", "closed", "trees", "others", "ellipses", "tails", "lost",
  "places", "path", "reasons", "ends", "heads", "lostHeads", "spread", "robot", "numbers", "names"];
const traceNumber = name => TRACES.indexOf(name);
const ticked = id => byId(id)?.checked ?? false;

/** Share s and frame k such that time t lies at k + s of the frames of the wind. */
function windFrame(t) {
  const times = PAGE.wind.t;
  if (times.length < 2) return [0, 0];
  let k = 0;
  while (k < times.length - 2 && times[k + 1] <= t) k++;
  return [k, Math.min(1, Math.max(0, (t - times[k]) / (times[k + 1] - times[k])))];
}

const mixed = (frames, [k, s], i, j) => (1 - s) * frames[k][i][j] + (s ? s * frames[k + 1][i][j] : 0);

/** The largest expected speed at any time, which scales the arrows. */
const fastest = (() => {
  let most = 0;
  PAGE.wind.u.forEach((frame, k) => frame.forEach((column, i) => column.forEach((u, j) => {
    most = Math.max(most, Math.hypot(u, PAGE.wind.v[k][i][j]));
  })));
  return most;
})();

/** Expected wind at time t as arrows: one trace of shafts and heads. */
function windArrows(t) {
  const { x, y, u, v } = PAGE.wind, frame = windFrame(t), found = { x: [], y: [] };
  if (!fastest || !x.length || !y.length) return found;
  const [[west, south], [east, north]] = PAGE.map.bounds;
  const gap = x.length > 1 ? x[1] - x[0] : Math.max(east - west, north - south) / 13;
  const scale = 0.95 * gap / fastest;
  const draw = (...points) => {
    for (const [a, b] of points) { found.x.push(onMap(a)); found.y.push(onMap(b)); }
    found.x.push(null); found.y.push(null);
  };
  for (let i = 0; i < x.length; i++) for (let j = 0; j < y.length; j++) {
    const dx = scale * mixed(u, frame, i, j), dy = scale * mixed(v, frame, i, j);
    const tip = [x[i] + dx / 2, y[j] + dy / 2], tail = [x[i] - dx / 2, y[j] - dy / 2];
    const barb = side => [tip[0] - 0.3 * dx + side * 0.16 * dy, tip[1] - 0.3 * dy - side * 0.16 * dx];
    draw(tail, tip, barb(1)); draw(tip, barb(-1));
  }
  return found;
}

/** Standard deviation of the wind at time t, rows along y as plotly wants them. */
function doubtRows(t) {
  const { a, b, sd } = PAGE.wind, frame = windFrame(t);
  return b.map((_, j) => a.map((_, i) => mixed(sd, frame, i, j)));
}

const doubtRange = (() => {
  const all = PAGE.wind.sd.flat(2);
  const low = all.reduce((a, b) => Math.min(a, b), Infinity), high = all.reduce((a, b) => Math.max(a, b), 0);
  return Number.isFinite(low) ? [low, Math.max(high, low + 0.01)] : [0, 1];
})();

/** Traces that do not depend on the time. */
function groundTraces() {
  const { regions, obstacles, landmarks } = PAGE.map, named = regions.filter(r => r.parts.length), line = { hoverinfo: "skip", showlegend: false, mode: "lines" };
  const polygons = list => joined(list.map(closed));
  return {
    obstacles: { ...line, ...polygons(obstacles), fill: "toself", fillcolor: COLOURS.obstacle, line: { color: DARK ? "#b0b6bd" : "#4a4a4a", width: 1 } },
    landmarks: { ...line, ...polygons(landmarks), line: { color: COLOURS.landmark, width: 2, dash: "dash" } },
    regions: { ...line, ...polygons(regions.flatMap(r => r.parts)), fill: "toself", fillcolor: "rgba(0,158,115,0.28)", line: { color: COLOURS.region, width: 2 } },
    names: {
      ...line, mode: "text", ...joined(named.map(r => [labelPlace(largest(r.parts))])), textfont: { size: 15, weight: 700, color: COLOURS.regionName, shadow: "auto" },
      text: named.flatMap((r, k) => (k ? ["", plain(r.name)] : [plain(r.name)])), cliponaxis: true,
    },
    trees: { ...line, ...joined(PAGE.trees.map(([a, b, c, d]) => [[a, b], [c, d]])), line: { color: COLOURS.stone, width: 0.7 } },
  };
}

/** Place of the name of a region: of its centre and places towards its corners, the one farthest from the path. */
function labelPlace(corners) {
  const middle = centre(corners), way = path();
  if (!way) return middle;
  const tried = [middle, ...corners.map(([x, y]) => [0.55 * middle[0] + 0.45 * x, 0.55 * middle[1] + 0.45 * y])];
  const gap = ([x, y]) => way.x.reduce((least, [a, b]) => Math.min(least, Math.hypot(a - x, b - y)), Infinity);
  return tried.reduce((best, place) => gap(place) > 1.2 * gap(best) ? place : best);
}

const largest = parts => parts.reduce((most, part) => (part.length && area(part) > area(most) ? part : most), parts[0]);
const area = corners => Math.abs(corners.reduce((sum, [x, y], k) => {
  const [a, b] = corners[(k + 1) % corners.length];
  return sum + x * b - a * y;
}, 0));

/** The centre of mass of a polygon. */
function centre(corners) {
  let area = 0, x = 0, y = 0;
  corners.forEach(([ax, ay], k) => {
    const [bx, by] = corners[(k + 1) % corners.length], cross = ax * by - bx * ay;
    area += cross; x += (ax + bx) * cross; y += (ay + by) * cross;
  });
  return area ? [x / (3 * area), y / (3 * area)] : corners[0];
}

/** Traces of the path that is shown. */
function pathTraces() {
  const way = path();
  if (!way) return { path: {}, ellipses: {}, ends: joined([[PAGE.map.start]]), others: {} };
  const stride = Math.max(1, Math.ceil((way.x.length - 1) / 14)), rings = { x: [], y: [] };
  for (let k = way.x.length - 1; k > 0; k -= stride) {
    const ring = ellipse(way.x[k], way.cov[k]);
    rings.x.push(...ring.x, null); rings.y.push(...ring.y, null);
  }
  const last = way.x[way.x.length - 1], others = Object.keys(PAGE.paths).filter(k => +k !== shown.point);
  return {
    path: { ...joined([way.x]), text: way.x.map((_, k) => stepText(way, k)) },
    ellipses: { ...rings, visible: ticked("show-ellipses") },
    ends: joined([[PAGE.map.start, last]]),
    others: { ...joined(others.map(k => PAGE.paths[k].x)), visible: ticked("show-others") },
  };
}

/** Tight places of the chosen plan: stretches under its path, points on them that give the reason, and the
 *  numbers of the obstacles that have a price. */
function placeTraces() {
  const way = path(), none = { x: [], y: [] };
  if (!way || shown.point !== PAGE.chosen || !ticked("show-places")) return { places: none, reasons: { ...none, text: [], customdata: [] }, numbers: { ...none, text: [] } };
  const spots = PAGE.places.flatMap(place => [0.2, 0.4, 0.6, 0.8].map(share => ({ ...place, share })));
  const at = ({ step, share }) => way.x[step].map((x, axis) => (1 - share) * x + share * way.x[step + 1][axis]);
  return {
    places: joined(PAGE.places.map(({ step }) => way.x.slice(step, step + 2))),
    reasons: {
      x: spots.map(spot => onMap(at(spot)[0])), y: spots.map(spot => onMap(at(spot)[1])),
      text: spots.map(spot => spot.lines.map(plain).join("<br>")), customdata: spots.map(spot => spot.step),
    },
    numbers: { ...joined(PAGE.pricedObstacles.map(n => [centre(PAGE.map.obstacles[n - 1])])), text: PAGE.pricedObstacles.flatMap((n, k) => (k ? ["", String(n)] : [String(n)])) },
  };
}

/** Text for the pointer at a step. */
function stepText(way, k) {
  const told = [`step ${k} of ${way.x.length - 1}, ${clockText(way, k)}`];
  if (way.label[k].length) told.push(`in ${plain(way.label[k].join(", "))}`);
  if (way.fixes.includes(k)) told.push("position fix");
  if (way.log && k < way.log.heading.length) {
    const heading = way.log.heading[k];
    told.push(`${heading === null ? "drifts" : `heading ${heading.toFixed(0)}° true`}, ${way.log.airspeed[k].toFixed(1)} m/s`,
      `wind ${way.log.wind_speed[k].toFixed(1)} m/s from ${way.log.wind_from[k].toFixed(0)}° (sd ${way.log.wind_sd[k].toFixed(1)})`);
  }
  return told.join("<br>");
}

/** Regions that are forbidden at time t. */
function closedRegions(t) {
  const parts = new Map(PAGE.map.regions.map(region => [region.name, region.parts]));
  const now = PAGE.map.windows.filter(w => w.forbidden && (w.begin === null || w.begin <= t) && (w.end === null || t <= w.end));
  return joined(now.flatMap(w => parts.get(w.region) ?? []).map(closed));
}

/** Whether the simulated flights belong to the point that is shown. */
const hasFlights = () => PAGE.flights !== null && shown.point === PAGE.chosen;

/** Traces of the time that is shown. */
function momentTraces() {
  const way = path(), t = way ? way.t[shown.step] : PAGE.wind.t[shown.step] ?? 0;
  const found = {
    doubt: { z: doubtRows(t), visible: ticked("show-doubt") },
    wind: { ...windArrows(t), visible: ticked("show-wind") },
    closed: closedRegions(t), robot: { x: [], y: [] }, spread: { x: [], y: [] }, ...flightTraces(),
  };
  if (way) {
    found.robot = joined([[way.x[shown.step]]]);
    found.spread = { ...ellipse(way.x[shown.step], way.cov[shown.step]), visible: ticked("show-ellipses") };
  }
  return found;
}

/** Tails and positions of the simulated flights until now; those of failed flights are separate. */
function flightTraces() {
  const none = { x: [], y: [] }, step = shown.step;
  if (!hasFlights() || !ticked("show-flights")) return { tails: none, lost: none, heads: none, lostHeads: none };
  const good = [], bad = [];
  PAGE.flights.x.forEach((flight, n) => {
    const failed = PAGE.flights.failedAt[n];
    (failed >= 0 && failed <= step ? bad : good).push(flight.slice(0, step + 1));
  });
  const places = lines => joined(lines.map(line => [line[line.length - 1]]));
  return { tails: joined(good), lost: joined(bad), heads: places(good), lostHeads: places(bad) };
}

const MAP_STYLE = {
  doubt: { type: "heatmap", colorscale: [[0, DARK ? "#20262c" : "#fbfbf4"], [0.5, DARK ? "#4d4630" : "#ead9a4"], [1, DARK ? "#8a6d2b" : "#c99b3f"]], zsmooth: "best", hovertemplate: "standard deviation of the wind %{z:.1f} m/s<extra></extra>",
    colorbar: { orientation: "h", thickness: 9, len: 0.7, x: 0, xanchor: "left", yref: "container", y: 0.005, yanchor: "bottom", title: { text: "uncertainty of the wind: standard deviation, eastward or northward [m/s]", side: "bottom", font: { size: 11 } }, tickfont: { size: 11 }, outlinewidth: 0 } },
  closed: { mode: "lines", line: { color: COLOURS.failed, width: 2, dash: "dash" }, fill: "toself", fillcolor: "rgba(70,70,70,0.55)", hoverinfo: "skip" },
  wind: { mode: "lines", line: { color: COLOURS.wind, width: 1.3 }, hoverinfo: "skip" },
  others: { mode: "lines", line: { color: COLOURS.stone, width: 1, dash: "dot" }, hoverinfo: "skip" },
  ellipses: { mode: "lines", line: { color: COLOURS.ink, width: 0.8 }, fill: "toself", fillcolor: DARK ? "rgba(230,230,230,0.09)" : "rgba(50,50,50,0.07)", hoverinfo: "skip" },
  tails: { mode: "lines", line: { color: COLOURS.flight, width: 0.7 }, opacity: 0.55, hoverinfo: "skip" },
  lost: { mode: "lines", line: { color: COLOURS.failed, width: 1.6, dash: "dash" }, hoverinfo: "skip" },
  places: { mode: "lines", line: { color: COLOURS.chosen, width: 10 }, opacity: 0.6, hoverinfo: "skip" },
  reasons: { mode: "markers", marker: { size: 8, opacity: 0 }, hovertemplate: "%{text}<extra></extra>", hoverlabel: { align: "left", bgcolor: COLOURS.chosen } },
  numbers: { mode: "text", textfont: { size: 13, weight: 700, color: "white" }, hoverinfo: "skip", cliponaxis: true },
  path: { mode: "lines+markers", line: { color: COLOURS.path, width: 2.4 }, marker: { size: 4, color: COLOURS.path }, hovertemplate: "%{text}<extra></extra>" },
  ends: { mode: "markers", marker: { size: 11, color: COLOURS.paper, symbol: ["circle", "square"], line: { color: COLOURS.path, width: 2 } }, text: ["start", "expected end"], hovertemplate: "%{text}<extra></extra>" },
  heads: { mode: "markers", marker: { size: 4, color: COLOURS.flight }, hoverinfo: "skip" },
  lostHeads: { mode: "markers", marker: { size: 9, symbol: "x", color: COLOURS.failed }, hoverinfo: "skip" },
  spread: { mode: "lines", line: { color: COLOURS.chosen, width: 2 }, fill: "toself", fillcolor: "rgba(213,94,0,0.15)", hoverinfo: "skip" },
  robot: { mode: "markers", marker: { size: 13, color: COLOURS.mark, line: { color: "black", width: 2 } }, hoverinfo: "skip" },
};

const MARGIN = { l: 56, r: 8, t: 8, b: 104 };

/** Set the height of the map from its outline and the width of its column, at most that of the window. */
function fitMap() {
  const [[west, south], [east, north]] = PAGE.map.bounds, inner = byId("map").clientWidth - MARGIN.l - MARGIN.r;
  const printing = document.documentElement.classList.contains("printing");  // below the numbers, on the first sheet
  const tall = inner * (north - south) / (east - west), most = printing ? 440 : Math.max(280, Math.min(720, innerHeight - MARGIN.t - MARGIN.b - 130));  // with its heading and slider
  byId("map").style.height = `${Math.round(Math.min(Math.max(tall, 160), most) + MARGIN.t + MARGIN.b)}px`;
}

function drawMap() {
  fitMap();
  const parts = { ...groundTraces(), ...pathTraces(), ...placeTraces(), ...momentTraces() };
  const traces = TRACES.map(name => ({ type: "scatter", showlegend: false, ...MAP_STYLE[name], ...parts[name] }));
  const doubt = traces[traceNumber("doubt")];
  Object.assign(doubt, { x: PAGE.wind.a.map(onMap), y: PAGE.wind.b.map(onMap), zmin: doubtRange[0], zmax: doubtRange[1] });
  const [[west, south], [east, north]] = PAGE.map.bounds.map(corner => corner.map(onMap)), unit = PAGE.map.unit;
  const axis = (low, high, text) => ({ range: [low, high], title: { text, standoff: 12 }, zeroline: false, showgrid: false, nticks: 6, ticks: "outside", ticklen: 4, linecolor: COLOURS.mist, constrain: "domain" });
  const layout = {
    font: FONT, margin: MARGIN, dragmode: "pan", hovermode: "closest", plot_bgcolor: COLOURS.paper, paper_bgcolor: COLOURS.paper,
    xaxis: axis(west, east, `east [${unit}]`), yaxis: { ...axis(south, north, `north [${unit}]`), scaleanchor: "x" },
    shapes: [{ type: "rect", x0: west, x1: east, y0: south, y1: north, line: { color: COLOURS.ink, width: PAGE.map.walled ? 2.5 : 1, dash: PAGE.map.walled ? "solid" : "dot" } }],
  };
  return Plotly.newPlot("map", traces, layout, { ...CONFIG, displayModeBar: "hover", displaylogo: false, modeBarButtons: [["zoomIn2d", "zoomOut2d", "resetScale2d"]] });
}

/** Change the traces of `parts` on the map, each by its name. */
function restyleMap(parts) {
  const columns = {}, names = Object.keys(parts);
  for (const name of names) for (const key of Object.keys(parts[name])) columns[key] = null;
  // One call for each set of attributes: plotly draws once at the end of the task.
  const byKeys = new Map();
  for (const name of names) {
    const keys = Object.keys(parts[name]).sort().join();
    byKeys.set(keys, [...(byKeys.get(keys) ?? []), name]);
  }
  for (const [keys, group] of byKeys) {
    const change = Object.fromEntries(keys.split(",").map(key => [key, group.map(name => parts[name][key])]));
    Plotly.restyle("map", change, group.map(traceNumber));
  }
}
