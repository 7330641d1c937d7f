// Data of the page, the state of the view, and texts. Text from the data is set as text, never as markup.

import { byId, duration, flightsText, percent } from "./shapes.js";

const PAGE = JSON.parse(byId("page-data").textContent);
const MEDIUM = PAGE.medium, FLOWS = MEDIUM.flows;  // wind and winds, or current and currents
const capital = text => text[0].toUpperCase() + text.slice(1);

// What is shown: the point of the front, and the step of its path.
const shown = { point: firstPoint(), step: 0 };

function firstPoint() {
  const drawn = Object.keys(PAGE.paths).map(Number);
  return PAGE.chosen ?? (drawn.length ? drawn[0] : null);
}

const path = () => (shown.point === null ? null : PAGE.paths[shown.point] ?? null);
const isDrawn = point => String(point) in PAGE.paths;

/** The time that is shown [s after departure]. */
const moment = () => (path() ? path().t[shown.step] : PAGE.wind.t[shown.step] ?? 0);

/** A time [s after departure]: UTC if the map names a departure. */
function timeText(seconds) {
  if (PAGE.timeZero === null) return `${duration(seconds)} after departure`;
  const utc = new Date(Date.parse(PAGE.timeZero) + 1000 * seconds).toISOString();
  return `${utc.slice(0, 10)} ${utc.slice(11, 16)} UTC`;
}

/** The failure rate of a point with its interval, or its bound with its law. */
function failureText({ failure, failure_low: low, failure_high: high, law }) {
  if (low === null) return `fails ≤ ${percent(failure)} (bound), under ${law} ${FLOWS}`;
  const [count, interval] = flightsText(failure, low, high);
  return `${count} fail (${interval})`;
}
