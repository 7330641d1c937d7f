// Small helpers for elements. Text is always set as text, never as markup.

export const byId = id => document.getElementById(id);
const SVG = "http://www.w3.org/2000/svg";

function filled(made, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) made.addEventListener(name.slice(2), value);
    else if (value === true) made.setAttribute(name, "");
    else if (value !== null && value !== undefined && value !== false) made.setAttribute(name, value);
  }
  made.append(...children.filter(child => child !== null).map(child => child instanceof Node ? child : String(child)));
  return made;
}

/** An HTML element with attributes, listeners (onclick: function) and children. */
export const html = (tag, attributes = {}, ...children) => filled(document.createElement(tag), attributes, children);

/** The same for SVG. */
export const svg = (tag, attributes = {}, ...children) => filled(document.createElementNS(SVG, tag), attributes, children);

export const pathOf = (points, close = false) => points.length ? `M${points.map(([x, y]) => `${x.toFixed(1)} ${y.toFixed(1)}`).join("L")}${close ? "Z" : ""}` : "";

/** A probability in per cent. */
export function percent(p) {
  if (p === null || p === undefined) return "-";
  const value = 100 * Math.min(1, p);
  if (value >= 99.995) return "100 %";
  return value === 0 ? "0 %" : value < 1e-5 ? `${value.toExponential(1)} %` : `${+value.toPrecision(value >= 10 ? 3 : 2)} %`;
}

/** A failure rate and its interval as numbers of 100, 10,000 or a million flights, as in the summary of a run. */
export function flightsText(rate, low, high) {
  const size = rate > 0 ? rate : high, whole = size >= 0.00995 ? 100 : size >= 0.0000995 ? 10000 : 1e6, tenths = whole * (high - low) < 2;
  const number = value => {
    const count = whole * Math.min(1, value);
    if (count > 0 && count < 0.001) return "less than 0.001";
    if (whole === 100 && count > 99 && count < 100) return Math.min(count, 99.99).toFixed(2);
    return count >= 9.95 ? count.toFixed(tenths ? 1 : 0) : count < 1 ? String(+count.toPrecision(2)) : count.toFixed(1);
  };
  return [`${number(rate)} of ${whole.toLocaleString("en")} flights`, `${number(low)} to ${number(high)}`];
}

/** Speeds in m/s, with two decimals if the largest of them is below 3 m/s, as of a glider. */
export const speedTexts = (...speeds) => speeds.map(speed => speed.toFixed(Math.max(...speeds) < 3 ? 2 : 1));

export function duration(seconds) {
  const minutes = Math.round(seconds / 60);
  return seconds >= 3600 ? `${Math.floor(minutes / 60)} h ${String(minutes % 60).padStart(2, "0")} min` : seconds >= 120 ? `${minutes} min` : `${seconds.toFixed(0)} s`;
}
