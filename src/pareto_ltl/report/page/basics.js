"use strict";
// Data of the page, the state of the view, and small helpers. Text from the data is never read as markup:
// it is set by textContent, and in charts through plain(), since plotly reads some markup in its labels.

const PAGE = JSON.parse(document.getElementById("page-data").textContent);
const DARK = matchMedia("(prefers-color-scheme: dark)").matches && !matchMedia("print").matches;
const COLOURS = {
  ink: "#222222", stone: "#6b6b6b", mist: "#b8b8b8", region: "#009e73", regionName: "#00523c",
  obstacle: "#6e6e6e", landmark: "#a0457f", wind: "#2f78ad", path: "#000000", chosen: "#d55e00",
  flight: "#0072b2", failed: "#7a0018", mark: "#e69f00", paper: "#ffffff", grid: "#eeeeee",
  ...DARK ? {
    ink: "#e4e7eb", stone: "#a3abb5", mist: "#59626d", region: "#3fd0a2", regionName: "#8ff0cf", obstacle: "#7a838e", landmark: "#e08cc0",
    wind: "#5b9bcb", path: "#ffffff", chosen: "#ff9a52", flight: "#6cb6f0", failed: "#ff8fa6", mark: "#f2b632", paper: "#15191e", grid: "#2b333c",
  } : {},
};  // of Okabe and Ito, as in the figures; lighter on dark paper
const FONT = { family: 'system-ui, "DejaVu Sans", sans-serif', size: 12, color: COLOURS.ink };
const CONFIG = { displayModeBar: false, responsive: true, scrollZoom: false, doubleClick: "reset" };
const CHI2_95 = -2 * Math.log(0.05);  // 95 % quantile of chi-squared with two degrees of freedom
const CALM = matchMedia("(prefers-reduced-motion: reduce)").matches;

// What is shown: the point of the front, the step of its path, and whether the flight plays.
const shown = { point: firstPoint(), step: 0, timer: null };

function firstPoint() {
  const told = Object.keys(PAGE.paths).map(Number);
  return PAGE.chosen ?? (told.length ? told[0] : null);
}

const byId = id => document.getElementById(id);
const path = () => (shown.point === null ? null : PAGE.paths[shown.point] ?? null);
const onMap = metres => metres * PAGE.map.perMetre;

/** Text for a label of a chart, where it is no markup. */
function plain(text) {
  return String(text).replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;");
}

/** An element with attributes and text. */
function element(tag, attributes = {}, text = null, space = null) {
  const made = space ? document.createElementNS(space, tag) : document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  if (text !== null) made.textContent = text;
  return made;
}

/** A probability in per cent, with its significant digits. */
function percent(p) {
  if (p === null || p === undefined) return "-";
  if (p === 0) return "0 %";
  const value = 100 * Math.min(p, 1);
  if (value >= 99.995) return "100 %";
  return value < 1e-3 ? `${value.toExponential(1)} %` : `${+value.toPrecision(value >= 10 ? 3 : 2)} %`;
}

const distance = metres => metres >= 2000
  ? `${(metres / 1000).toLocaleString("en", { minimumFractionDigits: 1, maximumFractionDigits: 1 })} km`
  : `${metres.toFixed(0)} m`;

function duration(seconds) {
  const minutes = Math.round(seconds / 60);
  return seconds >= 3600 ? `${Math.floor(minutes / 60)} h ${String(minutes % 60).padStart(2, "0")} min`
    : seconds >= 120 ? `${minutes} min` : `${seconds.toFixed(0)} s`;
}

/** A time [s after departure]: UTC if the map names a departure. */
function timeText(seconds) {
  if (PAGE.timeZero === null) return `${duration(seconds)} after departure`;
  const utc = new Date(Date.parse(PAGE.timeZero) + 1000 * seconds).toISOString();
  return `${utc.slice(0, 10)} ${utc.slice(11, 16)} UTC`;
}

const clockText = (way, step) => timeText(way.t[step]);

/** The unit that times of charts have: the largest of which a flight takes two or more. */
function timeUnit(way) {
  const units = [{ name: "hours", seconds: 3600 }, { name: "minutes", seconds: 60 }, { name: "seconds", seconds: 1 }];
  return units.find(unit => way.t[way.t.length - 1] >= 2 * unit.seconds) ?? units[2];
}

/** The failure rate or bound of a point, with its interval and its law. */
function failureText(row) {
  if (row.low === null) return `fails at most ${percent(row.failure)} (bound), under ${row.law} winds`;
  return `fails ${percent(row.failure)} (${percent(row.low).replace(" %", "")}–${percent(row.high)}, 95 %), `
    + `under ${row.law} winds`;
}

/** Ellipse of 95 % of positions of covariance [xx, xy, yy] around (x, y), as closed lists of coordinates. */
function ellipse([x, y], [xx, xy, yy], corners = 40) {
  const middle = (xx + yy) / 2, half = Math.hypot((xx - yy) / 2, xy), turn = Math.atan2(2 * xy, xx - yy) / 2;
  const a = Math.sqrt(CHI2_95 * (middle + half)), b = Math.sqrt(CHI2_95 * Math.max(middle - half, 0));
  const found = { x: [], y: [] };
  for (let k = 0; k <= corners; k++) {
    const angle = 2 * Math.PI * k / corners, along = a * Math.cos(angle), across = b * Math.sin(angle);
    found.x.push(onMap(x + along * Math.cos(turn) - across * Math.sin(turn)));
    found.y.push(onMap(y + along * Math.sin(turn) + across * Math.cos(turn)));
  }
  return found;
}

/** Several outlines as one trace, with gaps in between. */
function joined(lines) {
  const found = { x: [], y: [] };
  for (const line of lines) {
    if (found.x.length) { found.x.push(null); found.y.push(null); }
    for (const [x, y] of line) { found.x.push(onMap(x)); found.y.push(onMap(y)); }
  }
  return found;
}

const closed = corners => [...corners, corners[0]];
